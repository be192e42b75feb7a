"""Whether long triangles of a mesh are to be divided among several leaves, and the tree in which they are."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raytrace import parallel
from raytrace.accel.boxes import BOX
from raytrace.accel.grow import Binary, Subtree, make_binary
from raytrace.accel.lanes import NODE

if TYPE_CHECKING:
    from raytrace.accel.build import MeasuredMesh
    from raytrace.accel.clip import References

SAMPLE = 4096  # triangles from which the median is estimated
ROWS = 8192  # boxes that are measured at a time, in the cache
WORTH = 16.0  # tests of triangles that a random line must be spared: two leaves
LEAST = 1e-4  # of the area of the mesh's box: what the halves of a node must share; 1e-5 takes longer and gains nothing
WIDEN = 64.0  # machine epsilons of the largest coordinate (docs/numerics.md)


def tests_spared(boxes: NDArray[np.floating], order: NDArray[np.int32], triangles: NDArray[np.floating]) -> float:
    """Estimate how many tests of triangles a random line is spared if the large ones are divided; or a bound on it.

    A line meets a convex body with a probability in proportion to its surface. A box of half surface A can be divided
    into boxes around the pieces of its triangle, whose half surfaces are at least the triangle's projections on the
    three axes together [Karras2013]. The pieces do not become smaller than a leaf of triangles of median size, because
    rays are tested against whole leaves.
    """
    area = areas_of(boxes[:: len(boxes) // SAMPLE + 1])
    leaf = NODE * float(np.median(area))
    found = [np.flatnonzero(areas_of(boxes[i : i + ROWS]) > leaf) + i for i in range(0, len(boxes), ROWS)]
    large = np.concatenate(found)
    if len(large) == 0:
        return 0.0
    area = areas_of(boxes[large])
    corners = triangles[order[large], :9].reshape(-1, 3, 3).astype(np.float64)
    ideal = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).sum(axis=1) / 2
    spared = float(np.maximum(np.minimum(area - ideal, area - leaf), 0.0).sum())
    few = spared <= float(area.max()) * WORTH  # the box of the mesh is larger than any of these
    return spared / (float(area.max()) if few else half_area_of(boxes))


def areas_of(boxes: NDArray[np.floating]) -> NDArray[np.floating]:
    """Half the surfaces of (n, 8) boxes."""
    x, y, z = (-(boxes[:, 4 + axis] + boxes[:, axis]) for axis in range(3))
    return x * y + (y + x) * z


def half_area_of(boxes: NDArray[np.floating]) -> float:
    """Half the surface of the box around (n, 8) boxes."""
    x, y, z = (-float(boxes[:, 4 + axis].min()) - float(boxes[:, axis].min()) for axis in range(3))
    return x * y + y * z + z * x


def divided_tree(mesh: "MeasuredMesh", n: int, room: int, small: int) -> tuple[Binary, int] | None:
    """Return the binary tree of a mesh, with divided triangles, and its number of nodes; None if they do not pay.

    Parameters
    ----------
    mesh : MeasuredMesh
        The first ``n`` places in its arrays hold the triangles that have an area. The tree uses the arrays.
    n : int
    room : int
        Places in the arrays: the most references.
    small : int
        Nodes of at most so many references are the roots of subtrees that threads share.
    """
    boxes = mesh.boxes[: BOX * n].reshape(n, BOX)
    with np.errstate(all="ignore"):
        if not tests_spared(boxes, mesh.order[:n], mesh.triangles) > WORTH:
            return None
    from raytrace.accel import spatial  # few meshes need it

    refs = references_of(mesh, boxes, room)
    tree, dtype = refs.tree, boxes.dtype
    used = spatial.grow_spatial(refs, Subtree(0, 0, 1, small), spatial.make_spatial_scratch(dtype))
    pending = np.flatnonzero(tree.left[:used] < 0)
    places = 2 * (refs.limit[pending] - tree.first[pending]).astype(np.int64)
    roots = zip(pending, used + np.cumsum(places) - places, strict=True)
    subtrees = [Subtree(int(node), int(~tree.left[node]), int(first), 0) for node, first in roots]
    subtrees.sort(key=lambda subtree: -tree.count[subtree.node])  # so threads end together
    counts = [used]

    def finish(subtree: Subtree) -> None:
        counts.append(spatial.grow_spatial(refs, subtree, spatial.make_spatial_scratch(dtype)) - subtree.free)

    parallel.together(finish, subtrees, None)
    return tree, sum(counts)


def references_of(mesh: "MeasuredMesh", boxes: NDArray[np.floating], room: int) -> "References":
    """Return the root of a tree that may divide triangles: one reference to each, and free places."""
    from raytrace.accel.clip import References

    tree = make_binary(mesh.order[:room], mesh.boxes[: BOX * room])
    tree.count[0] = len(boxes)
    limit = np.zeros(len(tree.count), np.int32)
    limit[0] = room
    margins = [WIDEN * float(np.finfo(boxes.dtype).eps) * float(np.abs(boxes).max()), LEAST * half_area_of(boxes)]
    return References(tree, limit, mesh.triangles.reshape(-1), np.array(margins, boxes.dtype))
