"""A picture handed over: written where it was wanted, or where that can be done; and what is said of it."""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from raytrace.errors import FileError
from raytrace.rendering.checkpoint import SUFFIX, Checkpoint
from raytrace.rendering.progress import Progress, speed
from raytrace.rendering.result import Render, state_of

if TYPE_CHECKING:
    from distributed import Client

NOTED = 0.01  # seconds of compilation that are worth saying


def checkpoint_of(path: Path, resume: bool, say: Callable[[str], None]) -> Checkpoint:
    """What keeps finished parts of a picture: a file beside it."""
    return Checkpoint(path.with_name(path.name + SUFFIX), resume, say)


@contextlib.contextmanager
def connected(address: str | None) -> Iterator["Client | None"]:
    """A client of the scheduler at an address, as long as it is needed; None where there is no address."""
    if address is None:
        yield None
        return
    from raytrace.rendering.cluster import connect

    with connect(address) as client:
        yield client


def place_of(image: Render, path: Path) -> Path:
    """Where a picture is to be written: an incomplete one goes beside a file that is there.

    Parameters
    ----------
    image : Render
    path : Path
        Where it is wanted.
    """
    if image.complete or not os.path.lexists(path):
        return path
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def deliver(image: Render, path: Path, exposure: float) -> tuple[Path, str]:
    """Write a picture; where it lies now, and what went wrong, if anything did.

    What could be written when the render began may be full, gone or read-only by now. Then the picture goes to a new
    folder for temporary files, in the home folder, or in the current one, whichever can be written first.

    Raises
    ------
    FileError
        It can be written nowhere.
    """
    try:
        return image.save(path, exposure=exposure), ""
    except FileError as error:
        failure = error
    for folder in (tempfile.gettempdir, Path.home, Path.cwd):
        with contextlib.suppress(OSError, RuntimeError):  # a FileError is an OSError; no home is a RuntimeError
            elsewhere = Path(tempfile.mkdtemp(prefix="raytrace-", dir=folder()))
            try:
                written = image.save(elsewhere / path.name, exposure=exposure)
            except FileError:
                os.rmdir(elsewhere)
                continue
            return written, f"{failure}; the picture is in {written}"
    raise FileError(f"{failure}; nor anywhere else{_kept(image, '; --resume goes on from {}')}")


def nothing(image: Render) -> str:
    """What is said where no pass over the image was completed."""
    return f"{state_of(image)}; nothing was saved{_kept(image, '; --resume goes on from {}')}"


def remarks(image: Render, last: Progress | None, seconds: float, target: float | None) -> Iterator[str]:
    """What is worth saying of a picture.

    Parameters
    ----------
    image : Render
    last : Progress or None
        The newest of its drawing.
    seconds : float
        That it took.
    target : float or None
        Error that was wanted.
    """
    if not image.complete:
        yield f"{state_of(image)}{_kept(image, '; --resume goes on from {}')}"
    if image.complete and target is not None and image.stats["target_reached"] is False:
        yield f"target error {target:g} not reached with {image.provenance['spp']} samples a pixel"
    if last:
        error = image.stats["estimated_error"]
        known = f"estimated error {error:.2g}" if error == error else "error unknown"  # of one sample a pixel
        compiling = image.stats["compile_seconds"]
        apart = f" ({compiling:.2f} s of it compiling, {last.seconds:.2f} s rendering)" if compiling >= NOTED else ""
        yield f"{seconds:.2f} s{apart}, {speed(last)}, {known}"


def _kept(image: Render, words: str) -> str:
    """Words with the place of a checkpoint in them; none where there is none."""
    return words.format(image.checkpoint.path) if image.checkpoint and image.checkpoint.kept else ""
