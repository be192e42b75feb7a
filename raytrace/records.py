"""Records that modules share. Comments give shape, dtype, unit and meaning of each field; f is float32 or float64."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.record_display import displayed
from raytrace.scene.display import SceneDisplay
from raytrace.scene.fingerprint import fingerprint
from raytrace.scene.replaceable import Replaceable, check_records
from raytrace.texture_records import EnvironmentImage, FileMaterial, Textures

if TYPE_CHECKING:
    from raytrace.scene.content import Content
    from raytrace.scene.uv_source import UvSource

DIFFUSE, REFRACTIVE, MIRROR, DIELECTRIC, CONDUCTOR, ROUGH_DIELECTRIC, ROUGH_CONDUCTOR, PLASTIC = range(8)
SCATTERING = DIFFUSE, ROUGH_DIELECTRIC, ROUGH_CONDUCTOR, PLASTIC  # lit by lights; the others are perfectly specular


class Camera(NamedTuple):
    """A camera: a pinhole; with an aperture a thin lens; with a height orthographic."""

    position: NDArray[np.float64]  # (3,) f8, world units: the pinhole
    look_at: NDArray[np.float64]  # (3,) f8, world units: the point at the centre of the image
    up: NDArray[np.float64]  # (3,) f8, any length: points to the top of the image
    fov: float  # degrees: full vertical angle; 0 where orthographic
    aperture: float = 0.0  # world units: radius of the lens
    focus: float = 1.0  # world units: distance of the plane in focus along the view axis
    height: float | None = None  # world units: of an orthographic view


class Materials(NamedTuple):
    """Materials of surfaces, one row per material."""

    name: tuple[str, ...]  # names as in the scene file
    kind: NDArray[np.int8]  # (k,) i1: DIFFUSE, REFRACTIVE, MIRROR, DIELECTRIC, ...; see above
    albedo: NDArray[np.float64]  # (k, 3) f8, 0..1: reflectance of diffuse, plastic's base, mirrors, metals; or its mean
    ior: NDArray[np.float64]  # (k,) f8: index inside / index outside; 1 where nothing is transmitted
    two_sided: NDArray[np.bool_]  # (k,) bool: diffuse or plastic on both sides of the geometric normal
    transparent_shadow: NDArray[np.bool_]  # (k,) bool: shadow rays pass straight through
    emission: NDArray[np.float64] | None = None  # (k, 3) f8, W / (sr m2): of the front, or its mean; None: no lamps
    eta: NDArray[np.float64] | None = None  # (k, 3) f8: index of conductors; 0: from a texture; None: there are none
    k: NDArray[np.float64] | None = None  # (k, 3) f8: their absorption index; inf: all light is reflected
    alpha: NDArray[np.float64] | None = None  # (k,) f8, 0..1: GGX width as the scene states it; None: 0 everywhere


class Spots(NamedTuple):
    """Spot lights, a row per light."""

    position: NDArray[np.float64]  # (l, 3) f8, world units
    axis: NDArray[np.float64]  # (l, 3) f8: unit direction of the axis
    intensity: NDArray[np.float64]  # (l, 3) f8, W / sr: within the beam
    cutoff: NDArray[np.float64]  # (l,) f8, radians from the axis: no light from there on
    beam: NDArray[np.float64]  # (l,) f8, radians from the axis: full intensity up to there


class Directions(NamedTuple):
    """Directional lights, a row per light."""

    direction: NDArray[np.float64]  # (l, 3) f8: unit direction in which the light goes
    irradiance: NDArray[np.float64]  # (l, 3) f8, W / m2: on a plane that faces the light


class Lights(NamedTuple):
    """All lights that are not surfaces: isotropic point lights, one row per light; the others where there are any."""

    position: NDArray[np.float64]  # (l, 3) f8, world units
    flux: NDArray[np.float64]  # (l, 3) f8, W per channel: total over the sphere of directions
    spots: Spots | None = None
    directions: Directions | None = None
    environment: NDArray[np.float64] | None = None  # (3,) f8, W / (sr m2): radiance from all directions, or its mean
    image: EnvironmentImage | None = None  # None: the environment is constant
    numbers: tuple[int, ...] = ()  # of each in the scene's list: points, spots, directions, environment; (): in order


class RawMesh(NamedTuple):
    """The triangles of one mesh file, in its own coordinates."""

    vertices: NDArray[np.float64]  # (v, 3) f8, in the file's units; those that a face uses are finite
    faces: NDArray[np.int64]  # (m, 3) i8: rows of vertices, counter-clockwise seen from the front
    normals: NDArray[np.float64] | None  # (n, 3) f8, any length: the file's normals; None if it has none
    normal_faces: NDArray[np.int64] | None  # (m, 3) i8: row of normals for each corner; -1: none
    normals_fault: str = ""  # why the normals can't be used: an error in a smooth mesh, ignored in a flat one
    warnings: tuple[str, ...] = ()  # features of the file that are probably not rendered as intended
    uv: NDArray[np.float64] | None = None  # (m, 3, 2) f8: of the corners, NaN: none; None: no corner has any, or unread
    colors: NDArray[np.float64] | None = None  # (m, 3, 3) f8: linear RGB of the corners; NaN and None as for uv
    parts: NDArray[np.int32] | None = None  # (m,) i4: row of ``materials``; None: they were not asked for
    materials: tuple[FileMaterial, ...] = ()  # of the file

    @property
    def nbytes(self) -> int:
        """Size of its arrays in bytes."""
        return sum(array.nbytes for array in self if isinstance(array, np.ndarray))


class Mesh(NamedTuple):
    """All triangles of a scene in world space, object after object."""

    vertices: NDArray[np.float64]  # (v, 3) f8, world units
    faces: NDArray[np.int64]  # (m, 3) i8: rows of vertices, counter-clockwise seen from the front
    normals: NDArray[np.float64] | None  # (m, 3, 3) f8: unit shading normals of the corners; None: all flat
    material_id: NDArray[np.int32]  # (m,) i4: row of Materials
    object_id: NDArray[np.int32]  # (m,) i4: index into Scene.objects
    uv: NDArray[np.float64] | None = None  # (m, 3, 2) f8: of the corners, NaN: the object has none; None: not needed
    colors: NDArray[np.float64] | None = None  # (m, 3, 3) f8: linear RGB of the corners; NaN and None as for uv


class Settings(NamedTuple):
    """Render settings of a scene; the caller can override each of them."""

    size: tuple[int, int]  # of the image: (width, height), pixels
    spp: int  # samples per pixel
    max_depth: int  # most surfaces that a path can meet
    sampler: str  # "sobol", "stratified" or "independent"
    precision: str  # "auto", "float32" or "float64"
    seed: int  # 0 .. 2**32 - 1
    integrator: str = "direct"  # or "path"
    filter: str = "box"  # of the film: "box", "tent" or "gaussian"


@dataclass(frozen=True, eq=False, repr=False)
class Scene(SceneDisplay, Replaceable):
    """A valid scene: ``rt.load`` returns it, and ``rt.render`` renders it."""

    source: Path | None  # its file; None for a dict
    about: str  # a one-sentence description
    camera: Camera
    settings: Settings
    background: NDArray[np.float64]  # (3,) f8: radiance of rays that leave the scene
    materials: Materials
    lights: Lights
    mesh: Mesh
    objects: tuple[str, ...]  # a short name per object, for messages
    warnings: tuple[str, ...]  # about valid but probably unintended content, one line each
    textures: Textures | None = None  # of the materials that objects have; None: there are none
    uv_source: UvSource | None = None  # reads uv that no material needs; None: there are none but those of the mesh
    content: Content | None = None  # what it was read from; None: a program made its records

    sha256 = cached_property(fingerprint)  # computed on first use; a scene from ``dataclasses.replace`` has its own

    def __post_init__(self) -> None:
        check_records(self, camera=Camera, settings=Settings, materials=Materials, lights=Lights, mesh=Mesh)

    @cached_property
    def corner_uv(self) -> NDArray[np.float64] | None:
        """Texture coordinates of all corners, (m, 3, 2), read now if need be; NaN: an object has none; None: all."""
        uv = self.mesh.uv
        if self.uv_source is None or (uv is not None and not np.isnan(uv).any()):
            return uv
        read = self.uv_source.read(self.mesh)
        return read if uv is None else np.where(np.isnan(uv), read, uv)

    @property
    def refractive(self) -> bool:
        """Whether the scene has a refractive material."""
        return bool((self.materials.kind == REFRACTIVE).any())


class Hits(NamedTuple):
    """Nearest hits, one per ray, in arrays of the shape of the rays, here (n,): p = (1 - u - v) v0 + u v1 + v v2."""

    t: NDArray[np.floating]  # (n,) f, units of the ray's direction; inf: a miss
    prim_id: NDArray[np.int32]  # (n,) i4: row of the faces; -1: a miss
    u: NDArray[np.floating]  # (n,) f, 0..1: barycentric weight of v1
    v: NDArray[np.floating]  # (n,) f, 0..1: barycentric weight of v2


class AllHits(NamedTuple):
    """All hits of n rays: those of ray i are rows start[i] to start[i + 1], sorted by t, then by prim_id."""

    t: NDArray[np.floating]  # (k,) f, units of the ray's direction
    prim_id: NDArray[np.int32]  # (k,) i4: row of the faces
    u: NDArray[np.floating]  # (k,) f, 0..1: barycentric weight of v1
    v: NDArray[np.floating]  # (k,) f, 0..1: barycentric weight of v2
    start: NDArray[np.int64]  # (n + 1,) i8: rows where the hits of each ray begin; the last is k


class Surface(NamedTuple):
    """Points on surfaces, one row per ray, in arrays of the shape of the rays, here (n,); rows of misses are NaN."""

    p: NDArray[np.floating]  # (n, 3) f, world units
    p_error: NDArray[np.floating]  # (n, 3) f, world units: absolute bound on the rounding error of p
    ng: NDArray[np.floating]  # (n, 3) f: unit geometric normal, (v1 - v0) x (v2 - v0) normalised


class Nodes(NamedTuple):
    """A flattened tree of boxes with eight children per node; node 0 is the root. See accel/layout.py."""

    bounds: NDArray[np.floating]  # (n * 64,) f, world units: 8 low x, y, z, 8 high x, y, z; then integers
    child: NDArray[np.integer]  # the same memory: a node; ~leaf where negative; 0 (the root is no child) past the last


class WatertightLeaves(NamedTuple):
    """Leaves of up to eight triangles, for the test of Woop, Benthin and Wald."""

    rows: NDArray[np.floating]  # (n * 104,) f, world units: 8 v0 x, y, z, v1, v2; integers; 8 unit normal x, y, z
    prim_id: NDArray[np.integer]  # the same memory: row of the faces; -1 past the last one


class MollerTrumboreLeaves(NamedTuple):
    """The same leaves, for the test of Moller and Trumbore with the absolute threshold of the course."""

    rows: NDArray[np.floating]
    prim_id: NDArray[np.int32]


class Columns(NamedTuple):
    """An (n, 3) array, or an (n,) one, as kernels read it: element (i, k) is data[start + i * row + k * axis]."""

    data: NDArray[np.floating]  # flat f
    start: int
    row: int  # elements from one ray to the next; 1: contiguous; 0: all rays share one
    axis: int  # elements from x to y


class Rays(NamedTuple):
    """Rays o + t d for t in the open interval (tmin, tmax)."""

    o: Columns  # world units
    d: Columns  # any length; t is in units of it
    tmin: Columns
    tmax: Columns


class Tree(NamedTuple):
    """The geometry that rays are traced against."""

    nodes: Nodes
    leaves: WatertightLeaves | MollerTrumboreLeaves
    extent: NDArray[np.floating]  # (7,) f, world units: low x y z and high x y z of all boxes; side of a typical leaf


class View(NamedTuple):
    """The camera for kernels: the ray through (x, y), in pixels, has the direction forward + x' right + y' down.

    Orthographic: the direction is forward, x' right + y' down is added to the origin. x' = y' = 0: the film's centre.
    """

    origin: NDArray[np.floating]  # (3,) f, world units
    forward: NDArray[np.floating]  # (3,) f: unit
    right: NDArray[np.floating]  # (3,) f: one pixel to the right, at distance 1
    down: NDArray[np.floating]  # (3,) f: one pixel down, at distance 1
    centre: NDArray[np.floating]  # (2,) f, pixels: centre of the film


class Shading(NamedTuple):
    """Tables for shading: flat arrays with one row per triangle or per material."""

    triangles: NDArray[np.floating]  # (m * 12,) f: v0 x y z, v1 x y z, v2 x y z, unit normal x y z
    material_id: NDArray[np.int32]  # (m,) i4
    materials: NDArray[np.floating]  # (k * 6,) f: albedo r g b, ior, two-sided (0 or 1), refractive (0 or 1)


class Batch(NamedTuple):
    """One thread's rays in flight, as a structure of arrays; components one after the other, as in (3, n)."""

    o: NDArray[np.floating]  # (3n,) f, world units: origins (unused by camera rays, which share one)
    d: NDArray[np.floating]  # (3n,) f: unit directions
    slot: NDArray[np.int32]  # (n,) i4: the sample that a ray belongs to, after finished rays are removed
    hits: Hits


