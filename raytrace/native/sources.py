"""Read the sources of kernels, from a folder, a zip file or a frozen program."""

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from raytrace.errors import FileError

MODULES, FOLDERS = ("jit", "records"), ("native", "accel", "passes")  # the machine code of kernels depends on these


def read(package: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the path and the content of every source that the machine code of kernels depends on.

    Raises
    ------
    FileError
        They cannot be read, for example where only compiled modules are installed; then old machine code of other
        sources could not be recognised.
    """
    if (package / "jit.py").is_file():
        patterns = [f"{name}.py" for name in MODULES] + [f"{folder}/*.py" for folder in FOLDERS]
        for path in sorted(path for pattern in patterns for path in package.glob(pattern)):
            yield path.relative_to(package).as_posix(), path.read_bytes()
    else:
        yield from _from_loaders()


def _from_loaders() -> Iterator[tuple[str, bytes]]:
    import pkgutil  # not needed where there is a folder

    names = [f"raytrace.{name}" for name in MODULES]
    for folder in (f"raytrace.{name}" for name in FOLDERS):
        spec = find_spec(folder)
        places = spec.submodule_search_locations if spec else None
        inside = [f"{folder}.{found.name}" for found in pkgutil.iter_modules(places or [])]
        names += [folder, *inside]
    for name in sorted(names):
        text = _source(name)
        if not text:
            break
        yield name, text.encode()
    else:
        if {name for name in sys.modules if name.startswith("raytrace.native.")} <= {*names}:
            return
    raise FileError("their sources, which identify their machine code, cannot be read (a frozen program?)")


def _source(name: str) -> str | None:
    spec = find_spec(name)
    read = getattr(spec and spec.loader, "get_source", None)
    try:
        return read(name) if read else None
    except (ImportError, OSError):
        return None
