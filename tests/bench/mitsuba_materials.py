"""Rough conductors, rough dielectrics and plastic against Mitsuba 3: six scenes, each pixel compared by a t-test.

    python tests/bench/mitsuba_materials.py               # 3 minutes on two cores; needs mitsuba

Both tracers render each scene with several seeds. The difference of the means of a pixel, over its standard error, is
Student's t with about 2 (seeds - 1) degrees of freedom where both have the same expectation. Mitsuba's ``plastic`` has
a fit for the diffuse reflectance from inside, 0.5968 in place of 0.5963: only far more samples show the difference.
"""

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import mpmath
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import raytrace as rt
from raytrace.records import DIFFUSE, PLASTIC, ROUGH_CONDUCTOR, ROUGH_DIELECTRIC

METAL = {"type": "conductor", "metal": "gold"}
GLASS = {"type": "dielectric", "ior": 1.5}
PLASTIC_BLUE = {"type": "plastic", "albedo": [0.1, 0.3, 0.7], "ior": 1.5}


def scene(first: dict[str, Any], second: dict[str, Any], lights: str) -> dict[str, Any]:
    """Two tilted boxes on a floor, under a lamp, an environment, or a point light."""
    lamp = {"rectangle": {}, "material": "lamp", "rotate": {"axis": [1, 0, 0], "angle": 90}, "translate": [0, 3, 0]}
    box = {"box": {}, "rotate": [{"axis": [0, 1, 0], "angle": 25}, {"axis": [1, 0, 0], "angle": 12}]}
    given = {
        "lamp": [],
        "environment": [{"type": "environment", "radiance": [0.5, 0.6, 0.8]}],
        "point": [{"type": "point", "position": [1, 3, 2], "flux": [60, 60, 60]}],
    }
    return {
        "camera": {"position": [0, 2.2, 7], "look_at": [0, 0.7, 0], "fov": 30},
        "render": {"integrator": "path", "max_depth": 12},
        "lights": given[lights],
        "materials": {
            "floor": {"type": "diffuse", "albedo": [0.5, 0.5, 0.4]},
            "lamp": {"type": "diffuse", "albedo": [0, 0, 0], "emission": [8, 7, 6]},
            "first": first,
            "second": second,
        },
        "objects": [
            {"rectangle": {}, "material": "floor", "scale": 5, "rotate": {"axis": [1, 0, 0], "angle": -90}},
            {**box, "material": "first", "scale": [0.7, 0.5, 0.5], "translate": [-0.9, 0.9, 0]},
            {**box, "material": "second", "scale": [0.5, 0.6, 0.3], "translate": [0.9, 0.9, 0.4]},
            *([lamp] if lights == "lamp" else []),
        ],
    }


SCENES = {
    "nearly smooth metal, lamp": scene(METAL | {"alpha": 0.02}, METAL | {"alpha": 0.1}, "lamp"),
    "rough metal, environment": scene(METAL | {"alpha": 0.3}, METAL | {"alpha": 1.0}, "environment"),
    "rough glass, lamp": scene(GLASS | {"alpha": 0.2}, GLASS | {"alpha": 0.6}, "lamp"),
    "rough glass, environment": scene(GLASS | {"alpha": 0.1}, GLASS | {"alpha": 1.0}, "environment"),
    "plastic, point light": scene(PLASTIC_BLUE, PLASTIC_BLUE | {"albedo": [0.9, 0.9, 0.9]}, "point"),
    "plastic and rough metal, lamp": scene(PLASTIC_BLUE, METAL | {"alpha": 0.15}, "lamp"),
}


def peer_bsdf(scene: rt.Scene, k: int) -> dict[str, Any]:
    """Material k as Mitsuba has it."""
    table = scene.materials
    kind, alpha = table.kind[k], 0.0 if table.alpha is None else float(table.alpha[k])

    def colour(values: np.ndarray) -> dict[str, Any]:
        return {"type": "rgb", "value": values.tolist()}

    if kind == ROUGH_DIELECTRIC:
        ior = float(table.ior[k])
        return {"type": "roughdielectric", "distribution": "ggx", "alpha": alpha, "int_ior": ior, "ext_ior": 1.0}
    if kind == ROUGH_CONDUCTOR:
        index = {"eta": colour(table.eta[k]), "k": colour(table.k[k])}
        return {
            "type": "twosided",
            "bsdf": {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, **index},
        }
    if kind == PLASTIC:
        coat = {"int_ior": float(table.ior[k]), "ext_ior": 1.0, "nonlinear": True}
        return {"type": "plastic", "diffuse_reflectance": colour(table.albedo[k]), **coat}
    assert kind == DIFFUSE
    return {"type": "diffuse", "reflectance": colour(table.albedo[k])}


