"""A Cornell box in a warm process against Mitsuba 3 (``direct``), the same samples, interleaved in one run."""

from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, interleave, parser, show, table, times_faster
from peers import Mitsuba, available, mitsuba

import raytrace as rt
from raytrace.records import Scene


def peer_scene(scene: Scene, size: int) -> Any:
    """The same meshes, camera, point lights and box filter."""
    mi = mitsuba()
    camera, materials = scene.camera, scene.materials
    look = mi.ScalarTransform4f().look_at(*(a.tolist() for a in (camera.position, camera.look_at, camera.up)))
    film = {"type": "hdrfilm", "width": size, "height": size, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    content = {
        "type": "scene",
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
        "camera": {"type": "perspective", "fov": camera.fov, "fov_axis": "y", "to_world": look, "film": film},
    }
    for k, (position, flux) in enumerate(zip(scene.lights.position, scene.lights.flux, strict=True)):
        intensity = {"type": "rgb", "value": (flux / (4 * np.pi)).tolist()}
        content[f"light{k}"] = {"type": "point", "position": position.tolist(), "intensity": intensity}
    for k in np.unique(scene.mesh.material_id):
        albedo = {"type": "rgb", "value": materials.albedo[k].tolist()}
        faces = scene.mesh.faces[scene.mesh.material_id == k]
        content[f"mesh{k}"] = _peer_mesh(mi, scene.mesh.vertices, faces, {"type": "diffuse", "reflectance": albedo})
    return mi.load_dict(content)


def _peer_mesh(mi: Any, vertices: np.ndarray, faces: np.ndarray, bsdf: dict[str, Any]) -> Any:
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    mesh = mi.Mesh("mesh", len(vertices), len(faces), props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(vertices.ravel().astype("f4"))
    parameters["faces"] = mi.UInt32(faces.ravel().astype("u4"))
    parameters.update()
    return mesh


def peer_picture(scene: Scene, size: int, spp: int) -> Callable[[], Any]:
    import drjit as dr

    mi, loaded, seeds = mitsuba(), peer_scene(scene, size), count()

    def draw() -> Any:
        image = mi.render(loaded, spp=spp, seed=next(seeds))
        dr.eval(image)
        dr.sync_thread()
        return image

    return draw


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--scene", default=ROOT / "scenes/cornell-box.json", help="diffuse meshes and point lights")
    options.add_argument("--size", type=int, default=512, help="pixels: side of the film (%(default)s)")
    options.add_argument("--spp", type=int, default=64, help="samples per pixel (%(default)s)")
    args = options.parse_args()
    found = begin()
    scene = rt.load(args.scene)

    def ours(precision: str) -> Callable[[], Any]:
        return lambda: rt.render(scene, spp=args.spp, size=(args.size, args.size), precision=precision)

    calls: dict[str, Callable[[], Any]] = {name: ours(name) for name in ("float32", "float64")}
    peers, missing = available()
    if Mitsuba in peers:
        calls["Mitsuba"] = peer_picture(scene, args.size, args.spp)
        mean = [np.mean(np.asarray(calls[name]()), (0, 1)) for name in ("float32", "Mitsuba")]
        show(f"means: raytrace {mean[0]}, Mitsuba {mean[1]}\n")
    else:
        show(f"missing: Mitsuba: {missing['Mitsuba']}\n")
    seconds = interleave(calls, args.rounds)
    samples = args.size**2 * args.spp / 1e6
    ratio = {name: times_faster(seconds["float32"], times) for name, times in seconds.items()}
    table(["picture", "seconds", "million samples/s", "seconds / float32"],
          ([name, float(np.median(times)), samples / float(np.median(times)), ratio[name]]
           for name, times in seconds.items()))  # fmt: skip
    stats = calls["float32"]().stats
    total = sum(stats["seconds_by_pass"].values())
    show("Seconds by pass, summed over the threads, of one picture in float32:\n")
    table(["pass", "seconds", "share"], ([name, s, s / total] for name, s in stats["seconds_by_pass"].items()))
    finish(args, found, {"seconds": {name: times.tolist() for name, times in seconds.items()}, "ratio": ratio,
                         "passes": stats["seconds_by_pass"], "rays": stats["rays"]})  # fmt: skip


if __name__ == "__main__":
    main()