class Points(NamedTuple):
    """Surface points of samples, for the light pass."""

    p: NDArray[np.floating]  # (3n,) f, world units
    ng: NDArray[np.floating]  # (3n,) f: unit geometric normal on the viewer's side
    ns: NDArray[np.floating]  # (3n,) f: unit shading normal on the viewer's side; the same array as ng if all is flat
    offset: NDArray[np.floating]  # (n,) f, world units: of the next ray's origin along ng; -1: no surface to light
    material_id: NDArray[np.int32]  # (n,) i4


class Shadows(NamedTuple):
    """Shadow rays to one light, and the irradiance of those that are not occluded."""

    o: NDArray[np.floating]  # (3n,) f, world units
    d: NDArray[np.floating]  # (3n,) f, world units: to the light, at t = 1
    tmax: NDArray[np.floating]  # (n,) f: 1; -1: no ray
    irradiance: NDArray[np.floating]  # (n,) f, 1 / area: cos / (4 pi r^2), per unit of flux
    occluded: NDArray[np.bool_]  # (n,) bool


class Window(NamedTuple):
    """The part of the film that is rendered."""

    x: int  # pixels: left column
    y: int  # pixels: top row
    width: int
    height: int


for _record in (Camera, Materials, Spots, Directions, Lights, RawMesh, Mesh, Hits, AllHits, Surface):
    displayed(_record)  # short in notebooks and in help
