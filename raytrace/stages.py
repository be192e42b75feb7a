"""Scenes on their stages: kept as long as a scene lives, so that it is built once."""

from weakref import WeakKeyDictionary

from raytrace.memory import Trees
from raytrace.records import Scene
from raytrace.scene.plan import Plan
from raytrace.wavefront import Stage, make_stage

_stages: WeakKeyDictionary[Scene, dict[str, Stage]] = WeakKeyDictionary()  # by precision


def set_stage(scene: Scene, stage: Stage) -> None:
    """Draw a scene on this stage from now on, in the stage's precision."""
    _stages.setdefault(scene, {})[stage.bvh.precision] = stage


def is_built(scene: Scene, precision: str) -> bool:
    """Whether there is a stage that a scene is drawn on."""
    return precision in _stages.get(scene, {})


def stage_of(scene: Scene, plan: Plan, precision: str) -> Stage:
    """The stage that a scene is drawn on, built if it isn't there yet."""
    stages = _stages.setdefault(scene, {})
    if precision not in stages:
        stages[precision] = make_stage(scene, plan, precision)
    return stages[precision]


def trees_of(scene: Scene, plan: Plan, precision: str) -> Trees:
    """What memory the stage of a scene depends on."""
    triangles = 0 if is_built(scene, precision) else len(scene.mesh.faces) * (1 + plan.transparent)
    return Trees(triangles, 4 if precision == "float32" else 8, plan.refraction, plan.lights > 0)
