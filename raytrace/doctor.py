"""What this machine offers: versions, processor, kernel cache and optional packages."""

import os
import platform
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import raytrace

REQUIRED = ("numpy", "numba", "llvmlite", "pydantic", "pillow", "platformdirs", "rich")
OPTIONAL = {"OpenEXR": "EXR files", "scikit-image": "compare, report", "matplotlib": "report, rt.show"}  # what for


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _cores() -> str:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{usable} usable of {os.cpu_count()}"


def _writable(folder: Path) -> bool:
    """Whether the folder can be written to, or made."""
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    return existing.is_dir() and os.access(existing, os.W_OK)


def _kernels() -> Iterator[tuple[str, str]]:
    try:
        from llvmlite.binding import get_host_cpu_name

        from raytrace.accel.lanes import BITS
        from raytrace.native.store import SUFFIX, cache_folder
    except (ImportError, OSError) as error:  # OSError: a shared library that the system cannot load
        yield "kernels", f"cannot be run: {error}"
        return
    folder = cache_folder()
    yield "processor", f"{get_host_cpu_name()}, {platform.machine()}"
    yield "lanes", f"{BITS // 32} of float32, {BITS // 64} of float64"
    yield "cache", f"{folder} ({'writable' if _writable(folder) else 'NOT writable: every process compiles anew'})"
    yield "kernels", f"{len(list(folder.glob(f'*{SUFFIX}')))} compiled"


def findings() -> Iterator[tuple[str, str]]:
    """List what matters for a bug report.

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
