"""``camera_rays``: the rays through the pixel centres of a camera, for programs that trace them on their own."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import OptionError
from raytrace.passes.camera import make_view
from raytrace.records import Camera, Scene
from raytrace.rendering.rendering import override, size_of
from raytrace.scene.load import load
from raytrace.scene.other_camera import in_view
from raytrace.scene.sources import Source

RIGID = 1e-6  # largest difference of R^T R from 1, and of the last row of a pose from 0, 0, 0, 1

Rays = tuple[NDArray[np.float64], NDArray[np.float64]]  # (h, w, 3) each


def camera_rays(
    scene: Scene | Source | None = None,
    size: tuple[int, int] | None = None,
    *,
    K: ArrayLike | None = None,
    pose: ArrayLike | None = None,
) -> Rays:
    """Compute the rays through the pixel centres of a camera.

    Parameters
    ----------
    scene : Scene, str, Path, dict or mesh
        What ``render`` accepts: its camera is used, without filter. A camera with an aperture gives the rays through
        the centre of its lens.
    size : (width, height), pixels, optional
        Size of the image. Default: the scene's; needed with ``K``.
    K : (3, 3) array_like, pixels, optional
        Intrinsic matrix, in place of a scene: upper triangular, without a zero on its diagonal.
    pose : (4, 4) array_like, optional
        With ``K``: [R t; 0 1], from camera to world. Default: the identity.

    Returns
    -------
    origins, directions : (h, w, 3) float64
        World units; unit vectors. Row r, column c belong to the pixel whose centre lies at (c + 1/2, r + 1/2); row 0
        is the top of the image.

    Raises
    ------
    SceneError, FileError
        As ``load`` does.
    OptionError
        A ``ValueError``: a wrong size; neither a scene nor ``K``, or both; ``K`` is not an invertible, upper triangular
        matrix; the R of ``pose`` is not a rotation, to 1e-6.

    Notes
    -----
    With ``K`` the direction is R K^-1 (c + 1/2, r + 1/2, 1), made unit: x points right, y down, z forward, and the film
    begins at the corner of its first pixel, as in Open3D and COLMAP. OpenCV puts pixel centres at whole numbers: for a
    ``K`` from its calibration add 1/2 to cx and cy. An OpenCV or COLMAP extrinsic matrix goes from world to camera: its
    inverse is the pose.

    Examples
    --------
    The camera of a scene:

    >>> import numpy as np
    >>> import raytrace as rt
    >>> origins, directions = rt.camera_rays("scenes/cornell-box.json", size=(4, 3))
    >>> origins.shape, directions.shape
    ((3, 4, 3), (3, 4, 3))

    A camera at the origin that looks along z; cx and cy are the centre of a film of 2 x 2 pixels:

    >>> _, d = rt.camera_rays(K=[[2, 0, 1], [0, 2, 1], [0, 0, 1]], size=(2, 2))
    >>> (d[0, 1] / d[0, 1, 2]).tolist()
    [0.25, -0.25, 1.0]
    """
    if K is not None:
        if scene is not None:
            raise OptionError("camera_rays: expected a scene or K, not both")
        if size is None:
            raise OptionError("size: expected (width, height) beside K")
        return _intrinsic_rays(_intrinsics(K), _pose(np.eye(4) if pose is None else pose), size_of(size))
    if scene is None:
        raise OptionError("camera_rays: expected a scene, or K and size")
    if pose is not None:
        raise OptionError("pose: only beside K; the scene has its camera")
    if not isinstance(scene, Scene):
        scene = load(scene)
    size = override(scene.settings, None, size, None, None, None).size
    return _scene_rays(in_view(scene, size).camera, size)


def _scene_rays(camera: Camera, size: tuple[int, int]) -> Rays:
    view = make_view(camera, size, np.dtype(np.float64))
    x, y = _centres(size)
    across = (x - view.centre[0])[..., None] * view.right + (y - view.centre[1])[..., None] * view.down
    if camera.height is not None:
        return view.origin + across, np.broadcast_to(view.forward, across.shape).copy()
    return np.broadcast_to(view.origin, across.shape).copy(), _unit(view.forward + across)


def _intrinsic_rays(k: NDArray[np.float64], pose: NDArray[np.float64], size: tuple[int, int]) -> Rays:
    x, y = _centres(size)
    turn = pose[:3, :3]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # refused below
        z = 1.0 / k[2, 2]  # K^-1 (x, y, 1) by back substitution
        b = (y - k[1, 2] * z) / k[1, 1]
        a = (x - k[0, 1] * b - k[0, 2] * z) / k[0, 0]
        d = a[..., None] * turn[:, 0] + b[..., None] * turn[:, 1] + z * turn[:, 2]
    if not np.isfinite(d).all():
        raise OptionError("K: its inverse is beyond the range of float64")
    return np.broadcast_to(pose[:3, 3], d.shape).copy(), _unit(d)


def _centres(size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates (h, w) of the pixel centres."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    return x, y


def _unit(d: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors; they are scaled by a power of two first, so that no square overflows or underflows."""
    d = np.ldexp(d, -np.frexp(np.abs(d).max(axis=-1, keepdims=True))[1])
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def _matrix(name: str, value: ArrayLike, side: int) -> NDArray[np.float64]:
    try:
        matrix = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise OptionError(f"{name}: expected a {side} x {side} matrix of numbers") from None
    if matrix.shape != (side, side):
        raise OptionError(f"{name}: expected a {side} x {side} matrix, got shape {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise OptionError(f"{name}: a number is not finite")
    return matrix


def _intrinsics(value: ArrayLike) -> NDArray[np.float64]:
    k = _matrix("K", value, 3)
    if np.tril(k, -1).any():
        swapped = "; is it transposed?" if not np.triu(k, 1).any() else ""
        raise OptionError(f"K: expected zeros below the diagonal{swapped}")
    if not k.diagonal().all():
        raise OptionError(f"K: not invertible; its diagonal is {k.diagonal().tolist()}")
    return k


def _pose(value: ArrayLike) -> NDArray[np.float64]:
    pose = _matrix("pose", value, 4)
    turn = pose[:3, :3]
    if np.abs(pose[3] - (0, 0, 0, 1)).max() > RIGID:
        transposed = "; is it transposed?" if not pose[:3, 3].any() else ""
        raise OptionError(f"pose: expected the last row 0, 0, 0, 1, got {pose[3].tolist()}{transposed}")
    error = float(np.abs(turn.T @ turn - np.eye(3)).max()) if np.abs(turn).max() < 2 else np.inf  # no product overflows
    if error > RIGID:
        raise OptionError(f"pose: R is not a rotation: R^T R differs from 1 by {error:.2g}; expected at most {RIGID:g}")
    if np.linalg.det(turn) < 0:
        raise OptionError("pose: R is not a rotation: it mirrors; its determinant is -1")
    return pose
