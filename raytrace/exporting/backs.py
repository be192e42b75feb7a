"""Whether a camera's paths can meet the backs of surfaces."""

import numpy as np
from numpy.typing import NDArray

from raytrace.exporting.meshes import Part, equal_rows
from raytrace.records import Scene

ROUNDING = 1e-5  # of the scene's extent: how far behind a plane a point may lie that counts as on it
MOST_PLANES = 256  # different planes of a mesh that are tested
CHUNK = 4096  # triangles whose solid angles are summed at a time


def back_may_be_seen(scene: Scene, part: Part) -> bool:
    """Whether a path from the camera may meet the back of a part, which no light passes.

    It cannot, if (a) the camera and all other surfaces lie in front of each of its triangles; or (b) it is closed, and
    the camera is on the side that its fronts face: paths would have to pass it to get to its back.
    """
    eyes = _eyes(scene)
    return not (_all_in_front(scene, part, eyes) or _closed_and_outside(part, eyes))


def _eyes(scene: Scene) -> NDArray[np.float64]:
    """Points from which rays start, (n, 3): the camera; the corners of a lens or of an orthographic film."""
    camera = scene.camera
    ahead = camera.look_at - camera.position
    right = np.cross(ahead, camera.up)
    up = np.cross(right, ahead)
    right, up = right / np.linalg.norm(right), up / np.linalg.norm(up)
    half = np.array([camera.aperture, camera.aperture])
    if camera.height is not None:
        width, height = scene.settings.size
        half = np.array([camera.height / 2 * width / height, camera.height / 2])
    corners = [camera.position + x * half[0] * right + y * half[1] * up for x in (-1, 1) for y in (-1, 1)]
    return np.array([camera.position, *corners])


def _all_in_front(scene: Scene, part: Part, eyes: NDArray[np.float64]) -> bool:
    """Whether all vertices of the scene and all eyes are in front of the planes of a part, or on them."""
    points = np.concatenate([eyes, scene.mesh.vertices[np.flatnonzero(np.bincount(scene.mesh.faces.ravel()))]])
    extent = float((points.max(axis=0) - points.min(axis=0)).max())
    a, b, c = (part.vertices.astype(np.float64)[part.faces[:, j]] for j in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 0] / length[length > 0, None]
    planes = np.unique(np.round(np.column_stack([normals, (normals * a[length > 0]).sum(axis=1)]), 6), axis=0)
    if len(planes) > MOST_PLANES:
        return False
    return all(float((points @ plane[:3]).min()) - plane[3] >= -ROUNDING * extent for plane in planes)


def _closed_and_outside(part: Part, eyes: NDArray[np.float64]) -> bool:
    """Whether a part is closed, and its winding number at the eyes is that of the side that its fronts face."""
    if not _closed(part):
        return False
    exact = part.vertices.astype(np.float64)[part.faces]  # (m, 3, 3)
    volume = np.einsum("ij,ij->i", exact[:, 0], np.cross(exact[:, 1], exact[:, 2])).sum()
    front = 0 if volume > 0 else -1  # outside of a body; inside of one whose fronts face inwards
    return all(round(winding_number(exact, eye)) == front for eye in eyes)


def _closed(part: Part) -> bool:
    """Whether each edge is a side of as many triangles in one direction as in the other; vertices by position."""
    ids = equal_rows(part.vertices)[1][part.faces]
    ends = np.stack([ids, np.roll(ids, -1, axis=1)], axis=2).reshape(-1, 2)
    ends = ends[ends[:, 0] != ends[:, 1]]
    codes = ends.min(axis=1) * (ids.max() + 1) + ends.max(axis=1)
    _, edge = np.unique(codes, return_inverse=True)
    return not np.bincount(edge, weights=np.sign(ends[:, 1] - ends[:, 0])).any()


def winding_number(corners: NDArray[np.float64], point: NDArray[np.float64]) -> float:
    """Sum of the signed solid angles of triangles (m, 3, 3) as seen from a point, over 4 pi [VanOosterom1983].

    It is 1 inside a closed mesh whose fronts face outwards, and 0 outside.
    """
    total = 0.0
    for begin in range(0, len(corners), CHUNK):
        a, b, c = np.moveaxis(corners[begin : begin + CHUNK] - point, 1, 0)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        triple = np.einsum("ij,ij->i", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a)))
        total += float(2 * np.arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb).sum())
    return total / (4 * np.pi)
