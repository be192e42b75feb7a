"""Memory: how much is free, how much a scene and its image need, and a check before it is allocated.

The numbers were measured. ``tests/bench/memory.py`` repeats the measurement and compares.
"""

import contextlib
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from raytrace.errors import MemoryLimitError

PROC, CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")
# files of a control group with its limit and its use of memory: version 2, version 1   [cgroups]
GROUPS = (
    ("", "memory.max", "memory.current", "inactive_file"),
    ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)

READING = {".obj": 3, ".ply": 7, ".stl": 3, ".glb": 6}  # bytes of memory to read one byte of a file
READING_OTHER = 20  # of any other format, decompressed
READING_ATTRIBUTES = {"uv": 2, "color": 4}  # more, of any format, where a material needs them
TEXT = {".obj": (3, 85), ".ply": (3, 57), ".stl": (3, 52)}  # to read one byte of a text file, and one word of it
CORNERS, VERTEX = 24, 24  # bytes of three indices, and of a point
JOINED, SMOOTH = 36, 72  # bytes of a triangle in a scene, and of its shading normals
ATTRIBUTES = {"uv": 48, "color": 72}  # bytes of those of the corners of a triangle
JOINING, AVERAGING = 175, 390  # bytes per triangle of the largest object while they are made
# bytes per triangle, by bytes of a float: a tree with divided triangles, and its build; others need a sixth less
TREE, BUILDING = {4: 122, 8: 300}, {4: 250, 8: 535}
PIXEL, BIN, LAYERS, SEARCH = 94, 24, 58, 112  # bytes per pixel: film and image; a bin; layers; adaptive sampling
SAMPLE, REFRACTED, SHADOW = 26, 18, 16  # floats per sample in flight: always, with refraction, with lights
LIGHT, LIGHTS = 144, 12  # bytes per pixel and floats per sample in flight, of light layers
PATH = 69  # floats per sample in flight, of path tracing
RAY = 160  # bytes per ray of ``radiance``: origin, direction, both rounded, result; see tests/test_given_rays.py
FIXED = 2**25  # bytes: code and threads
KEPT = 31 << 20  # bytes: of larger blocks, glibc does not take notice


@cache
def keep_freed() -> None:
    """Let the C library keep memory that an image frees, up to 62 MiB, for the next image.

    glibc returns freed memory to the system where it is more than twice the largest block that it has taken from the
    system by itself and returned (mallopt(3), M_MMAP_THRESHOLD). So such a block is taken here, never touched, and
    returned. The 2,500 new pages of an image of 256 x 256 pixels take as long as the image.
    """
    from numpy import empty  # not at once: other commands do without NumPy

    with contextlib.suppress(MemoryError):
        empty(KEPT, "u1")


# What is free --------------------------------------------------------------------------------------------------------


