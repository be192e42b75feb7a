"""``warmup``: compile what pictures need before the first of them is wanted."""

from collections.abc import Callable

import numpy as np

from raytrace.accel.build import FEW
from raytrace.records import Camera, Lights, Materials, Mesh, Scene, Settings
from raytrace.rendering import Progress, render


def warmup(progress: Callable[[Progress], None] | None = None) -> None:
    """Compile what pictures need, in both precisions, by drawing a tiny scene that has it all.

    Examples
    --------
    >>> from raytrace.warmup import warmup
    >>> warmup()  # doctest: +SKIP
    """
    for precision in ("float32", "float64"):
        for scene in (_tiny_scene(smooth=False), _tiny_scene(smooth=True)):
            render(scene, precision=precision, progress=progress, aov=("depth",))


def _tiny_scene(smooth: bool) -> Scene:
    """Lit triangles behind refractive ones."""
    triangle = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    vertices = np.concatenate([triangle, triangle + [0.0, 0.0, 1.0]])
    faces = np.tile(np.arange(6).reshape(2, 3), (FEW, 1))  # so many that their tree is built by the compiled kernels
    normals = np.broadcast_to([0.0, 0.0, 1.0], (*faces.shape, 3)).copy() if smooth else None
    material_id = np.arange(len(faces), dtype=np.int32) % 2
    flags = np.zeros(2, np.bool_)
    return Scene(
        source=None,
        sha256="",
        about="",
        camera=Camera(np.array([0.0, 0.0, 4.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 40.0),
        settings=Settings((8, 8), 2, 4, "sobol", "auto", 0),
        background=np.zeros(3),
        materials=Materials(("white", "glass"), np.array([0, 1], np.int8), np.ones((2, 3)), np.ones(2), flags, flags),
        lights=Lights(np.array([[0.0, 0.0, 3.0]]), np.ones((1, 3))),
        mesh=Mesh(vertices, faces, normals, material_id.astype(np.int32), np.zeros(len(faces), np.int32)),
        objects=("triangles",),
        warnings=(),
    )
