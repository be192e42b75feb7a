"""The student project, stage by stage: which scenes of the conformance suite pass with what a stage has.

    python tests/bench/project_stages.py            # all stages: about ten minutes on one core
    python tests/bench/project_stages.py --stages 1 2 --spp 16

A small renderer, written with the functions of raytrace.textbook, has what the stages of docs/notebooks/project.md have
built so far. It leaves out the scenes that need more, and ``raytrace conformance`` judges the others.
"""

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from harness import begin, finish, parser, show

import raytrace as rt
from raytrace.conformance.judging import judge, read_answers
from raytrace.conformance.writing import write_suite
from raytrace.image.files import save
from raytrace.records import DIELECTRIC, DIFFUSE, MIRROR, Hits
from raytrace.textbook import power_heuristic, stratified, surface_at, to_world
from raytrace.textbook.camera import pinhole_rays, unit
from raytrace.textbook.integrator import build_trees
from raytrace.textbook.path import Lamps, bounce, split, visible
from raytrace.textbook.sampling import cosine_hemisphere
from raytrace.textbook.shading import Point, dot, offset_origin
from raytrace.textbook.tree import traverse

CAMERA, LIGHTS, SHADOWS, MIRRORS, PATHS, AIM, MIS, GLASS = range(1, 9)
BATCH = 2**14
MOST_TRIANGLES = 10_000  # the textbook's tree is slow


def needs(scene: Any) -> int:
    """The first stage that has all that a scene needs; 9: none has."""
    kinds = set(scene.materials.kind[scene.mesh.material_id].tolist())
    lights = scene.lights
    if kinds - {DIFFUSE, MIRROR, DIELECTRIC} or lights.image is not None or scene.textures is not None:
        return 9
    if scene.camera.aperture > 0 or len(scene.mesh.faces) > MOST_TRIANGLES:
        return 9
    if DIELECTRIC in kinds:
        return GLASS
    black = not scene.materials.albedo[scene.materials.kind == DIFFUSE].any()
    if MIRROR in kinds:
        return MIRRORS if black else PATHS
    point_like = len(lights.position) or lights.spots is not None or lights.directions is not None
    if black and not point_like:
        return CAMERA
    if lights.environment is not None or not point_like:
        return PATHS
    return SHADOWS if len(np.unique(scene.mesh.object_id)) > 1 else LIGHTS


def camera_rays(scene: Any, positions: Any) -> tuple[Any, Any]:
    """Rays of a pinhole or an orthographic camera."""
    camera, size = scene.camera, scene.settings.size
    if camera.height is None:
        return pinhole_rays(camera, size, positions)
    forward = unit(camera.look_at - camera.position)
    right = unit(np.cross(forward, camera.up))
    up = np.cross(right, forward)
    x, y = (positions - np.array(size) / 2).T * camera.height / size[1]
    return camera.position + x[:, None] * right - y[:, None] * up, np.broadcast_to(forward, (len(x), 3))


def point_lights(scene: Any, blockers: Any, stage: int, point: Point) -> Any:
    """Light of point, spot and directional lights that diffuse fronts reflect."""
    total, f = np.zeros_like(point.p), scene.materials.albedo[point.material] / math.pi
    found = []  # vector to the light, irradiance at right angles to it
    for position, flux in zip(scene.lights.position, scene.lights.flux, strict=True):
        to_light = position - point.p
        found.append((to_light, flux / (4 * math.pi * dot(to_light, to_light))))
    spots, suns = scene.lights.spots, scene.lights.directions
    for k in range(0 if spots is None else len(spots.position)):
        to_light = spots.position[k] - point.p
        angle = np.arccos(np.clip(-dot(unit(to_light), spots.axis[k]), -1, 1))
        width = max(spots.cutoff[k] - spots.beam[k], 1e-12)
        share = np.clip((spots.cutoff[k] - angle) / width, 0, 1)
        found.append((to_light, share * spots.intensity[k] / dot(to_light, to_light)))
    for k in range(0 if suns is None else len(suns.direction)):
        found.append((np.broadcast_to(-1e4 * suns.direction[k], point.p.shape), suns.irradiance[k]))
    for to_light, irradiance in found:
        cos = np.maximum(dot(unit(to_light), point.ng), 0)
        seen = visible(scene, blockers, point.p, point.ng, to_light) if stage >= SHADOWS else 1.0
        total += f * irradiance * cos * seen
    return total


