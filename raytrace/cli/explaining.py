"""The command ``explain``: what scenes need; with options of ``render``, what that render would do."""

from argparse import Namespace
from collections.abc import Callable
from typing import TYPE_CHECKING

import raytrace
from raytrace.cli import streams
from raytrace.cli.arguments import RENDER_OPTIONS
from raytrace.cli.failures import DONE
from raytrace.cli.scenes import each_scene
from raytrace.errors import printable

if TYPE_CHECKING:
    from raytrace.records import Scene

Load = Callable[[Namespace], "Scene"]


def explain_scenes(args: Namespace, load: Load) -> int:
    """Explain scenes; return the exit code."""
    several = len(args.scenes) > 1
    return each_scene(args, lambda args: _explain(args, load, several))


def _explain(args: Namespace, load: Load, several: bool) -> int:
    given = {key: value for key in RENDER_OPTIONS if (value := getattr(args, key)) not in (None, ())}
    scene = load(args)
    if several:
        streams.out(printable(f"{args.scene}:"))
    if given.keys() <= {"integrator", "max_memory"}:
        given.pop("max_memory", None)
        streams.out(str(raytrace.explain(scene, **given)))
    else:
        from raytrace.rendering.forecast import forecast

        streams.out(str(forecast(scene, **given)))
    return DONE
