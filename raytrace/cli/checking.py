"""The command ``check``: problems and warnings of scenes, as text or as JSON."""

from argparse import Namespace
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import raytrace
from raytrace.cli import streams
from raytrace.cli.failures import DONE
from raytrace.cli.scenes import each_scene
from raytrace.errors import FileError, SceneError, printable

if TYPE_CHECKING:
    from raytrace.records import Scene

Load = Callable[[Namespace], "Scene"]
VERSION = 1  # of the JSON; docs/command-line.md describes it


def check_scenes(args: Namespace, load: Load) -> int:
    """Check scenes without rendering them; return the exit code.

    Raises
    ------
    RaytraceError
        What is wrong with a single scene, unless it is printed as JSON.
    """
    if not args.json:
        return each_scene(args, lambda args: _check(args, load), done="ok")
    checked: list[dict[str, Any]] = []
    code = each_scene(args, lambda args: _check_as_json(args, load, checked), done="ok")
    ok = len(checked) == len(args.scenes) and all(one["ok"] for one in checked)
    streams.out(streams.json_text({"version": VERSION, "ok": ok, "scenes": checked}))
    return code


def _check(args: Namespace, load: Load) -> int:
    for warning in _warnings(args, load):
        streams.out(f"warning: {warning}")
    streams.out(f"{printable(args.scene)}: ok")
    return DONE


def _warnings(args: Namespace, load: Load) -> tuple[str, ...]:
    from raytrace.scene.seen_backs import back_warnings

    scene = load(args)
    raytrace.explain(scene)  # an error if no precision can represent the scene
    return (*scene.warnings, *back_warnings(scene))


def _check_as_json(args: Namespace, load: Load, checked: list[dict[str, Any]]) -> int:
    """Append what is found in one scene; return its exit code."""
    lines: list[tuple[str, str]] = []
    code = DONE
    try:
        lines += [("warning", line) for line in _warnings(args, load)]
    except (SceneError, FileError) as error:
        code = error.exit_code
        lines += [("error", line) for line in error.problems or str(error).split("\n")]
    from raytrace.scene.problem_lines import parts_of

    file = printable(args.scene)
    problems = [{"severity": severity} | parts_of(line, file)._asdict() for severity, line in lines]
    checked.append({"scene": file, "ok": code == DONE, "problems": problems})
    return code
