"""Scenes on their stages: kept as long as a scene lives, so that it is built once."""

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from raytrace.memory import Trees
from raytrace.records import Scene
from raytrace.rendering.wavefront import CompiledScene, compile_scene
from raytrace.scene.path_plan import needs_paths
from raytrace.scene.plan import Plan, make_plan

if TYPE_CHECKING:
    from raytrace.rendering.path_scene import PathScene

_paths: WeakKeyDictionary[Scene, dict[tuple[str, str], "PathScene"]] = WeakKeyDictionary()  # precision, integrator
_stages: WeakKeyDictionary[Scene, dict[str, CompiledScene]] = WeakKeyDictionary()  # by precision


def set_compiled(scene: Scene, stage: CompiledScene) -> None:
    """Draw a scene on this stage from now on, in the stage's precision."""
    _stages.setdefault(scene, {})[stage.bvh.precision] = stage


def plan_of(scene: Scene) -> Plan:
    """The plan of a scene; a stage that it is drawn on knows it."""
    for stage in _stages.get(scene, {}).values():
        return stage.plan
    return make_plan(scene)


def is_built(scene: Scene, precision: str) -> bool:
    """Whether there is a stage that a scene is drawn on."""
    return precision in _stages.get(scene, {})


def compiled_of(scene: Scene, plan: Plan, precision: str) -> CompiledScene:
    """The stage that a scene is drawn on, built if it isn't there yet."""
    stages = _stages.setdefault(scene, {})
    if precision not in stages:
        stages[precision] = compile_scene(scene, plan, precision)
    return stages[precision]


def paths_of(scene: Scene, compiled: CompiledScene, integrator: str) -> "PathScene | None":
    """Tables of path tracing for a compiled scene; None where it does not need them."""
    if not needs_paths(scene, integrator):
        return None
    from raytrace.rendering.path_scene import make_path_scene

    known = _paths.setdefault(scene, {})
    key = compiled.bvh.precision, integrator
    if key not in known:
        known[key] = make_path_scene(scene, compiled.bvh, integrator)
    return known[key]


def trees_of(scene: Scene, plan: Plan, precision: str) -> Trees:
    """What the memory of a scene that is drawn depends on."""
    triangles = 0 if is_built(scene, precision) else len(scene.mesh.faces)
    width = 4 if precision == "float32" else 8
    return Trees(triangles, 1 + plan.transparent, width, plan.refraction, plan.lights > 0)
