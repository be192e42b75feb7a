"""Store of object code on disk: the process that compiles a kernel writes it, all later processes read it.

A folder holds the code of one set of sources, versions and processor. Its name is a hash of all of them, so an edit of
any kernel source starts an empty folder. A file holds the code of one kernel for arguments of certain kinds, after a
checksum and a header with its title. A file is ignored if it cannot be read, is corrupt, has another title, or may have
been written by another user. Where nothing can be written, nothing is kept, and one line says so.
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

from raytrace.errors import FileError
from raytrace.native import location, private_files, sources
from raytrace.native.link import Code
from raytrace.native.processor import cpu_features, cpu_name, register_bits

PACKAGE = Path(__file__).parents[1]
SUFFIX = ".kernel"
HASH = re.compile("[0-9a-f]{16}")  # name of a folder
DIGEST = 32  # bytes of a checksum
FOLDERS, DAY = 8, 86400.0  # number of folders that are kept, and seconds for which a used folder is kept in any case
VARIABLES = (  # of Numba's, those that change the machine code of kernels   [numba/core/config.py]
    *("BOUNDSCHECK", "CPU_FEATURES", "CPU_NAME", "DEBUGINFO", "DISABLE_INTEL_SVML", "ENABLE_AVX", "ENABLE_PROFILING"),
    *("EXTEND_VARIABLE_LIFETIMES", "LLVM_REFPRUNE_FLAGS", "LLVM_REFPRUNE_PASS", "LOOP_VECTORIZE", "OPT"),
    *("SLP_VECTORIZE", "USE_LEGACY_TYPE_SYSTEM"),
)
CONFIG = ".numba_config.yaml"  # in the current folder: may set them too


def _version(package: str) -> bytes:
    """Bytes that identify the version of a package, without an import of it or of the slow `importlib.metadata`."""
    spec = find_spec(package)
    with contextlib.suppress(OSError):
        if spec and spec.origin:
            return (Path(spec.origin).parent / "_version.py").read_bytes()
    from importlib.metadata import version

    return version(package).encode()


def _ingredients() -> Iterator[bytes]:
    """Yield everything that the code of kernels depends on."""
    for name, content in sources.read(PACKAGE):
        yield name.encode()
        yield content
    yield _version("numba")
    yield _version("llvmlite")
    yield f"{sys.implementation.cache_tag} {sys.platform} {object.__basicsize__} {np.__version__}".encode()
    yield f"{llvm.get_process_triple()} {cpu_name()} {cpu_features()} {register_bits()}".encode()
    yield from (f"{name}={os.environ[f'NUMBA_{name}']}".encode() for name in VARIABLES if f"NUMBA_{name}" in os.environ)
    with contextlib.suppress(OSError):
        if os.path.isfile(CONFIG):
            yield Path(CONFIG).read_bytes()


def _key() -> str:
    """Name of the folder: a hash of everything that the code of kernels depends on."""
    content = sha256()
    for part in _ingredients():
        content.update(sha256(part).digest())
    return content.hexdigest()[:16]


@cache
def cache_folder() -> Path:
    """Folder of this version's kernels.

    Raises
    ------
    FileError
        There is no place for them, or their sources cannot be read.
    """
    name = _key()
    return location.find_root(name) / name


def _title(kernel: str, kinds: str) -> str:
    """Title in the header of a file."""
    return f"raytrace {cache_folder().name} {kernel}({kinds})"


def path_of(kernel: str, kinds: str) -> Path:
    """Path of the file of a kernel for arguments of these kinds."""
    digest = sha256(_title(kernel, kinds).encode()).hexdigest()[:16]
    return cache_folder() / f"{kernel.rpartition('.')[2]}-{digest}{SUFFIX}"


def find(kernel: str, kinds: str) -> Code | None:
    """Return the code of a kernel if the store has it.

    Parameters
    ----------
    kernel : str
        Its name with the name of its module. Only kernels of this package are stored: changes of others go unnoticed.
    kinds : str
        Kinds of its arguments.
    """
    try:
        touch()
        content = private_files.read(path_of(kernel, kinds))
    except private_files.Untrusted as error:
        _say(f"{error}: it is compiled again" if error.path.suffix == SUFFIX else _unkept(error))
        return None
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
    """Write the code of a kernel, whole or not at all; return whether it was written, and log why not."""
    if not kernel.startswith("raytrace."):
        return False
    try:
        content = b"\n".join((_title(kernel, kinds).encode(), " ".join(code.outside).encode(), code.data))
        path = path_of(kernel, kinds)
        _make_folder(path.parent)
        private_files.write(path, sha256(content).digest() + content)
    except OSError as error:
        _say(_unkept(error))
        return False
    return True


def can_keep() -> bool:
    """Make the folder of kernels; return whether they can be written there."""
    try:
        folder = cache_folder()
        _make_folder(folder)
        return not private_files.distrust(os.stat(folder)) and not private_files.probe(folder)
    except OSError:
        return False


def _unkept(error: OSError) -> str:
    """Message for the case that kernels cannot be stored."""
    reason = str(error)
    if not isinstance(error, FileError):
        trusted = not isinstance(error, private_files.Untrusted)
        reason = f"{f'{cache_folder()}: {error.strerror}' if trusted else error}; {location.CURE}"
    return f"every process compiles its kernels: {reason}"


@cache
def _say(line: str) -> None:
    """Log a warning, once per process; by default it appears on stderr."""
    import logging

    logging.getLogger("raytrace").warning(line)


def _make_folder(folder: Path) -> None:
    above = private_files.nearest(folder)
    if private_files.make_folder(folder):
        if private_files.POSIX and os.geteuid() == 0 != os.stat(above).st_uid:
            _say(f"{folder}: belongs to root, so other users can't read or write the kernels in it")
        prune(folder)


@cache
def touch() -> None:
    """Mark the folder as used now, once per process."""
    with contextlib.suppress(OSError):
        os.utime(cache_folder())


def prune(newest: Path) -> None:
    """Delete older folders of kernels, except the newest few and those used within a day."""
    from shutil import rmtree

    with contextlib.suppress(OSError):
        folders = {path.parent for path in newest.parent.glob(f"*/*{SUFFIX}") if HASH.fullmatch(path.parent.name)}
        by_age = sorted(folders - {newest}, key=lambda folder: folder.stat().st_mtime, reverse=True)
        for folder in by_age[FOLDERS - 1 :]:
            if time.time() - folder.stat().st_mtime > DAY and not private_files.distrust(folder.stat()):
                rmtree(folder, ignore_errors=True)
