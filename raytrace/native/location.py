"""Folder for compiled kernels: ``RAYTRACE_CACHE``, else the user's cache folder, else ``NUMBA_CACHE_DIR``."""

import os
from pathlib import Path

from raytrace.errors import FileError
from raytrace.native import private_files

CURE = "set RAYTRACE_CACHE to a folder that can be written to"


def find_root(name: str) -> Path:
    """Return the folder that contains the folder ``name`` of kernels, or in which it should be made.

    Raises
    ------
    FileError
        There is no such folder.
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
    """Return the user's cache folder for this package; None if there is no home folder."""
    from platformdirs import user_cache_dir

    try:
        folder = Path(user_cache_dir("raytrace", appauthor=False))
    except RuntimeError:  # the user has no entry in the list of users
        return None
    return folder if folder.is_absolute() else None  # older releases of platformdirs leave "~" as it is


def _problem(root: Path, name: str) -> str:
    """Return why the user's cache folder cannot be used; "" if it has kernels or they can be written there."""
    folder = root / name
    if os.access(folder, os.R_OK | os.X_OK) and not private_files.distrust(os.stat(folder)):
        return ""
    existing = private_files.nearest(root)
    if not os.path.isdir(existing):
        return f"{existing} is not a folder"
    if not os.access(existing, os.W_OK | os.X_OK):
        return f"no permission to write in {existing}"
    owner = os.stat(existing).st_uid
    if private_files.POSIX and os.geteuid() == 0 != owner:  # files of root there would lock out the owner
        return f"this process runs as root, {existing} belongs to another user (uid {owner})"
    return ""
