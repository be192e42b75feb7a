"""The exposure of an image that the command line writes, and hints about an image that is badly exposed."""

from collections.abc import Callable
from pathlib import Path

from raytrace.image.exposure import AUTO, auto_exposure, hint
from raytrace.rendering.result import Render


def shown(image: Render, path: Path, asked: float | str, say: Callable[[str], None]) -> float:
    """Return the exposure of an image in stops; print one that was chosen, or a hint where the image needs one.

    Parameters
    ----------
    image : Render
    path : Path
        The file it goes to: only a PNG has an exposure.
    asked : float or "auto"
    say : callable
        Prints a line.
    """
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
