"""Scenes made from arrays in a line or two, for tests whose answer is known."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.records import DIFFUSE, REFRACTIVE, Camera, Lights, Materials, Mesh, Scene, Settings


class Part(NamedTuple):
    """Triangles of one material."""

    triangles: ArrayLike  # (m, 3, 3) world units
    kind: int = DIFFUSE
    albedo: ArrayLike = (1.0, 1.0, 1.0)
    ior: float = 1.0
    two_sided: bool = False
    transparent_shadow: bool = False
    normals: NDArray[np.float64] | None = None  # (m, 3, 3); None: flat


def glass(triangles: ArrayLike, ior: float, **more: Any) -> Part:
    return Part(triangles, REFRACTIVE, ior=ior, **more)


def quad(a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike) -> NDArray[np.float64]:
    """Two triangles (2, 3, 3); the front sees a, b, c, d counter-clockwise."""
    return np.array([[a, b, c], [a, c, d]], np.float64)


def box(lo: ArrayLike, hi: ArrayLike) -> NDArray[np.float64]:
    """Twelve triangles (12, 3, 3) that face outwards."""
    lo, hi = np.asarray(lo, np.float64), np.asarray(hi, np.float64)
    corner = [np.where([i & 1, i & 2, i & 4], hi, lo) for i in range(8)]
    sides = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
    return np.concatenate([quad(*(corner[i] for i in side)) for side in sides])


def ball(rings: int, radius: float = 1.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Triangles (m, 3, 3) of a sphere at the origin and the normals of their corners."""
    theta, phi = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    t, f = np.meshgrid(theta, phi, indexing="ij")
    n = np.stack([np.sin(t) * np.cos(f), np.cos(t), np.sin(t) * np.sin(f)], axis=-1)
    n[0], n[-1] = (0, 1, 0), (0, -1, 0)
    a, b, c, d = n[:-1], np.roll(n[:-1], -1, axis=1), np.roll(n[1:], -1, axis=1), n[1:]
    upper, lower = np.stack([a, b, c], axis=2)[1:], np.stack([a, c, d], axis=2)[:-1]
    normals = np.concatenate([upper.reshape(-1, 3, 3), lower.reshape(-1, 3, 3)])
    return radius * normals, normals


def make_scene(
    parts: Sequence[Part],
    lights: Sequence[tuple[ArrayLike, ArrayLike]] = (),
    camera: Camera | None = None,
    settings: Settings | None = None,
    background: ArrayLike = (0.0, 0.0, 0.0),
) -> Scene:
    """A scene of the parts, each a material and an object; equal corners are one vertex."""
    counts = [len(np.asarray(part.triangles)) for part in parts]
    corners = np.concatenate([np.asarray(part.triangles, np.float64) for part in parts])
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.repeat((flat / np.linalg.norm(flat, axis=1, keepdims=True))[:, None], 3, axis=1)
    for part, end, count in zip(parts, np.cumsum(counts), counts, strict=True):
        if part.normals is not None:
            normals[end - count : end] = part.normals
    smooth = any(part.normals is not None for part in parts)
    owner = np.repeat(np.arange(len(parts), dtype=np.int32), counts)
    vertices, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    mesh = Mesh(vertices, faces.reshape(-1, 3), normals if smooth else None, owner, owner.copy())
    names = tuple(f"part{i}" for i in range(len(parts)))
    materials = Materials(
        names,
        np.array([part.kind for part in parts], np.int8),
        np.array([part.albedo for part in parts], np.float64),
        np.array([part.ior for part in parts], np.float64),
        np.array([part.two_sided for part in parts]),
        np.array([part.transparent_shadow for part in parts]),
    )
    position, flux = (np.array([light[k] for light in lights], np.float64).reshape(-1, 3) for k in (0, 1))
    camera = camera or look((0, 0, 5), (0, 0, 0))
    settings = settings or Settings((8, 8), 1, 16, "sobol", "float64", 0)
    return Scene(
        source=None,
        about="A test.",
        camera=camera,
        settings=settings,
        background=np.array(background, np.float64),
        materials=materials,
        lights=Lights(position, flux),
        mesh=mesh,
        objects=names,
        warnings=(),
    )


def look(position: ArrayLike, at: ArrayLike, fov: float = 40.0, up: ArrayLike = (0.0, 1.0, 0.0)) -> Camera:
    return Camera(*(np.array(a, np.float64) for a in (position, at, up)), fov)


def studio() -> Scene:
    """About 150 triangles on which every rule of the renderer leaves its mark; max_depth 5 is just enough."""
    turn, lean = np.radians((32.0, 20.0))
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    block = box((-0.6, 0.001, -0.6), (0.6, 1.3, 0.6)) @ rotation.T + [1.0, 0, 0.3]
    triangles, normals = ball(6, 0.65)
    screen = quad((0, 0, 0), (-0.9, 0, 0), (-0.9, 1.2, 0), (0, 1.2, 0))  # its back is turned to the camera
    pane = quad((-0.7, 1.9, 1.4), (0.7, 1.9, 1.4), (0.7, 1.9 + np.sin(lean), 0.4), (-0.7, 1.9 + np.sin(lean), 0.4))
    parts = [
        Part(quad((-4, 0, 3), (4, 0, 3), (4, 0, -3), (-4, 0, -3)), albedo=(0.6, 0.5, 0.4)),
        Part(quad((-4, 0, -2), (1.5, 0, -2), (1.5, 2.4, -2), (-4, 2.4, -2)), albedo=(0.3, 0.5, 0.6)),
        Part(triangles + [-0.7, 0.7, 0.2], albedo=(0.7, 0.2, 0.1), normals=normals),
        Part(screen + [0.35, 0.01, -0.6], albedo=(0.8, 0.8, 0.2)),
        Part(screen + [-1.1, 0.01, -1.4], albedo=(0.2, 0.8, 0.2), two_sided=True),
        glass(block, 1.5),
        glass(pane, 1.3, transparent_shadow=True),
        Part(quad((-2, 5, -1), (2, 5, -1), (2, 5, 3), (-2, 5, 3))),  # a roof above the light
    ]
    lights = [((0.5, 4.0, 2.0), (160, 150, 140)), ((-2.5, 1.5, 3.5), (60, 70, 90))]
    settings = Settings((48, 48), 4, 5, "sobol", "float64", 0)
    return make_scene(parts, lights, look((0.0, 1.6, 5.5), (0.0, 0.85, 0.0), 34), settings, (0.05, 0.1, 0.2))
