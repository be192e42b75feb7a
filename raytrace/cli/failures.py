"""Exit codes, and what is said of each exception."""

import os
import sys
from argparse import ArgumentError

from raytrace.cli import streams
from raytrace.cli.terminal import INTERRUPTED
from raytrace.errors import RaytraceError, printable

DONE, INTERNAL, USAGE, FILE, DIFFERENT = 0, 1, 2, 4, 5  # 3, an invalid scene, is SceneError.exit_code


def failed(error: BaseException, scene: str = "") -> int:
    """Print the message of an exception, and return its exit code.

    Parameters
    ----------
    error : Exception or KeyboardInterrupt
        An exception that is no mistake of the user is raised again where RAYTRACE_DEBUG is set.
    scene : str
        Of several scenes, the one it is about: messages that do not name it begin with it.
    """
    code, message = _outcome(error)
    if code == INTERNAL and os.environ.get("RAYTRACE_DEBUG"):
        raise error
    prefix = "" if not scene or message.startswith(scene) else f"{scene}: "
    streams.say(prefix + message)
    return code


def _outcome(error: BaseException) -> tuple[int, str]:
    """Exit code and message of an exception."""
    if isinstance(error, RaytraceError):
        return error.exit_code, str(error)
    if isinstance(error, MemoryError):  # the estimate of free memory was too high
        return USAGE, "memory: not enough; use a smaller image (--size), smaller meshes, or fewer --threads"
    if isinstance(error, ArgumentError):
        return USAGE, f"raytrace: error: {printable(error)}"
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED, "interrupted; nothing was saved"
    if isinstance(error, OSError):
        streams.discard(sys.stdout)
        return FILE, printable(f"{error.filename or 'output'}: {error.strerror or error}")
    what = printable(f"{type(error).__name__}: {error}")
    return INTERNAL, f"internal failure: {what}; please report it (RAYTRACE_DEBUG=1 shows where)"
