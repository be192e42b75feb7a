"""Facts for a bug report: versions, processor, kernel cache and optional packages."""

import math
import os
import platform
import stat
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import raytrace
from raytrace import cores
from raytrace.errors import FileError

REQUIRED = ("numpy", "numba", "llvmlite", "pillow", "platformdirs", "rich")
OPTIONAL = {
    "OpenEXR": "EXR files",
    "scikit-image": "compare, report",
    "flip-evaluator": "FLIP in compare, report, golden images",
    "matplotlib": "report, rt.show",
}  # package -> what needs it


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _cores() -> str:
    quota = cores.quota()
    limit = f" (CPU quota: {quota:g})" if math.isfinite(quota) else ""
    return f"{cores.usable()} usable of {os.cpu_count()}{limit}"


def _writable(folder: Path) -> bool:
    """Whether a kernel can be written to the folder, or the folder can be created."""
    from raytrace.native.private_files import probe

    return not probe(folder)


def _cache(folder: Path, count: int) -> str:
    """Describe a folder of kernels: mode, owner, and whether it can be used."""
    from raytrace.native import private_files

    mode = ""
    if os.path.isdir(folder):
        status = os.stat(folder)
        mode = f"mode {stat.S_IMODE(status.st_mode):03o}, uid {status.st_uid}, "
        if reason := private_files.distrust(status):
            return f"{mode}NOT used: it {reason}; every process compiles its kernels"
    if not (reason := private_files.probe(folder)):
        return f"{mode}writable"
    if count:
        return f"{mode}read-only: {reason}; every process compiles the kernels that are missing in it"
    return f"{mode}NOT writable: {reason}; every process compiles its kernels"


def _kernels() -> Iterator[tuple[str, str]]:
    try:
        from llvmlite.binding import get_host_cpu_name

        from raytrace.accel.lanes import BITS
        from raytrace.native.store import SUFFIX, cache_folder
    except (ImportError, OSError) as error:  # OSError: a shared library that the system cannot load
        yield "kernels", f"cannot be run: {error}"
        return
    yield "processor", f"{get_host_cpu_name()}, {platform.machine()}"
    yield "lanes", f"{BITS // 32} of float32, {BITS // 64} of float64"
    try:
        folder = cache_folder()
        names = os.listdir(folder) if os.path.isdir(folder) else []
    except FileError as error:
        yield "cache", f"none: {error}"
    except OSError as error:  # no permission to list it
        yield "cache", f"{folder} ({error.strerror})"
    else:
        count = sum(name.endswith(SUFFIX) for name in names)
        yield "cache", f"{folder} ({_cache(folder, count)})"
        yield "kernels", f"{count} compiled"


def findings() -> Iterator[tuple[str, str]]:
    """List the facts for a bug report.

    Yields
    ------
    name, value : str
        One fact.

    Examples
    --------
    >>> dict(findings())["raytrace"] == raytrace.__version__
    True
    """
    yield "raytrace", raytrace.__version__
    yield "python", f"{platform.python_version()} ({sys.executable})"
    yield "system", platform.platform()
    for package in REQUIRED:
        yield package, _version(package) or "NOT installed"
    for package, use in OPTIONAL.items():
        yield package, _version(package) or f"not installed (for {use}: pip install {package})"
    yield "cores", _cores()
    yield from _kernels()
