"""Standard output and error: text in whatever encoding they have, and nothing where they are closed."""

import contextlib
import errno
import os
import sys
from collections.abc import Mapping
from typing import Any, TextIO

from raytrace.errors import printable

GONE = (errno.EPIPE, errno.EINVAL) if os.name == "nt" else (errno.EPIPE,)  # errors of a pipe that nobody reads


def prepare() -> None:
    """Make the standard streams usable where this process was started without them.

    The numbers of closed streams are taken by the null device: the next file that is opened would get them, and what a
    library writes to them.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            with contextlib.suppress(OSError):
                os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or getattr(stream, "closed", False):  # None: of pythonw, and where the descriptor was closed
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, as long as the process


def out(text: str, end: str = "\n") -> None:
    """Print text on stdout; a reader that has gone is no failure.

    Raises
    ------
    OSError
        It can't be written, as on a full disk.
    """
    try:
        sys.stdout.write(_fitting(f"{text}{end}", sys.stdout))
    except OSError as error:
        _unless_gone(error)


def flush() -> None:
    """Write what stdout holds; raises as `out` does."""
    try:
        sys.stdout.flush()
    except OSError as error:
        _unless_gone(error)


def say(text: str) -> None:
    """Print a message on stderr, if it can be written."""
    try:
        sys.stderr.write(_fitting(f"{text}\n", sys.stderr))
        sys.stderr.flush()
    except OSError:  # the reader has gone, or the terminal is closed
        discard(sys.stderr)


def discard(stream: TextIO) -> None:
    """Flush; what a full disk or a reader that has gone does not take, goes nowhere."""
    try:
        stream.flush()
    except OSError:
        with contextlib.suppress(OSError):  # a stream without a descriptor
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
            stream.flush()


def json_text(value: Any) -> str:
    """Write a value as one line of JSON; what JSON lacks as text, inf and NaN as null.

    Examples
    --------
    >>> json_text({"rays": 8, "error": float("inf")})
    '{"rays": 8, "error": null}'
    """
    import json
    import math

    def plain(value: Any) -> Any:
        value = value.tolist() if hasattr(value, "tolist") else value  # NumPy's numbers and arrays
        if isinstance(value, Mapping):
            return {str(key): plain(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [plain(item) for item in value]
        if isinstance(value, float) and not math.isfinite(value):
            return None  # JSON has neither inf nor NaN
        return value if isinstance(value, str | int | float | None) else str(value)

    return json.dumps(plain(value))


def _unless_gone(error: OSError) -> None:
    if error.errno not in GONE:
        raise error
    discard(sys.stdout)


def _fitting(text: str, stream: TextIO) -> str:
    """Escape what a terminal would obey, and what the stream's encoding lacks."""
    text = "\n".join(map(printable, text.split("\n")))
    encoding = getattr(stream, "encoding", None) or "utf-8"
    return text.encode(encoding, "backslashreplace").decode(encoding)