def lamp_light(scene: Any, blockers: Any, lamps: Lamps, stage: int, point: Point, rng: Any) -> Any:
    """Light of one point on a lamp, for each surface: next-event estimation."""
    q, nl, prim_id = lamps.sample(rng.random((len(point.p), 3)))
    to_light = q - point.p
    wi = unit(to_light)
    cos, cos_lamp = dot(wi, point.ng), -dot(wi, nl)
    lit = (cos > 0) & (cos_lamp > 0)
    cos, cos_lamp = np.where(lit, cos, 0), np.where(lit, cos_lamp, 1)
    pdf = lamps.density[prim_id, None] * dot(to_light, to_light) / cos_lamp
    weight = power_heuristic(pdf, cos / math.pi) if stage >= MIS else 1.0
    light = scene.materials.albedo[point.material] / math.pi * lamps.emission[prim_id] * cos * weight / pdf
    return light * visible(scene, blockers, point.p, point.ng, to_light)


def emitted(lamps: Lamps, stage: int, prim_id: Any, t: Any, point: Point, pdf: Any) -> Any:
    """Emission that rays meet: all, or what aiming has not counted."""
    if stage >= MIS:
        return lamps.seen(prim_id, t, -dot(point.d, point.ng), pdf)
    counts = dot(point.d, point.ng) < 0
    return np.where(counts & np.isinf(pdf) if stage >= AIM else counts, lamps.emission[prim_id], 0)


def matt(scene: Any, point: Point) -> tuple[Any, Any]:
    """Rows of diffuse surfaces that are met from a side that reflects, and normals on that side."""
    front = dot(point.d, point.ng)[:, 0] < 0
    diffuse = scene.materials.kind[point.material] == DIFFUSE
    rows = np.flatnonzero(diffuse & (front | scene.materials.two_sided[point.material]))
    return rows, np.where(front[rows, None], point.ng[rows], -point.ng[rows])


def go_on(scene: Any, stage: int, point: Point, rng: Any) -> tuple[Any, ...]:
    """Origins, directions, factors and densities of the rays that go on; factor 0: the path ends."""
    kind, n = scene.materials.kind[point.material], len(point.p)
    o, d = np.zeros((n, 3)), np.tile([0.0, 0, 1], (n, 1))
    factor, pdf = np.zeros((n, 3)), np.full((n, 1), np.inf)
    for of, way in ((MIRROR, bounce), (DIELECTRIC, split)):
        rows = np.flatnonzero(kind == of)
        if len(rows) and stage >= (MIRRORS if of == MIRROR else GLASS):
            o[rows], d[rows], factor[rows], pdf[rows] = way(scene, Point(*(a[rows] for a in point)), rng)
    rows, ng = matt(scene, point)
    if stage >= PATHS and len(rows):
        u = rng.random((len(rows), 2))
        if stage >= AIM:
            w, density = cosine_hemisphere(u)
        else:
            r, phi = np.sqrt(1 - u[:, :1] ** 2), 2 * math.pi * u[:, 1:]
            w, density = np.hstack([r * np.cos(phi), r * np.sin(phi), u[:, :1]]), np.full((len(rows), 1), 0.5 / math.pi)
        d[rows], pdf[rows] = to_world(ng, w), density
        factor[rows] = scene.materials.albedo[point.material[rows]] / math.pi * w[:, 2:] / density
        o[rows] = offset_origin(scene, point.p[rows], ng, d[rows])
    return o, d, factor, pdf


