"""The option ``--set``: scenes with other values."""

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from typing import TYPE_CHECKING

import raytrace

if TYPE_CHECKING:
    from raytrace.scene.changes import Change


def change(word: str) -> "Change":
    """Parse a change of a scene.

    >>> change("camera.fov=30").path
    ('camera', 'fov')
    """
    from raytrace.scene.changes import parse_change

    try:
        return parse_change(word)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None


def set_option(parser: ArgumentParser) -> None:
    """Declare ``--set``."""
    text = "change a value of the scene, such as camera.fov=30 or lights[0].flux=[9,9,9]; repeatable"
    parser.add_argument(
        "--set", dest="changes", action="append", type=change, default=[], metavar="KEY=VALUE", help=text
    )


def load_scene(args: Namespace) -> "raytrace.Scene":
    """Load the scene of a command, with its changes."""
    if not args.changes:
        return raytrace.load(args.scene, args.root, args.max_memory)
    from raytrace.scene.changes import load_changed

    return load_changed(args.scene, args.changes, args.root, args.max_memory)


def load_demo(args: Namespace) -> "raytrace.Scene":
    """Load the demo, with its changes."""
    if not args.changes:
        return raytrace.demo()
    from raytrace.scene.changes import with_changes

    return with_changes(raytrace.demo(), args.changes)
