"""Memory: what there is, what a scene and its picture take, and whether it will do: asked before any of it is taken.

What things take was measured: ``tests/bench/memory.py`` does it again and compares.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from raytrace.errors import MemoryLimitError

PROC, CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")
# where a group of processes says what it may take, and takes: version 2, version 1   [cgroups]
GROUPS = (
    ("", "memory.max", "memory.current", "inactive_file"),
    ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)

READING = {".obj": 3, ".ply": 7, ".stl": 3, ".glb": 6}  # bytes to read a byte of a file
READING_OTHER = 20  # of every other format, unpacked
TEXT = {".obj": (3, 85), ".ply": (3, 57), ".stl": (3, 52)}  # and a byte of a text, and a word of it
CORNERS, VERTEX = 24, 24  # of three indices, and of a point
JOINED, SMOOTH = 36, 72  # of a triangle in a scene, and of its shading normals
JOINING, AVERAGING = 175, 390  # while that is made: of the triangles of the largest object
TREE, BUILDING = {4: 105, 8: 260}, {4: 215, 8: 460}  # of a triangle by bytes of a number: a tree, and while it is built
PIXEL, BIN, LAYERS, SEARCH = 82, 24, 58, 112  # of a pixel: film and picture; a bin; layers; a wanted error
SAMPLE, REFRACTED, SHADOW = 26, 18, 16  # numbers of a sample in flight: always, if it may be refracted, of each light
FIXED = 2**25  # bytes: code and threads


# What there is --------------------------------------------------------------------------------------------------------


def resident() -> int:
    """Bytes of memory that this process takes; 0: not known."""
    with contextlib.suppress(OSError):
        return int((PROC / "self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    with contextlib.suppress(ImportError):
        import psutil

        return psutil.Process().memory_info().rss
    return 0


def free() -> float:
    """Bytes of memory that this process may take yet: of the machine, of its container, of its own limit."""
    return max(min(_machine(), _address_space(), *_groups()), 0.0)


def _machine() -> float:
    with contextlib.suppress(OSError):
        for line in (PROC / "meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024.0
    with contextlib.suppress(ImportError):
        import psutil

        return float(psutil.virtual_memory().available)
    return float("inf")


def _address_space() -> float:
    """What ``ulimit -v`` leaves."""
    with contextlib.suppress(ImportError, OSError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            return float(limit - int((PROC / "self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE"))
    return float("inf")


def _groups() -> Iterator[float]:
    """What each group that this process is in leaves to it."""
    yield float("inf")
    with contextlib.suppress(OSError):
        for line in (PROC / "self/cgroup").read_text().splitlines():
            number, kinds, path = line.split(":", 2)
            if number == "0" or "memory" in kinds.split(","):
                folder, *names = GROUPS[number != "0"]
                within = Path(path.lstrip("/"))
                for group in (within, *within.parents):
                    yield from _group(CGROUPS / folder / group, *names)


def _group(folder: Path, limit: str, usage: str, reclaimable: str) -> Iterator[float]:
    """What one group leaves: its limit less what is in use, but for files that are only kept in case."""
    with contextlib.suppress(OSError, ValueError):  # "max": no limit
        most, used = int((folder / limit).read_text()), int((folder / usage).read_text())
        for line in (folder / "memory.stat").read_text().splitlines():
            if line.startswith(f"{reclaimable} "):
                used -= int(line.split()[1])
        yield float(most - used)


class Allowance:
    """What may be taken from now on.

    Parameters
    ----------
    max_memory : int, bytes, optional
        What the process may take in all. Default: what is free now, with what it has.
    """

    def __init__(self, max_memory: int | None = None) -> None:
        self._whose = "are free" if max_memory is None else "are allowed"
        self.left = free() if max_memory is None else float(max(max_memory - resident(), 0))

    def lacks(self, needed: float, cure: str) -> str:
        """Words for what is lacking, and the cure; "" where there is enough."""
        if needed <= self.left:
            return ""
        more = "allow more by --max-memory (max_memory=)"
        if self.left <= 0:
            return f"takes about {size(needed)} of memory, and the process has all that it may have already; {more}"
        return f"takes about {size(needed)} of memory, {size(self.left)} {self._whose}; {cure}, or {more}"


def size(number: float) -> str:
    """Write a number of bytes for people.

    >>> size(5e9), size(3e6)
    ('4.7 GiB', '3 MiB')
    """
    return f"{number / 2**30:.1f} GiB" if number >= 2**30 else f"{number / 2**20:.0f} MiB"


# What things take -----------------------------------------------------------------------------------------------------


def of_reading(kind: str, length: int, words: int | None = None) -> float:
    """Bytes to read a mesh file of so many bytes; a text of so many words; None: not known yet, at least."""
    if words is None:
        return READING.get(kind, READING_OTHER) * length
    each, word = TEXT[kind]
    return each * length + word * words


class Joining(NamedTuple):
    """What the memory to put meshes in place and join them depends on."""

    triangles: int = 0
    vertices: int = 0
    passing: int = 0  # bytes for a while: of the triangles of the largest object
    smooth: bool = False  # whether there are shading normals

    def with_object(self, triangles: int, vertices: int, smoothness: int) -> "Joining":
        """One object more; its smoothness: 0: flat; 1: the file has its normals; 2: they are averages."""
        passing = triangles * (AVERAGING if smoothness == 2 else JOINING)
        return Joining(
            self.triangles + triangles,
            self.vertices + vertices,
            max(self.passing, passing),
            self.smooth or smoothness > 0,
        )

    def total(self) -> float:
        """Bytes at most at a time."""
        placed = CORNERS * self.triangles + VERTEX * self.vertices
        joined = (JOINED + SMOOTH * self.smooth) * self.triangles + VERTEX * self.vertices
        return float(placed + joined + self.passing)


class Trees(NamedTuple):
    """What the memory of a scene that is drawn depends on."""

    triangles: int  # 0: the trees are there
    trees: int
    width: int  # bytes of a number
    refraction: bool
    lights: bool

    def built(self) -> float:
        """Bytes of all trees."""
        return float(TREE[self.width] * self.triangles * self.trees)

    def building(self) -> float:
        """Bytes at most while they are built, one after the other."""
        return self.built() + (BUILDING[self.width] - TREE[self.width]) * self.triangles


class RenderSize(NamedTuple):
    """What the memory of a picture depends on."""

    pixels: int
    layers: bool  # whether any are asked for
    search: bool  # whether an error is wanted
    bins: int  # of a pixel that are used: as many as samples, up to four
    batch: int  # samples in flight, on all threads

    def film(self) -> float:
        """Bytes of the film, and of the picture that is made of it."""
        return float(self.pixels * (PIXEL + BIN * self.bins + LAYERS * self.layers + SEARCH * self.search))

    def samples(self, trees: Trees) -> float:
        """Bytes of the samples in flight."""
        numbers = SAMPLE + REFRACTED * trees.refraction + SHADOW * trees.lights
        return float(self.batch * trees.width * numbers)

    def total(self, trees: Trees) -> float:
        """Bytes at most at a time."""
        return FIXED + max(trees.building(), trees.built() + self.film() + self.samples(trees))


def check_render(render: RenderSize, trees: Trees, max_memory: int | None) -> None:
    """Refuse a picture that takes more memory than there is.

    Raises
    ------
    MemoryLimitError
        What to lower.
    """
    building, film = trees.building(), render.film()
    cures = {
        "take a smaller film by --size (size=), or a part by --crop (crop=)": film,
        "simplify the meshes, or take --precision float32": building,
        "take fewer --threads (threads=)": render.samples(trees),
    }
    if lacks := Allowance(max_memory).lacks(render.total(trees), max(cures, key=cures.__getitem__)):
        parts = f"{size(film)} for {render.pixels:,} pixels, {size(building)} for {trees.triangles:,} triangles"
        raise MemoryLimitError(f"memory: the picture, with {parts}, {lacks}")


def check_tree(triangles: int, width: int) -> None:
    """Refuse one more tree for which there is no memory; width: bytes of a number.

    Raises
    ------
    MemoryLimitError
        What to change in the scene.
    """
    if lacks := Allowance().lacks(BUILDING[width] * triangles, "move lights off the surfaces that they lie on"):
        raise MemoryLimitError(
            f"memory: one more tree, for a light that lies on a surface, {lacks.partition(', or ')[0]}"
        )
