"""The exposure of an image that the command line writes, and what is probably wrong with a dark or bright image."""

from argparse import ArgumentTypeError
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from raytrace.records import Scene
    from raytrace.rendering.result import Render

AUTO, MAX_STOPS = "auto", 100.0  # as in raytrace.image.exposure, which imports NumPy


def exposure(text: str) -> float | str:
    """Parse an exposure: a number of stops, or ``auto``.

    >>> exposure("auto"), exposure("-1.5")
    ('auto', -1.5)
    """
    if text == AUTO:
        return text
    try:
        stops = float(text)
    except ValueError:
        stops = float("nan")
    if not abs(stops) <= MAX_STOPS:
        expected = f"expected auto or a number from {-MAX_STOPS:g} to {MAX_STOPS:g}"
        raise ArgumentTypeError(f"{expected}, got '{text}'")
    return stops


def shown(scene: "Scene", image: "Render", path: Path, asked: float | str, say: Callable[[str], None]) -> float:
    """Return the exposure of an image in stops; print one that was chosen, or what is probably wrong with the image.

    Parameters
    ----------
    scene : Scene
    image : Render
    path : Path
        The file it goes to: only a PNG has an exposure.
    asked : float or "auto"
    say : callable
        Prints a line.
    """
    from raytrace.image.exposure import auto_exposure, hint
    from raytrace.scene.seen_backs import back_warnings_of

    for line in back_warnings_of(scene, image):
        say(f"warning: {line}")
    png = path.suffix.lower() == ".png"
    stops = float(asked) if asked != AUTO else auto_exposure(image.rgb) if png else 0.0
    if asked == AUTO:
        say(
            f"exposure: {stops:+.2f} stops"
            if png
            else f"exposure: none; a {path.suffix} file stores the radiance itself"
        )
    if png and (text := hint(image.rgb, stops)):
        say(f"hint: {text}")
    return stops
