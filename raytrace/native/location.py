"""Where the user's kernels are kept: ``RAYTRACE_CACHE``, else the user's cache folder, else ``NUMBA_CACHE_DIR``."""

import os
from pathlib import Path

from raytrace.errors import FileError
from raytrace.native import private_files

CURE = "set RAYTRACE_CACHE to a folder that can be written to"


def find_root(name: str) -> Path:
    """Return the folder in which the folder ``name`` of kernels lies or is to be made.

    Raises
    ------
    FileError
        There is none.
    """
    chosen = os.environ.get("RAYTRACE_CACHE")
    if chosen:
        return _absolute("RAYTRACE_CACHE", chosen)
    user = _user_folder()
    if user and not _problem(user, name):
        return user
    shared = os.environ.get("NUMBA_CACHE_DIR")
    if shared:
        return _absolute("NUMBA_CACHE_DIR", shared) / "raytrace"
    if user is None:
        raise FileError(f"there is no home folder to keep them in; {CURE}")
    raise FileError(f"{user}: {_problem(user, name)}; {CURE}")


def _absolute(variable: str, value: str) -> Path:
    try:
        return Path(value).expanduser().absolute()
    except RuntimeError:
        raise FileError(f"{variable}={value}: there is no such home folder; {CURE}") from None


def _user_folder() -> Path | None:
    """The user's cache folder for this package; None: there is no home folder."""
    from platformdirs import user_cache_dir

    try:
        folder = Path(user_cache_dir("raytrace", appauthor=False))
    except RuntimeError:  # the user has no entry in the list of users
        return None
    return folder if folder.is_absolute() else None  # older releases of platformdirs leave "~" as it is


def _problem(root: Path, name: str) -> str:
    """Why the user's cache folder is of no use; "" if it holds kernels already or they can be kept there."""
    folder = root / name
    if os.access(folder, os.R_OK | os.X_OK) and not private_files.distrust(os.stat(folder)):
        return ""
    existing = private_files.nearest(root)
    if not os.path.isdir(existing):
        return f"{existing} is not a folder"
    if not os.access(existing, os.W_OK | os.X_OK):
        return f"no permission to write in {existing}"
    owner = os.stat(existing).st_uid
    if private_files.POSIX and os.geteuid() == 0 != owner:  # what root makes there would lock its owner out
        return f"this process runs as root, {existing} belongs to another user (uid {owner})"
    return ""
