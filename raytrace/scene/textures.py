"""Textures of the materials of a scene: reads their images, and checks their values."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError, SceneError
from raytrace.image.texels import decode_texels, read_texels, srgb_table, suffix_of_content
from raytrace.limits import MAX_TEXELS
from raytrace.records import Materials, Mesh
from raytrace.scene.attributes import TEXTURED
from raytrace.scene.files import Reach, locate_image
from raytrace.scene.problems import Problem, file_problem
from raytrace.texture_records import ATTRIBUTE, BILINEAR, CHECKERBOARD, NEAREST, Texture, Textures

EMISSION = "emission"  # the key of the texture that is not a reflectance
NOTHING = np.zeros(3)
NO_IMAGES: Mapping[str, Any] = MappingProxyType({})


class Found(NamedTuple):
    """Textures as they are read, and what is wrong with them."""

    textures: Textures | None
    problems: list[Problem]
    warnings: list[Problem]
    means: Materials | None = None  # the materials of the scene; where a texture replaces a colour, with its mean

    def finished(self, materials: dict[str, Any], table: Materials, mesh: Mesh) -> "Found":
        """Return the same with vertex colours, of a joined mesh; materials: as they are read, and as a table."""
        if self.textures is None:
            return self._replace(means=table)
        textures, problems = finish_textures(self.textures, materials, mesh)
        return Found(textures, problems, self.warnings, with_means(table, textures))


class Place(NamedTuple):
    """Where a material names a texture."""

    row: int  # of the materials
    path: tuple[str, ...]  # in the scene: "materials", name, key
    texture: SimpleNamespace  # as the format reads it

    @property
    def emits(self) -> bool:
        """Whether it is that of the emission."""
        return self.path[-1] == EMISSION


def places_of(materials: dict[str, Any]) -> Iterator[Place]:
    """Yield the textures that materials name."""
    for row, (name, material) in enumerate(materials.items()):
        for key in TEXTURED:
            value = getattr(material, key, None)
            if isinstance(value, SimpleNamespace):
                yield Place(row, ("materials", name, key), value)


def read_textures(
    materials: dict[str, Any], used: Iterable[str], reach: Reach, given: Mapping[str, Any] = NO_IMAGES
) -> Found:
    """Read the textures of a scene.

    Parameters
    ----------
    materials : dict
        Name -> material, as the format reads it.
    used : iterable of str
        Materials that objects have; of the others, images must exist, and are not read.
    reach : Reach
        The folders that may be read, and the memory that may be used.
    given : mapping of str to GivenImage, optional
        Images that are not files of their own, by the names that textures have for them.
    """
    reader, used = _Reader(reach, given), set(used)
    rows = {key: np.full(len(materials), -1, np.int32) for key in (False, True)}
    for place in places_of(materials):
        if place.path[1] not in used:
            reader.locate(place)
        elif (texture := reader.read(place)) is not None:
            rows[place.emits][place.row] = len(reader.made)
            reader.made.append(texture)
    textures = Textures(tuple(reader.made), rows[False], rows[True]) if reader.made else None
    return Found(textures, reader.problems, reader.warnings)


class _Reader:
    """Reads textures, each image once."""

    def __init__(self, reach: Reach, given: Mapping[str, Any]) -> None:
        self._given = given
        self.made: list[Texture] = []
        self.problems: list[Problem] = []
        self.warnings: list[Problem] = []
        self._reach, self._images, self._texels = reach, dict[tuple[str, bool], NDArray[Any] | None](), 0

    def read(self, place: Place) -> Texture | None:
        """Return a texture; None, and a problem, where it is wrong."""
        given = place.texture
        if given.attribute is not None:
            return Texture(ATTRIBUTE, np.zeros((0, 0, 3)), None, (1.0, 1.0), NOTHING)
        if given.checkerboard is not None:
            colours = np.array(given.checkerboard)
            return Texture(CHECKERBOARD, colours[None], None, given.scale, colours.mean(axis=0))
        srgb = is_srgb(given.image, given.encoding)
        path = (*place.path, "image")
        try:
            codes = self._image(given.image, srgb, path)
            if codes is None:
                return None
            check_values(codes, place.emits, f"{given.image}: ", "texels")
        except (SceneError, FileError, ValueError) as error:
            self.problems.append(file_problem(path, error))
            return None
        if given.image in self._given:
            return tinted_texture(codes, self._given[given.image].factor, given.filter == "nearest", given.scale)
        return image_texture(codes, srgb, given.filter == "nearest", given.scale)

    def locate(self, place: Place) -> None:
        """Check that the image of a texture exists."""
        if place.texture.image is not None:
            try:
                locate_image(self._reach.find(place.texture.image))
            except (SceneError, FileError) as error:
                self.problems.append(file_problem((*place.path, "image"), error))

    def _image(self, name: str, srgb: bool, path: tuple[str, ...]) -> NDArray[Any] | None:
        """Codes of an image file; None if it was read before, and is broken."""
        if (name, srgb) not in self._images:
            self._images[name, srgb] = None
            if name in self._given:
                data = self._given[name].image.data
                texels = decode_texels(data, suffix_of_content(data), srgb, name, self._reach.max_memory)
            else:
                file = self._reach.find(name)
                locate_image(file)
                texels = read_texels(file, srgb, self._reach.max_memory)
            self._texels += texels.codes.size // 3
            if self._texels > MAX_TEXELS:
                raise SceneError([f"with this image the textures have {self._texels:,} texels; at most {MAX_TEXELS:,}"])
            if texels.warning:
                self.warnings.append(Problem(path, f"{name}: {texels.warning}"))
            self._images[name, srgb] = np.ascontiguousarray(texels.codes[::-1])
        return self._images[name, srgb]


def is_srgb(name: str, encoding: str | None) -> bool:
    """Whether the numbers of an image are sRGB codes."""
    return encoding == "srgb" or (encoding is None and Path(name).suffix.lower() != ".exr")


def image_texture(codes: NDArray[Any], srgb: bool, nearest: bool, scale: tuple[float, float]) -> Texture:
    """Return the texture of an image; codes: (h, w, 3) u1, u2 or f4, row 0 at the bottom."""
    kind, channels = NEAREST if nearest else BILINEAR, codes.reshape(-1, 3).T
    if codes.dtype.kind == "f":
        means = [float(channel[0]) + (channel - channel[0]).mean(dtype=np.float64) for channel in channels]
        mean = np.array(means)
        return Texture(kind, codes, None, scale, mean)
    bits = 8 * codes.itemsize
    table = srgb_table(bits) if srgb else np.arange(2**bits) / (2**bits - 1)
    counts = [np.bincount(channel, minlength=len(table)) for channel in channels]
    first = table[codes[0, 0]]  # the mean of equal values is this very value
    mean = first + [(count * (table - start)).sum() / count.sum() for start, count in zip(first, counts, strict=True)]
    return Texture(kind, codes, table, scale, mean)


def tinted_texture(
    codes: NDArray[Any], factor: tuple[float, ...], nearest: bool, scale: tuple[float, float]
) -> Texture:
    """Return the texture of an image of sRGB codes whose linear colours are multiplied by a factor."""
    if factor == (1.0, 1.0, 1.0):
        return image_texture(codes, True, nearest, scale)
    table = srgb_table(8 * codes.itemsize)[:, None] * factor
    linear = np.stack([table[:, k].astype(np.float32)[codes[..., k]] for k in range(3)], axis=-1)
    return image_texture(linear, False, nearest, scale)


def check_values(colours: NDArray[Any], emits: bool, name: str, noun: str) -> None:
    """Raise a ValueError that counts the values (..., 3) that are out of range; codes of whole numbers are in it."""
    if colours.dtype.kind != "f":
        return
    with np.errstate(invalid="ignore"):
        inside = (colours >= 0) & (colours < np.inf if emits else colours <= 1)
    wrong = int(np.count_nonzero(~inside.all(axis=-1)))
    if wrong:
        allowed = "negative or not finite" if emits else "outside 0 to 1"
        numbers = colours[~np.isnan(colours)]
        some = " without NaN" if numbers.size < colours.size else ""
        found = f"; the values{some} are {numbers.min():.6g} to {numbers.max():.6g}" if numbers.size else ", all NaN"
        raise ValueError(f"{name}{wrong:,} of {colours.size // 3:,} {noun} are {allowed}{found}")


def finish_textures(textures: Textures, materials: dict[str, Any], mesh: Mesh) -> tuple[Textures, list[Problem]]:
    """Return textures with the means of vertex colours, which are checked, in a joined mesh."""
    made, problems = list(textures.table), list[Problem]()
    for place in places_of(materials):
        number = (textures.emission if place.emits else textures.reflectance)[place.row]
        if number < 0 or made[number].kind != ATTRIBUTE or mesh.colors is None:
            continue
        colours = mesh.colors[mesh.material_id == place.row].reshape(-1, 3)
        try:
            check_values(colours, place.emits, "vertex colours: ", "corners of triangles")
        except ValueError as error:
            problems.append(Problem(place.path, str(error)))
        made[number] = made[number]._replace(mean=colours[0] + (colours - colours[0]).mean(axis=0))
    return textures._replace(table=tuple(made)), problems


def with_means(materials: Materials, textures: Textures) -> Materials:
    """Return materials that have the means of textures, where a texture replaces a colour."""
    albedo = materials.albedo.copy()
    emission = np.zeros_like(albedo) if materials.emission is None else materials.emission.copy()
    for rows, table in ((textures.reflectance, albedo), (textures.emission, emission)):
        for row in np.flatnonzero(rows >= 0):
            table[row] = textures.table[rows[row]].mean
    return materials._replace(albedo=albedo, emission=emission if emission.any() else None)
