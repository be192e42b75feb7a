"""Object code on disk: written by the process that compiled it, read by all later ones.

A folder holds what was made from the same sources by the same versions on the same processor: its name is a hash of all
that, so an edit of any kernel source, in whichever file, starts an empty one. A file holds the code of one kernel for
arguments of certain kinds, after a checksum and a header that says what it is. A file that can't be read, is torn, or
is of another kernel, another kind or another folder is not there; where nothing can be written, nothing is kept.
"""

import contextlib
import os
import re
import sys
import time
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np

from raytrace.native.link import Code
from raytrace.native.processor import cpu_features, cpu_name, register_bits

PACKAGE = Path(__file__).parents[1]
SOURCES = "jit.py", "records.py", "native/*.py", "accel/*.py", "passes/*.py"  # what the code of kernels is made from
SUFFIX = ".kernel"
HASH = re.compile("[0-9a-f]{16}")  # name of a folder
DIGEST = 32  # bytes of a checksum
FOLDERS, DAY = 8, 86400.0  # so many folders are left when one is made, and those used in so many seconds


def _version(package: str) -> bytes:
    """What tells a package's version, without importing it, nor the slow `importlib.metadata` where that can be."""
    spec = find_spec(package)
    with contextlib.suppress(OSError):
        if spec and spec.origin:
            return (Path(spec.origin).parent / "_version.py").read_bytes()
    from importlib.metadata import version

    return version(package).encode()


def _ingredients() -> Iterator[bytes]:
    """All that the code of kernels depends on."""
    for path in sorted(path for pattern in SOURCES for path in PACKAGE.glob(pattern)):
        yield path.relative_to(PACKAGE).as_posix().encode()
        yield path.read_bytes()
    yield _version("numba")
    yield _version("llvmlite")
    yield f"{sys.implementation.cache_tag} {sys.platform} {object.__basicsize__} {np.__version__}".encode()
    yield f"{llvm.get_process_triple()} {cpu_name()} {cpu_features()} {register_bits()}".encode()
    yield from (f"{name}={os.environ[name]}".encode() for name in sorted(os.environ) if name.startswith("NUMBA_"))


@cache
def cache_folder() -> Path:
    """Folder of this version's kernels: ``RAYTRACE_CACHE`` or the user's cache, then a hash of all they depend on."""
    content = sha256()
    for part in _ingredients():
        content.update(sha256(part).digest())
    root = os.environ.get("RAYTRACE_CACHE")
    if not root:
        from platformdirs import user_cache_dir

        root = user_cache_dir("raytrace", appauthor=False)
    return Path(root) / content.hexdigest()[:16]


def _title(kernel: str, kinds: str) -> str:
    """What a file says that it holds."""
    return f"raytrace {cache_folder().name} {kernel}({kinds})"


def path_of(kernel: str, kinds: str) -> Path:
    """File of a kernel for arguments of these kinds."""
    digest = sha256(_title(kernel, kinds).encode()).hexdigest()[:16]
    return cache_folder() / f"{kernel.rpartition('.')[2]}-{digest}{SUFFIX}"


def find(kernel: str, kinds: str) -> Code | None:
    """Look for the code of a kernel.

    Parameters
    ----------
    kernel : str
        Its name with its module's. Only those of this package are kept: when others change is not known.
    kinds : str
        Kinds of its arguments.
    """
    touch()
    try:
        content = path_of(kernel, kinds).read_bytes()
    except OSError:
        return None
    checksum, content = content[:DIGEST], content[DIGEST:]
    title, _, content = content.partition(b"\n")
    outside, _, data = content.partition(b"\n")
    whole = sha256(b"\n".join((title, outside, data))).digest() == checksum
    if not whole or title != _title(kernel, kinds).encode():
        return None
    code = Code(tuple(outside.decode().split()), data)
    return None if code.foreign else code


def keep(kernel: str, kinds: str, code: Code) -> bool:
    """Write the code of a kernel, whole or not at all; whether that could be done."""
    if not kernel.startswith("raytrace."):
        return False
    content = b"\n".join((_title(kernel, kinds).encode(), " ".join(code.outside).encode(), code.data))
    return _write(path_of(kernel, kinds), sha256(content).digest() + content)


def can_keep() -> bool:
    """Whether anything can be written."""
    probe = cache_folder() / f".{os.getpid()}.tmp"
    written = _write(probe, b"")
    with contextlib.suppress(OSError):
        probe.unlink()
    return written


def _write(path: Path, content: bytes) -> bool:
    temporary = path.with_name(f".{os.urandom(8).hex()}.tmp")
    try:
        if not path.parent.is_dir():
            path.parent.mkdir(parents=True, exist_ok=True)
            prune(path.parent)
        temporary.write_bytes(content)
        os.replace(temporary, path)  # others see the old file or the new one, never a part
    except OSError:  # nowhere to write, or no room
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        return False
    return True


@cache
def touch() -> None:
    """Mark the folder as in use, once a process."""
    with contextlib.suppress(OSError):
        os.utime(cache_folder())


def prune(newest: Path) -> None:
    """Delete older folders, but for a few and those in use; nothing but what looks like one."""
    from shutil import rmtree

    with contextlib.suppress(OSError):
        folders = {path.parent for path in newest.parent.glob(f"*/*{SUFFIX}") if HASH.fullmatch(path.parent.name)}
        by_age = sorted(folders - {newest}, key=lambda folder: folder.stat().st_mtime, reverse=True)
        for folder in by_age[FOLDERS - 1 :]:
            if time.time() - folder.stat().st_mtime > DAY:
                rmtree(folder, ignore_errors=True)
