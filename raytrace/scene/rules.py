"""Rules about single values of the scene format that JSON Schema cannot express."""

from collections.abc import Sequence
from typing import Any

from raytrace.limits import MAX_PIXELS, MAX_SIDE
from raytrace.scene.attributes import FROM_FILE
from raytrace.scene.problems import quote

LAMP = '; an area light is an object whose diffuse material has "emission"'
MEANT = {  # types that people expect, and what they are here
    "glass": '; real glass is "dielectric"',
    "metal": '; a metal is "conductor"',
    "area": LAMP,
    "emissive": LAMP,
    "emitter": LAMP,
    "light": LAMP,
    "constant": '; light from everywhere is "environment"',
    "distant": '; parallel light is "directional"',
}

Row = tuple[float, float, float, float]
Factors = tuple[float, float, float]


def check_film(size: tuple[int, int]) -> tuple[int, int]:
    """Return the size of a film, or refuse one that is too large."""
    width, height = size
    if max(size) > MAX_SIDE or width * height > MAX_PIXELS:
        limits = f"a side has at most {MAX_SIDE} pixels and a film at most {MAX_PIXELS}"
        raise ValueError(f"a film of {width} x {height} pixels is too large; {limits}")
    return size


def scale_factors(scale: float | Factors) -> Factors:
    """Return the factors of the three axes, also where one number stands for all; refuse 0."""
    factors = scale if isinstance(scale, tuple) else (scale, scale, scale)
    if 0 in factors:
        raise ValueError("a scale of 0 leaves no surface; use a number other than 0 for each axis")
    return factors


def list_rotations(rotate: Any) -> list[Any]:
    """Return the rotations of an object as a list: empty for none, of one entry where one stands alone."""
    if rotate is None:
        return []
    return rotate if isinstance(rotate, list) else [rotate]


def rotation_fault(rotate: Any) -> str:
    """Say what form rotations have, where numbers stand in their place; "" for objects.

    Examples
    --------
    >>> rotation_fault([90, 0, 0]).partition("; ")[2]
    'here {"axis": [1, 0, 0], "angle": 90}'
    """
    entries = rotate if isinstance(rotate, list) else [rotate]
    if rotate is None or all(isinstance(entry, dict) for entry in entries):
        return ""
    got, example = quote(rotate), ""
    if isinstance(rotate, list) and all(type(entry) in (int, float) for entry in rotate):
        got = f"{len(rotate)} numbers"
        turned = [axis for axis, angle in enumerate(rotate) if angle]
        if len(rotate) == 3 and len(turned) == 1:  # the order of several is not known
            axis = [int(axis == turned[0]) for axis in range(3)]
            example = f'; here {{"axis": {axis}, "angle": {rotate[turned[0]]}}}'
    return f'expected {{"axis": [x, y, z], "angle": degrees}}, or a list of them, got {got}{example}'


def material_name(material: Any) -> Any:
    """Return the name of an object's material; ``FROM_FILE`` for those of its file."""
    return material if isinstance(material, str) else FROM_FILE


def check_matrix(matrix: tuple[Row, Row, Row, Row]) -> tuple[Row, Row, Row, Row]:
    """Return a matrix, or refuse one that is not affine or has no inverse."""
    if matrix[3] != (0, 0, 0, 1):
        raise ValueError("expected 0, 0, 0, 1 in the last row; a translation stands in the last column")
    if determinant_sign(matrix[:3]) == 0:
        raise ValueError("the determinant of the matrix is 0, which leaves no volume; use a matrix with an inverse")
    return matrix


def determinant_sign(rows: Sequence[Sequence[float]]) -> int:
    """Return the exact sign, -1, 0 or 1, of the determinant of the first three columns of three rows.

    Examples
    --------
    >>> determinant_sign([[1e-200, 0, 0], [0, 1e-200, 0], [0, 0, -1e-200]])
    -1
    """
    from fractions import Fraction  # few scenes have a matrix

    a, b, c = ([Fraction(float(number)) for number in row[:3]] for row in rows)
    cross = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
    determinant = sum(x * y for x, y in zip(a, cross, strict=True))
    return (determinant > 0) - (determinant < 0)
