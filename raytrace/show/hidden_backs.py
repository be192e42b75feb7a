"""Hide walls that the camera sees from behind: a tree for camera rays, without their triangles."""

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.records import Camera, Scene
from raytrace.scene.seen_backs import black_behind


class HiddenBacks:
    """Trees for camera rays of a scene. The last one is kept, because few movements of a camera change what is hidden.

    Parameters
    ----------
    scene : Scene
    bvh : BVH
        Its tree.
    """

    def __init__(self, scene: Scene, bvh: BVH) -> None:
        self._mesh, self._bvh = scene.mesh, bvh
        self._black = black_behind(scene)[scene.mesh.material_id]
        self._hidden, self._kept = np.zeros(len(self._black), np.bool_), bvh

    def tree(self, camera: Camera) -> BVH:
        """Return the tree without the triangles of one-sided surfaces that show this camera their back.

        A triangle (v0, v1, v2) of normal n = (v1 - v0) x (v2 - v0) shows its back to a point o where (o - v0) . n < 0,
        and to parallel rays of direction d where d . n > 0. So one sign is exact for all rays of a pinhole, or of an
        orthographic camera. With a lens, o is its centre: a triangle whose plane cuts the lens is hidden, or not, as a
        whole.

        Triangles keep their numbers: a hidden one becomes a point, which no ray hits.
        """
        corners = self._mesh.vertices[self._mesh.faces].astype(np.float64)  # (m, 3, 3)
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        towards = camera.position - corners[:, 0] if camera.height is None else camera.position - camera.look_at
        hidden: NDArray[np.bool_] = self._black & ((towards * n).sum(axis=1) < 0)
        if not np.array_equal(hidden, self._hidden):
            faces = np.where(hidden[:, None], self._mesh.faces[:, :1], self._mesh.faces)
            bvh, whole = self._bvh, not hidden.any()
            self._kept = bvh if whole else BVH(self._mesh.vertices, faces, bvh.precision, bvh.split, bvh.triangle)
            self._hidden = hidden
        return self._kept
