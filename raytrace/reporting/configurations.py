"""The configurations of the renderer that a report compares."""

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
FEW_SPP = 4, 16, 64  # of configurations that differ only in speed, or are wrong at any number of samples
TEXTBOOK_SPP = 1, 4, 16  # of raytrace.textbook, which is about a thousand times slower
MITSUBA_SPP = 1, 4, 16, 64, 256  # squares, which all its samplers can render
TARGETS = 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001  # target errors of adaptive sampling
ADAPTIVE_CAP = 4096  # limit of its samples per pixel
RENDERS_LEAST, RENDERS_MOST = 6, 8  # renders of a point: six are the fewest that give an interval of the median
RENDERS_SPP = 64  # samples per pixel of all renders of a point together, within these limits
FEW_TRIANGLES = 4096  # scenes up to this size are also rendered without a tree
FAR = 1e3  # "no tree": size of all boxes, relative to the largest coordinate


class Configuration(NamedTuple):
    """Settings of a render, except the number of samples."""

    sampler: str  # "sobol", "stratified" or "independent"
    precision: str  # "float32" or "float64"
    triangle: str = "watertight"  # or "moller-trumbore"
    tree: str = "sah"  # or "median", "none"
    adaptive: bool = False  # adaptive sampling until a target error is reached
    renderer: str = "raytrace"  # or "Mitsuba", "textbook"

    @property
    def selectable(self) -> bool:
        """Whether a user of ``render`` can choose it: rays are traced with the default triangle test and tree."""
        return self.standard and self.renderer == "raytrace"

    @property
    def standard(self) -> bool:
        """Whether it is a way to sample an image: not another triangle test or tree, which change the time only."""
        return (self.triangle, self.tree) == ("watertight", "sah")

    @property
    def name(self) -> str:
        """Name of the configuration in tables.

        >>> Configuration("sobol", "float32", tree="none").name
        'sobol, float32, no tree'
        """
        if self.renderer != "raytrace":
            return f"{self.renderer}, {self.sampler}, {self.precision}"
        extra = [self.triangle] if self.triangle != "watertight" else []
        extra += {"sah": [], "median": ["median split"], "none": ["no tree"]}[self.tree]
        return ", ".join([self.sampler, *(["adaptive"] if self.adaptive else []), self.precision, *extra])


def configurations_of(scene: Scene) -> list[Configuration]:
    """Configurations to compare for a scene; the first is the default."""
    first = make_plan(scene).precision.name
    other = "float64" if first == "float32" else "float32"
    configurations = [Configuration(sampler, first) for sampler in SAMPLERS]
    configurations += [Configuration("sobol", other), Configuration("sobol", first, adaptive=True)]
    configurations += [
        Configuration("sobol", first, triangle="moller-trumbore"),
        Configuration("sobol", first, tree="median"),
    ]
    if len(scene.mesh.faces) <= FEW_TRIANGLES:
        configurations.append(Configuration("sobol", first, tree="none"))
    return configurations


def steps_of(configuration: Configuration) -> tuple[float, ...]:
    """Samples per pixel, or target errors for adaptive sampling, by increasing cost."""
    if configuration.adaptive:
        return TARGETS
    if configuration.renderer == "textbook":
        return TEXTBOOK_SPP
    if configuration.renderer == "Mitsuba":
        return MITSUBA_SPP
    return SPP if configuration.standard else FEW_SPP


def renders_of(configuration: Configuration, step: float) -> int:
    """Renders of a point: 8 where they are short, and 6 from 16 samples per pixel on; two by the textbook.

    They depend on the step alone, not on the speed of the machine, so that errors can be repeated.

    >>> way = Configuration("sobol", "float32")
    >>> [renders_of(way, spp) for spp in (1, 4, 8, 16, 256)]
    [8, 8, 8, 6, 6]
    """
    if configuration.renderer == "textbook":
        return 2
    return int(min(max(RENDERS_SPP // weight_of(configuration, step), RENDERS_LEAST), RENDERS_MOST))


def weight_of(configuration: Configuration, step: float) -> float:
    """Relative amount of work of a step: samples per pixel, or an estimate of them."""
    return max(TARGETS[0] / step, FEW_SPP[0]) if configuration.adaptive else step


class ConfiguredScene:
    """A scene that is rendered in one configuration, with a tree of its own."""

    def __init__(self, scene: Scene, configuration: Configuration, size: tuple[int, int]) -> None:
        self.configuration, self.size = configuration, size
        self.scene = replace(scene)  # a new object, so that it has its own compiled scene
        split = "median" if configuration.tree == "median" else "sah"
        compiled = compile_scene(scene, make_plan(scene), configuration.precision, split, configuration.triangle)
        if configuration.tree == "none":
            for bvh in _trees(compiled):
                _forget_boxes(bvh, _reach(scene))
        set_compiled(self.scene, compiled)
        self.table_bytes = sum(_bytes(bvh) for bvh in _trees(compiled))

    def render(self, step: float, seed: int) -> Render:
        """Render one image; ``step`` is the samples per pixel, or the target error."""
        sampling = {"spp": ADAPTIVE_CAP, "target_error": step} if self.configuration.adaptive else {"spp": int(step)}
        options: dict[str, Any] = {
            "precision": self.configuration.precision,
            "sampler": self.configuration.sampler,
            "progress": False,
        }
        return render(self.scene, size=self.size, seed=seed, **options, **sampling)


def _trees(compiled: CompiledScene) -> list[BVH]:
    return list({id(bvh): bvh for bvh in (compiled.bvh, *compiled.shadow_bvhs)}.values())


def _bytes(bvh: BVH) -> int:
    return int(bvh.tree.nodes.bounds.nbytes + bvh.tree.leaves.rows.nbytes + bvh.triangles.nbytes)


def _reach(scene: Scene) -> float:
    positions = scene.mesh.vertices, scene.camera.position, scene.lights.position
    return FAR * max(1.0, *(float(np.abs(position).max(initial=0.0)) for position in positions))


def _forget_boxes(bvh: BVH, reach: float) -> None:
    """Enlarge all boxes so that every ray hits every box: then each ray is tested against all triangles."""
    bvh.tree = unbundled(bvh.tree)  # a frustum would cull triangles
    boxes, used = boxes_of(bvh.tree.nodes), children_of(bvh.tree.nodes)[:, None, :] != 0
    for rows, plane in ((slice(0, 3), -reach), (slice(3, 6), reach)):
        boxes[:, rows] = np.where(used, plane, boxes[:, rows])
