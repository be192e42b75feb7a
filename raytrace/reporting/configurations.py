"""The ways of drawing a scene that the report on speed and error compares."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from raytrace.accel.bundle import unbundled
from raytrace.accel.bvh import BVH
from raytrace.accel.layout import boxes_of, children_of
from raytrace.records import Scene
from raytrace.rendering.compiled_scene import CompiledScene, compile_scene, set_compiled
from raytrace.rendering.rendering import render
from raytrace.rendering.result import Render
from raytrace.scene.plan import make_plan

SAMPLERS = "sobol", "stratified", "independent"
SPP = tuple(1 << k for k in range(9))  # 1 .. 256 samples per pixel
FEW_SPP = 4, 16, 64  # of the ways that differ in speed alone, or are wrong at any number
TARGETS = 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001  # errors that adaptive sampling is asked for
ADAPTIVE_CAP = 4096  # most samples per pixel that it may take
FEW_TRIANGLES = 4096  # up to so many are tested without a tree as well
FAR = 1e3  # boxes of a tree that tells nothing: so many times the largest coordinate


class Configuration(NamedTuple):
    """One way of drawing, at any number of samples."""

    sampler: str  # "sobol", "stratified" or "independent"
    precision: str  # "float32" or "float64"
    triangle: str = "watertight"  # or "moller-trumbore"
    tree: str = "sah"  # or "median", "none"
    adaptive: bool = False  # samples go where the error is, until a target is reached

    @property
    def usual(self) -> bool:
        """Whether rays are traced as they always are: only such ways can be chosen when a scene is drawn."""
        return (self.triangle, self.tree) == ("watertight", "sah")

    @property
    def name(self) -> str:
        """What to call it in tables.

        >>> Way("sobol", "float32", tree="none").name
        'sobol, float32, no tree'
        """
        extra = [self.triangle] if self.triangle != "watertight" else []
        extra += {"sah": [], "median": ["median split"], "none": ["no tree"]}[self.tree]
        return ", ".join([self.sampler, *(["adaptive"] if self.adaptive else []), self.precision, *extra])


def ways_of(scene: Scene) -> list[Configuration]:
    """Ways that make sense for a scene; the first is how it is drawn by default."""
    first = make_plan(scene).precision.name
    other = "float64" if first == "float32" else "float32"
    ways = [Configuration(sampler, first) for sampler in SAMPLERS]
    ways += [Configuration("sobol", other), Configuration("sobol", first, adaptive=True)]
    ways += [Configuration("sobol", first, triangle="moller-trumbore"), Configuration("sobol", first, tree="median")]
    if len(scene.mesh.faces) <= FEW_TRIANGLES:
        ways.append(Configuration("sobol", first, tree="none"))
    return ways


def steps_of(way: Configuration) -> tuple[float, ...]:
    """Samples per pixel, or errors that adaptive sampling aims at, from cheap to dear."""
    if way.adaptive:
        return TARGETS
    return SPP if way.usual else FEW_SPP


def weight_of(way: Configuration, step: float) -> float:
    """How much work a step is, beside others: samples per pixel, or a guess of them."""
    return max(TARGETS[0] / step, FEW_SPP[0]) if way.adaptive else step


class Subject:
    """A scene that is drawn in one of the ways, on a tree of its own."""

    def __init__(self, scene: Scene, way: Configuration, size: tuple[int, int]) -> None:
        self.way, self.size = way, size
        self.scene = replace(scene)  # another object, so that its stage is another one
        split = "median" if way.tree == "median" else "sah"
        stage = compile_scene(scene, make_plan(scene), way.precision, split, way.triangle)
        if way.tree == "none":
            for bvh in _trees(stage):
                _forget_boxes(bvh, _reach(scene))
        set_compiled(self.scene, stage)
        self.table_bytes = sum(_bytes(bvh) for bvh in _trees(stage))

    def draw(self, step: float, seed: int) -> Render:
        """Draw one picture."""
        aim = {"spp": ADAPTIVE_CAP, "target_error": step} if self.way.adaptive else {"spp": int(step)}
        how: dict[str, Any] = {"precision": self.way.precision, "sampler": self.way.sampler, "progress": False}
        return render(self.scene, size=self.size, seed=seed, **how, **aim)


def _trees(stage: CompiledScene) -> list[BVH]:
    return list({id(bvh): bvh for bvh in (stage.bvh, *stage.shadow_bvhs)}.values())


def _bytes(bvh: BVH) -> int:
    return int(bvh.tree.nodes.bounds.nbytes + bvh.tree.leaves.rows.nbytes + bvh.triangles.nbytes)


def _reach(scene: Scene) -> float:
    places = scene.mesh.vertices, scene.camera.position, scene.lights.position
    return FAR * max(1.0, *(float(np.abs(place).max(initial=0.0)) for place in places))


def _forget_boxes(bvh: BVH, reach: float) -> None:
    """Widen all boxes until every ray meets every one: then each ray is tested against all triangles."""
    bvh.tree = unbundled(bvh.tree)  # a frustum would leave out triangles
    boxes, used = boxes_of(bvh.tree.nodes), children_of(bvh.tree.nodes)[:, None, :] != 0
    for rows, plane in ((slice(0, 3), -reach), (slice(3, 6), reach)):
        boxes[:, rows] = np.where(used, plane, boxes[:, rows])
