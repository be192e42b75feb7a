"""Records of textures. Comments give shape, dtype, unit and meaning of each field."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

BILINEAR, NEAREST, CHECKERBOARD, ATTRIBUTE = range(4)  # Texture.kind


class Texture(NamedTuple):
    """A colour that varies over a surface."""

    kind: int  # BILINEAR or NEAREST: an image; CHECKERBOARD; ATTRIBUTE: vertex colours
    codes: NDArray[Any]  # (h, w, 3) u1, u2 or f4, row 0 at the bottom; a checkerboard's colours, (1, 2, 3) f8; or empty
    table: NDArray[np.float64] | None  # (256,) or (65536,) f8: linear value of each code; None: codes are values
    scale: tuple[float, float]  # factors of u and v
    mean: NDArray[np.float64]  # (3,) f8: over the image, or over all corners of the triangles that have it

    def values(self, out: NDArray[Any]) -> None:
        """Write linear colours, (h * w, 3), rounded once to the type of the array."""
        codes = self.codes.reshape(-1, 3)
        if self.table is None:
            out[:] = codes
        else:
            np.take(self.table.astype(out.dtype), codes, out=out, mode="clip")


class Textures(NamedTuple):
    """Textures of the materials of a scene."""

    table: tuple[Texture, ...]
    reflectance: NDArray[np.int32]  # (k,) i4: the texture of the albedo or reflectance of each material; -1: none
    emission: NDArray[np.int32]  # (k,) i4: that of its emission; -1: none


class FileImage(NamedTuple):
    """An image inside a mesh file."""

    name: str  # for messages
    data: bytes  # a whole PNG or JPEG file


class FileMaterial(NamedTuple):
    """A material of a mesh file, as far as it is read."""

    name: str
    base_color: tuple[float, ...]  # linear RGB, 0 to 1: times the image, or the vertex colours, where there are any
    image: FileImage | None  # sRGB; needs uv
    colors: bool  # whether the mesh has vertex colours, which are multiplied by the base colour already
    metallic: float  # 0 to 1
    roughness: float  # 0 to 1
    metal_image: FileImage | None  # linear: roughness (green) and metallic (blue) are multiplied by it
    two_sided: bool = False
    nearest: bool = False  # whether the image is not interpolated
    left_out: tuple[str, ...] = ()  # what the file has, and is not read


class EnvironmentImage(NamedTuple):
    """A latitude-longitude image as an environment, y up."""

    texture: Texture  # linear radiance
    scale: float  # factor of its radiance
    turn: NDArray[np.float64]  # (3, 3) f8: rotation from the image to the world
