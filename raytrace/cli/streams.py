"""Standard output and error: text in the encoding of the stream, and nothing where it is closed."""

import contextlib
import errno
import os
import sys
from collections.abc import Mapping
from typing import Any, TextIO

from raytrace.errors import printable

GONE = (errno.EPIPE, errno.EINVAL) if os.name == "nt" else (errno.EPIPE,)  # errors of a pipe without a reader


def prepare() -> None:
    """Make the standard streams usable in a process that was started without them.

    Closed descriptors are connected to the null device. Otherwise, the next file that is opened would get such a
    number, and would receive what a library writes to the stream.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            with contextlib.suppress(OSError):
                os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or getattr(stream, "closed", False):  # None: under pythonw, or if the descriptor was closed
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, open until the process ends


def out(text: str, end: str = "\n") -> None:
    """Print text on stdout; a closed pipe is no error.

    Raises
    ------
    OSError
        The text can't be written, for example on a full disk.
    """
    try:
        sys.stdout.write(_fitting(f"{text}{end}", sys.stdout))
    except OSError as error:
        _unless_gone(error)


def flush() -> None:
    """Flush stdout; raises as `out` does."""
    try:
        sys.stdout.flush()
    except OSError as error:
        _unless_gone(error)


def say(text: str) -> None:
    """Print a message on stderr, if possible."""
    try:
        sys.stderr.write(_fitting(f"{text}\n", sys.stderr))
        sys.stderr.flush()
    except OSError:  # the reader is gone, or the terminal is closed
        discard(sys.stderr)


def discard(stream: TextIO) -> None:
    """Flush a stream; if that fails (full disk, closed pipe), redirect it to the null device."""
    try:
        stream.flush()
    except OSError:
        with contextlib.suppress(OSError):  # a stream without a descriptor
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
            stream.flush()


def json_text(value: Any) -> str:
    """Return a value as one line of JSON; types that JSON does not have become text, inf and NaN become null.

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
    """Escape control characters, and characters that the stream's encoding does not have."""
    text = "\n".join(map(printable, text.split("\n")))
    encoding = getattr(stream, "encoding", None) or "utf-8"
    return text.encode(encoding, "backslashreplace").decode(encoding)