def resident() -> int:
    """Return the bytes of memory that this process uses; 0 if unknown."""
    with contextlib.suppress(OSError):
        return int((PROC / "self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    with contextlib.suppress(ImportError):
        import psutil

        return psutil.Process().memory_info().rss
    return 0


def free() -> float:
    """Return the bytes that this process can still allocate, by the machine, its container and its own limit."""
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
    """Return the bytes that ``ulimit -v`` leaves."""
    with contextlib.suppress(ImportError, OSError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            return float(limit - int((PROC / "self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE"))
    return float("inf")


def _groups() -> Iterator[float]:
    """Yield the bytes that each control group of this process leaves to it."""
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
    """Yield the bytes that one group leaves: its limit minus its use, without reclaimable file caches."""
    with contextlib.suppress(OSError, ValueError):  # "max": no limit
        most, used = int((folder / limit).read_text()), int((folder / usage).read_text())
        for line in (folder / "memory.stat").read_text().splitlines():
            if line.startswith(f"{reclaimable} "):
                used -= int(line.split()[1])
        yield float(most - used)


class Allowance:
    """Memory that may be allocated from now on.

    Parameters
    ----------
    max_memory : int, bytes, optional
        Limit of the whole process. Default: what it uses now plus what is free.
    """

    def __init__(self, max_memory: int | None = None) -> None:
        self._whose = "are free" if max_memory is None else "are allowed"
        self.left = free() if max_memory is None else float(max(max_memory - resident(), 0))

    def lacks(self, needed: float, cure: str) -> str:
        """Return a message about missing memory, with the cure; "" if there is enough."""
        if needed <= self.left:
            return ""
        more = "allow more by --max-memory (max_memory=)"
        if self.left <= 0:
            return f"takes about {size(needed)} of memory, and the process has already reached its memory limit; {more}"
        return f"takes about {size(needed)} of memory, {size(self.left)} {self._whose}; {cure}, or {more}"


def size(number: float) -> str:
    """Return a number of bytes as text.

    >>> size(5e9), size(3e6)
    ('4.7 GiB', '3 MiB')
    """
    return f"{number / 2**30:.1f} GiB" if number >= 2**30 else f"{number / 2**20:.0f} MiB"


# What is needed -----------------------------------------------------------------------------------------------------


def of_reading(kind: str, length: int, words: int | None = None, attributes: frozenset[str] = frozenset()) -> float:
    """Return the bytes of memory to read a mesh file of ``length`` bytes; attributes: "uv", "color" or both.

    For a text file, ``words`` is its number of words. If that is None (unknown), the result is a lower bound.
    """
    more = sum(READING_ATTRIBUTES[key] for key in attributes) * length
    if words is None:
        return READING.get(kind, READING_OTHER) * length + more
    each, word = TEXT[kind]
    return each * length + word * words + more


def of_corners(attributes: frozenset[str]) -> int:
    """Return the bytes per triangle of uv and colours."""
    return sum(ATTRIBUTES[key] for key in attributes)


class Joining(NamedTuple):
    """Sizes that decide the memory to place meshes and join them."""

    triangles: int = 0
    vertices: int = 0
    passing: int = 0  # temporary bytes: for the triangles of the largest object
    smooth: bool = False  # whether there are shading normals
    attributes: frozenset[str] = frozenset()  # that any object has: "uv", "color"

    def with_object(
        self, triangles: int, vertices: int, smoothness: int, attributes: frozenset[str] = frozenset()
    ) -> "Joining":
        """Return the sizes with one more object; smoothness 0: flat; 1: normals of the file; 2: averaged normals."""
        passing = triangles * (AVERAGING if smoothness == 2 else JOINING)
        return Joining(
            self.triangles + triangles,
            self.vertices + vertices,
            max(self.passing, passing),
            self.smooth or smoothness > 0,
            self.attributes | attributes,
        )

    def total(self) -> float:
        """Return the largest number of bytes in use at once."""
        corners = of_corners(self.attributes)
        placed = (CORNERS + corners) * self.triangles + VERTEX * self.vertices
        joined = (JOINED + SMOOTH * self.smooth + corners) * self.triangles + VERTEX * self.vertices
        return float(placed + joined + self.passing)


class Trees(NamedTuple):
    """Sizes that decide the memory of the trees of a scene."""

    triangles: int  # 0: the trees are built already
    trees: int
    width: int  # bytes of a float
    refraction: bool
    lights: bool
    paths: bool = False  # whether the passes of path tracing run
    textures: int = 0  # bytes

    def built(self) -> float:
        """Return the bytes of all trees, and of textures."""
        return float(TREE[self.width] * self.triangles * self.trees + self.textures)

    def building(self) -> float:
        """Return the largest number of bytes while they are built, one after the other."""
        return self.built() + (BUILDING[self.width] - TREE[self.width]) * self.triangles


class RenderSize(NamedTuple):
    """Sizes that decide the memory of an image and its samples."""

    pixels: int
    layers: bool  # whether any are requested
    search: bool  # whether there is a target error
    bins: int  # used bins per pixel: as many as samples, up to four
    batch: int  # samples in flight, on all threads
    light: bool = False  # whether emission, direct and indirect light are kept

    def film(self) -> float:
        """Return the bytes of the film and of the image."""
        kept = LAYERS * self.layers + SEARCH * self.search + LIGHT * self.light
        return float(self.pixels * (PIXEL + BIN * self.bins + kept))

    def samples(self, trees: Trees) -> float:
        """Return the bytes of the samples in flight."""
        numbers = PATH if trees.paths else SAMPLE + REFRACTED * trees.refraction + SHADOW * trees.lights
        return float(self.batch * trees.width * (numbers + LIGHTS * self.light))

    def total(self, trees: Trees) -> float:
        """Return the largest number of bytes in use at once."""
        return FIXED + max(trees.building(), trees.built() + self.film() + self.samples(trees))


def check_render(render: RenderSize, trees: Trees, max_memory: int | None) -> None:
    """Raise an error if an image needs more memory than is free.

    Raises
    ------
    MemoryLimitError
        The message says what to reduce.
    """
    building, film = trees.building(), render.film()
    cures = {
        "take a smaller film by --size (size=), or a part by --crop (crop=)": film,
        "simplify the meshes, or take --precision float32": building,
        "take fewer --threads (threads=)": render.samples(trees),
    }
    if lacks := Allowance(max_memory).lacks(render.total(trees), max(cures, key=cures.__getitem__)):
        parts = f"{size(film)} for {render.pixels:,} pixels, {size(building)} for {trees.triangles:,} triangles"
        parts += f" and textures of {size(trees.textures)}" * bool(trees.textures)
        raise MemoryLimitError(f"memory: the image, with {parts}, {lacks}")


def check_radiance(rays: int, batch: int, trees: Trees) -> None:
    """Raise an error if there is no memory to measure the light along rays; batch: samples in flight, on all threads.

    Raises
    ------
    MemoryLimitError
        The message says what to reduce.
    """
    given = float(RAY * rays)
    needed = FIXED + max(trees.building(), trees.built() + given + batch * trees.width * PATH)
    cure = "divide the rays" if given > trees.building() else "simplify the meshes"
    if lacks := Allowance().lacks(needed, cure):
        parts = f"{size(given)} for {rays:,} rays, {size(trees.building())} for {trees.triangles:,} triangles"
        raise MemoryLimitError(f"memory: radiance, with {parts}, {lacks.partition(', or ')[0]}")


def check_tree(triangles: int, width: int) -> None:
    """Raise an error if there is no memory for one more tree; width: bytes of a float.

    Raises
    ------
    MemoryLimitError
        The message says what to change in the scene.
    """
    if lacks := Allowance().lacks(BUILDING[width] * triangles, "move lights off the surfaces that they lie on"):
        raise MemoryLimitError(
            f"memory: one more tree, for a light that lies on a surface, {lacks.partition(', or ')[0]}"
        )
