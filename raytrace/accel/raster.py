"""Recognise a list of rays as an image, row by row, so that its rays are traced in blocks of pixels.

The rays of a pixel and of the one below are nearly the same. So the width of the image is where the list comes back to
its beginning. A wrong guess costs time only: the results do not depend on the order of tracing.
"""

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.batches import image_width
from raytrace.accel.inputs import Field, Pieces
from raytrace.accel.lanes import group_size, packet_width
from raytrace.accel.layout import NODE_SIZE
from raytrace.records import Columns, Tree

LEAST = 1 << 18  # rays: in shorter lists, the search can take longer than it saves
LEAST_IN_ROWS = 1 << 17  # rays: the same of the search for rows of any length
SAMPLES = 96  # places where rows of any length are searched for
GOLDEN = 0.6180339887498949  # its multiples, less their whole parts, are spread evenly
STEADY = 5.0  # most times that the rays of a bundle are farther apart than those of a quarter; in a straight row 4
STRAIGHT = 0.72  # share of the bundles that must be straight rows
WIDE = 3.0  # sides of a usual leaf: rows are sorted where neighbours of a bundle are farther apart
NODES = 16  # least nodes of a tree
WIDTHS = 16, 4096  # least and largest width
STEP = 8  # pixels in a row that are farther apart than a pixel and the one below
PLACES = 0, 1, 2  # quarters of the list where that is tested


def width_of_list(tree: Tree, fields: list[Field], n: int, limit: int) -> int:
    """Return the width of the image whose rays a list seems to hold, row by row, or 0.

    Parameters
    ----------
    tree : Tree
        What the rays are traced in. In a small one, rows are as fast as blocks.
    fields : list of Field
        Origins, directions, tmin, tmax, as ``check_rays`` returns them.
    n : int
        Rays.
    limit : int
        The most rays of a row of blocks; see ``image_width``.
    """
    if n < LEAST or len(tree.nodes.bounds) < NODES * NODE_SIZE:
        return 0
    for vectors in (_rows(fields[1], n), _rows(fields[0], n)):
        if vectors is not None and _runs(vectors):
            first, largest = WIDTHS
            width = first + int(np.argmin(_distances(vectors, 0, first, largest + 1)))
            if n % width == 0 and all(_comes_back(vectors, quarter * n // 4, width) for quarter in PLACES):
                return image_width((n // width, width), limit)
    return 0


def field_in_rows(tree: Tree, fields: list[Field], n: int) -> int | None:
    """Return the field by which a list runs along rows of any length that are wide: 0 origins, 1 directions, or None.

    The parameters are those of ``width_of_list``. Along a straight row, rays that are farther apart in the list are
    farther apart in space, in proportion; not so in blocks, or across edges. Where few bundles of neighbours are such
    rows, or they are narrow, sorting costs more than it gains.
    """
    bundle = group_size(tree.extent) * packet_width(tree.extent)
    if n < LEAST_IN_ROWS or len(tree.nodes.bounds) < NODES * NODE_SIZE or bundle < 32:
        return None
    places = (np.arange(SAMPLES) * GOLDEN % 1 * (n - bundle)).astype(np.intp)  # not in step with any rows
    for number in range(2):
        vectors = _rows(fields[number], n)
        if vectors is not None:
            whole = _apart(vectors, places, bundle - 1)
            if (whole > 0).any():
                limit = WIDE * tree.extent[6] / _reach(tree, fields, number)
                wide = np.count_nonzero(whole > limit**2) > SAMPLES / 2
                return number if wide and _straight(vectors, places, bundle, whole) else None
    return None


def _apart(vectors: NDArray[np.floating], places: NDArray[np.intp], lag: int) -> NDArray[np.floating]:
    """Return the squares of the distances of vectors at ``places`` from those ``lag`` places after them."""
    with np.errstate(all="ignore"):
        apart = vectors[places + lag] - vectors[places]
        return np.einsum("ij,ij->i", apart, apart)


def _straight(
    vectors: NDArray[np.floating], places: NDArray[np.intp], bundle: int, whole: NDArray[np.floating]
) -> bool:
    """Return whether most bundles at ``places`` are straight rows; ``whole``: squares of their lengths."""
    one, two, four, quarter = (_apart(vectors, places, lag) for lag in (1, 2, 4, bundle // 4))
    straight = (one < two) & (two < four) & (four < quarter) & (quarter < whole) & (whole < STEADY**2 * quarter)
    return bool(np.mean(straight) > STRAIGHT)


def _reach(tree: Tree, fields: list[Field], number: int) -> float:
    """Return how far apart hits are where directions, as long as the first one, are 1 apart; 1 for origins."""
    if number == 0:
        return 1.0
    first = [field.array[0] if isinstance(field, Pieces) else _view(field, 1)[0] for field in fields[:2]]
    middle = (tree.extent[:3] + tree.extent[3:6]) / 2
    return float(np.linalg.norm(first[0].ravel()[:3] - middle) / np.linalg.norm(first[1].ravel()[:3]))


def _rows(field: Field, n: int) -> NDArray[np.floating] | None:
    """Return vectors as an (n, 3) view; None if all are the same, or not in a list."""
    if isinstance(field, Pieces):
        return field.array if field.axes == 1 else None
    return _view(field, n) if field.row != 0 else None


def _view(columns: Columns, n: int) -> NDArray[np.floating]:
    data, size = columns.data, columns.data.itemsize
    return np.ndarray((n, 3), data.dtype, data, columns.start * size, (columns.row * size, columns.axis * size))


def _distances(vectors: NDArray[np.floating], i: int, begin: int, end: int) -> NDArray[np.floating]:
    """Return the squares of the distances of vectors i + begin to i + end from vector i."""
    with np.errstate(all="ignore"):
        apart = vectors[i + begin : i + end] - vectors[i]
        return np.einsum("ij,ij->i", apart, apart)


def _runs(vectors: NDArray[np.floating]) -> bool:
    """Return whether the first vectors move away from the first one, as in a row of pixels but not in a block."""
    apart = _distances(vectors, 0, 1, 2 * STEP + 1)[[0, 1, 3, 7, 15]]
    return bool((apart[1:] > apart[:-1]).all())


def _comes_back(vectors: NDArray[np.floating], i: int, width: int) -> bool:
    """Return whether the vector one row after vector i is nearer to it than one that is ``STEP`` pixels away."""
    there, here = _distances(vectors, i, width, width + 1), _distances(vectors, i, STEP, STEP + 1)
    return bool(there[0] < here[0])