def radiance(scene: Any, trees: tuple[Any, Any], stage: int, o: Any, d: Any, rng: Any) -> Any:
    """Radiance (n, 3) along rays, with what a stage has."""
    (tree, blockers), lamps, settings = trees, Lamps(scene), scene.settings
    total, throughput, path = np.zeros((len(d), 3)), np.ones((len(d), 3)), np.arange(len(d))
    pdf = np.full((len(d), 1), np.inf)
    sky = np.zeros(3) if scene.lights.environment is None else scene.lights.environment
    for depth in range(settings.max_depth + 1 if stage >= MIRRORS else 1):
        hits = traverse(tree, o, d)
        met, gone = np.flatnonzero(hits.prim_id >= 0), np.flatnonzero(hits.prim_id < 0)
        total[path[gone]] += throughput[gone] * sky
        point = surface_at(scene, Hits(*(a[met] for a in hits)), d[met])
        path, throughput, pdf = path[met], throughput[met], pdf[met]
        total[path] += throughput * emitted(lamps, stage, hits.prim_id[met], hits.t[met, None], point, pdf)
        if depth == settings.max_depth:
            break
        diffuse, ng = matt(scene, point)
        at = Point(*(a[diffuse] for a in point))._replace(ng=ng)
        if stage >= LIGHTS:
            total[path[diffuse]] += throughput[diffuse] * point_lights(scene, blockers, stage, at)
        if stage >= AIM and len(lamps.prim_id):
            total[path[diffuse]] += throughput[diffuse] * lamp_light(scene, blockers, lamps, stage, at, rng)
        o, d, factor, pdf = go_on(scene, stage, point, rng)
        throughput = throughput * factor
        chance = np.clip(throughput.max(axis=1), 0.05, 1) if stage >= MIS and depth >= 3 else np.ones(len(path))
        alive = np.flatnonzero((throughput.max(axis=1) > 0) & (rng.random(len(path)) < chance))
        o, d, path, pdf = o[alive], d[alive], path[alive], pdf[alive]
        throughput = throughput[alive] / chance[alive, None]
        if not len(path):
            break
    return total


def image_of(scene: Any, stage: int, spp: int) -> Any:
    """Render a scene with what a stage has."""
    positions = stratified(scene.settings.size, spp)
    o, d = camera_rays(scene, positions.reshape(-1, 2))
    trees, rng = build_trees(scene), np.random.default_rng(stage)
    batches = [slice(k, k + BATCH) for k in range(0, len(o), BATCH)]
    found = [radiance(scene, trees, stage, o[batch], d[batch], rng) for batch in batches]
    return np.concatenate(found).reshape(*positions.shape[:3], 3).mean(axis=2).astype(np.float32)


def main() -> int:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--stages", type=int, nargs="+", default=list(range(1, 9)))
    arguments.add_argument("--scenes", nargs="+", default=[], help="only these (all)")
    arguments.add_argument("--spp", type=int, default=64, help="most samples per pixel (%(default)s)")
    args = arguments.parse_args()
    found, rows = begin(), []
    with tempfile.TemporaryDirectory() as name:
        suite = Path(name) / "suite"
        write_suite(suite)
        scenes = {s["name"]: (rt.load(suite / f"{s['name']}.json"), s["samples"]) for s in read_answers(suite)}
        for stage in args.stages:
            images = Path(name) / f"stage-{stage}"
            images.mkdir()
            for scene_name, (scene, samples) in scenes.items():
                if needs(scene) <= stage and (not args.scenes or scene_name in args.scenes):
                    save(images / f"{scene_name}.npz", image_of(scene, stage, min(args.spp, samples)))
            for verdict in judge(suite, images).scenes:
                first = needs(scenes[verdict.name][0])
                if first <= stage and verdict.verdict != "not rendered":
                    rows.append({"stage": stage, "scene": verdict.name, "needs": first, "verdict": verdict.verdict})
            mine = [row for row in rows if row["stage"] == stage]
            passed = sum(row["verdict"] == "passes" for row in mine)
            show(f"stage {stage}: {passed} of {len(mine)} pass")
            for row in mine:
                if row["needs"] == stage or row["verdict"] != "passes":
                    show(f"    {row['scene']}: {row['verdict']}")
    finish(args, found, {"rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