def peer_scene(scene: rt.Scene, side: int) -> Any:
    """The scene as Mitsuba's own objects."""
    import mitsuba as mi

    camera = scene.camera
    look = mi.ScalarTransform4f().look_at(*(a.tolist() for a in (camera.position, camera.look_at, camera.up)))
    film = {"type": "hdrfilm", "width": side, "height": side, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    content: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": scene.settings.max_depth + 1, "rr_depth": 1000},
        "camera": {"type": "perspective", "fov": camera.fov, "fov_axis": "y", "to_world": look, "film": film},
    }
    for k, (position, flux) in enumerate(zip(scene.lights.position, scene.lights.flux, strict=True)):
        intensity = {"type": "rgb", "value": (flux / (4 * np.pi)).tolist()}
        content[f"light{k}"] = {"type": "point", "position": position.tolist(), "intensity": intensity}
    if scene.lights.environment is not None:
        radiance = {"type": "rgb", "value": scene.lights.environment.tolist()}
        content["environment"] = {"type": "constant", "radiance": radiance}
    for k in np.unique(scene.mesh.material_id):
        content[f"mesh{k}"] = _peer_mesh(scene, int(k))
    return mi.load_dict(content)


def _peer_mesh(scene: rt.Scene, k: int) -> Any:
    """All triangles of a material as one mesh of Mitsuba."""
    import mitsuba as mi

    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(peer_bsdf(scene, k))
    emission = scene.materials.emission
    if emission is not None and emission[k].any():
        radiance = {"type": "rgb", "value": emission[k].tolist()}
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
    faces = scene.mesh.faces[scene.mesh.material_id == k]
    mesh = mi.Mesh(f"mesh{k}", len(scene.mesh.vertices), len(faces), props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(scene.mesh.vertices.ravel().astype("f4"))
    parameters["faces"] = mi.UInt32(faces.ravel().astype("u4"))
    parameters.update()
    return mesh


def compare(name: str, side: int, spp: int, seeds: int) -> tuple[float, str]:
    """p-value of the largest |t| of all pixels, and a line that says how the images differ."""
    import mitsuba as mi

    ours = rt.load(SCENES[name])
    peer = peer_scene(ours, side)
    a = np.array([rt.render(ours, size=(side, side), spp=spp, seed=k).rgb for k in range(seeds)], np.float64)
    b = np.array([np.array(mi.render(peer, spp=spp, seed=1000 + k)) for k in range(seeds)], np.float64)
    error = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / seeds)
    t = (a.mean(axis=0) - b.mean(axis=0))[error > 0] / error[error > 0]
    freedom = 2 * (seeds - 1)
    worst = float(np.abs(t).max())
    tail = float(mpmath.betainc(freedom / 2, 0.5, 0, freedom / (freedom + worst**2), regularized=True))
    mean = a.mean(axis=(1, 2, 3)), b.mean(axis=(1, 2, 3))
    relative = mean[0].mean() / mean[1].mean() - 1
    spread = math.hypot(*(x.std(ddof=1) for x in mean)) / seeds**0.5 / mean[1].mean()
    p = 1 - (1 - tail) ** len(t)  # [Sidak1967]; channels are not independent, so it is too large if anything
    expected = freedom / (freedom - 2)
    line = f"mean {relative:+.2e} +- {spread:.1e}; mean of t^2 {np.mean(t**2):.3f}, expected {expected:.3f}"
    return p, f"{name}: {line}; largest |t| {worst:.2f} of {len(t)}, p = {p:.3g}"


def main() -> int:
    """Compare all scenes; 1 if one differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=32, help="pixels along a side of the images")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel and seed")
    parser.add_argument("--seeds", type=int, default=16, help="images of each tracer")
    args = parser.parse_args()
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    sys.stdout.write(f"raytrace {rt.__version__}, mitsuba {mi.__version__}\n")
    found = []
    for name in SCENES:
        p, line = compare(name, args.side, args.spp, args.seeds)
        found.append(p)
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    return int(min(found) < 1e-3)


if __name__ == "__main__":
    sys.exit(main())
