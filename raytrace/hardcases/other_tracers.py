"""Other ray tracers with the interface ``Tracer``; each is imported only when it is used."""

import os
from collections.abc import Iterator
from importlib import import_module, metadata
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.hardcases.judge import Flags, RayQuery
from raytrace.hardcases.shadows import LightQuery
from raytrace.hardcases.tracers import Lit, Reals, Tracer
from raytrace.records import Hits

WHOLE = 256  # offset of an origin in ulps   [Waechter2019]
NEAR = 1 / 32  # coordinates below this have a constant offset instead ...
SMALL = 2.0**-16  # ... of this size in float32; in float64 smaller by 2^29, the ratio of the machine epsilons


def mesh_of(query: RayQuery | LightQuery) -> tuple[Reals, NDArray[np.int32]]:
    """Vertices and faces as contiguous arrays."""
    return np.ascontiguousarray(query.vertices), np.ascontiguousarray(query.faces, np.int32)


def offset(p: Reals, n: Reals) -> Reals:
    """Origins moved along n off a surface, by adding integers to the bits of the floats [Waechter2019]."""
    whole = np.int32 if p.dtype == np.float32 else np.int64
    steps = np.where(p < 0, -WHOLE * n, WHOLE * n).astype(whole)
    moved = np.add(np.ascontiguousarray(p).view(whole), steps).view(p.dtype)
    small = SMALL * np.finfo(p.dtype).eps / np.finfo(np.float32).eps
    return np.where(np.abs(p) < NEAR, p + p.dtype.type(small) * n, moved)


class MovedShadowRays(NamedTuple):
    """Shadow rays of tracers that do not make their own."""

    found: Flags  # (n,): whether the camera ray hit a point
    o: Reals  # (n, 3), world units
    d: Reals  # (n, 3): to the light, which is at t = 1


def moved_shadow_rays(hits: Hits, query: LightQuery) -> MovedShadowRays:
    """Make shadow rays for tracers that do not make their own."""
    found = hits.prim_id >= 0
    a, b, c = (query.vertices[query.faces[np.where(found, hits.prim_id, 0), k]] for k in range(3))
    u, v = hits.u[:, None], hits.v[:, None]
    p = (1 - u - v) * a + u * b + v * c
    n = np.cross((b - a).astype(np.float64), c - a)  # its squares may overflow in float32
    n /= np.sqrt((n**2).sum(axis=1, keepdims=True))
    n = np.where(((query.light - p) * n).sum(axis=1, keepdims=True) < 0, -n, n).astype(p.dtype)
    start = offset(p, n)
    return MovedShadowRays(found, start, query.light - start)


class OtherTracer:
    """Base class of other ray tracers: they have no tmin."""

    name, interval, exact = "", False, False
    modules: tuple[str, ...] = ()  # required modules; the first has the name of its package
    dtype: np.dtype = np.dtype(np.float32)

    def __init__(self) -> None:
        self.check_installed()
        for module in self.modules:
            import_module(module)
        self.version = metadata.version(self.modules[0])

    def check_installed(self) -> None:
        """Raise ImportError with an install command if a package is missing."""
        missing = [module for module in self.modules if find_spec(module) is None]
        if missing:
            raise ImportError(f"not installed; pip install {' '.join(missing)}")

    def nearest(self, query: RayQuery) -> Iterator[Hits]:
        """Nearest hits."""
        yield self.closest(self.scene(query), query.o, query.d)

    def blocked(self, query: RayQuery) -> Iterator[Flags]:
        """Whether anything is hit."""
        yield self.any(self.scene(query), query.o, query.d, np.inf)

    def shadows(self, query: LightQuery) -> Iterator[Lit]:
        """Trace shadow rays whose origins are moved as in [Waechter2019]."""
        scene = self.scene(query)
        rays = moved_shadow_rays(self.closest(scene, query.o, query.d), query)
        yield Lit(rays.found, self.any(scene, rays.o, rays.d, 1.0))

    def scene(self, query: RayQuery | LightQuery) -> Any:
        """Build the tracer's own scene from a mesh."""
        raise NotImplementedError

    def closest(self, scene: Any, o: Reals, d: Reals) -> Hits:
        """Nearest hits."""
        raise NotImplementedError

    def any(self, scene: Any, o: Reals, d: Reals, tmax: float) -> Flags:
        """Whether anything is hit before tmax."""
        raise NotImplementedError


class Open3D(OtherTracer):
    """Embree in Open3D, which uses its robust mode."""

    name, modules = "Open3D", ("open3d",)

    def scene(self, query: RayQuery | LightQuery) -> Any:  # noqa: D102
        open3d = import_module("open3d")
        vertices, faces = mesh_of(query)
        scene = open3d.t.geometry.RaycastingScene()
        scene.add_triangles(open3d.core.Tensor(vertices), open3d.core.Tensor(faces.astype(np.uint32)))
        return scene

    def closest(self, scene: Any, o: Reals, d: Reals) -> Hits:  # noqa: D102
        found = {name: tensor.numpy() for name, tensor in scene.cast_rays(self._rays(o, d)).items()}
        prim = np.where(np.isfinite(found["t_hit"]), found["primitive_ids"].astype(np.int64), -1)
        return Hits(found["t_hit"], prim.astype(np.int32), *found["primitive_uvs"].T)

    def any(self, scene: Any, o: Reals, d: Reals, tmax: float) -> Flags:  # noqa: D102
        occluded: Flags = scene.test_occlusions(self._rays(o, d), tfar=tmax).numpy()
        return occluded

    @staticmethod
    def _rays(o: Reals, d: Reals) -> Any:
        return import_module("open3d").core.Tensor(np.concatenate([o, d], axis=1))


class Embreex(OtherTracer):
    """Embree in embreex."""

    name, modules = "embreex", ("embreex",)

    def scene(self, query: RayQuery | LightQuery) -> Any:  # noqa: D102
        scene = import_module("embreex.rtcore_scene").EmbreeScene()
        return scene, import_module("embreex.mesh_construction").TriangleMesh(scene, *mesh_of(query))

    def closest(self, scene: Any, o: Reals, d: Reals) -> Hits:  # noqa: D102
        far = np.full(len(o), np.inf, np.float32)
        found = scene[0].run(o.copy(), d.copy(), dists=far, query="INTERSECT", output=True)
        return Hits(found["tfar"], found["primID"], found["u"], found["v"])

    def any(self, scene: Any, o: Reals, d: Reals, tmax: float) -> Flags:  # noqa: D102
        far = np.full(len(o), tmax, np.float32)
        return np.asarray(scene[0].run(o.copy(), d.copy(), dists=far, query="OCCLUDED")) >= 0


class Mitsuba(OtherTracer):
    """Embree in Mitsuba, with Mitsuba's own rays and offsets; the LLVM variant, compiled for the CPU."""

    name, modules, robust = "Mitsuba", ("mitsuba",), False

    def __init__(self) -> None:
        self.check_installed()
        if "DRJIT_LIBLLVM_PATH" not in os.environ:  # some versions of LLVM abort the process
            raise ImportError("DRJIT_LIBLLVM_PATH does not name a libLLVM; version 19 works")
        super().__init__()
        self.mi = import_module("mitsuba")
        self.mi.set_variant("llvm_ad_rgb")

    def scene(self, query: RayQuery | LightQuery) -> Any:  # noqa: D102
        vertices, faces = mesh_of(query)
        shape = self.mi.Mesh("mesh", len(vertices), len(faces))
        parameters = self.mi.traverse(shape)
        parameters["vertex_positions"] = self.mi.Float(vertices.ravel())
        parameters["faces"] = self.mi.UInt32(faces.ravel().astype(np.uint32))
        parameters.update()
        return self.mi.load_dict({"type": "scene", "mesh": shape, "embree_use_robust_intersections": self.robust})

    def _rays(self, o: Reals, d: Reals) -> Any:
        return self.mi.Ray3f(self.mi.Point3f(o.T), self.mi.Vector3f(d.T))

    def closest(self, scene: Any, o: Reals, d: Reals) -> Hits:  # noqa: D102
        found = scene.ray_intersect_preliminary(self._rays(o, d))
        prim = np.where(found.is_valid().numpy(), found.prim_index.numpy().astype(np.int64), -1)
        return Hits(found.t.numpy(), prim.astype(np.int32), *found.prim_uv.numpy())

    def any(self, scene: Any, o: Reals, d: Reals, tmax: float) -> Flags:  # noqa: D102
        rays = self._rays(o, d)
        rays.maxt = self.mi.Float(tmax)
        occluded: Flags = scene.ray_test(rays).numpy()
        return occluded

    def shadows(self, query: LightQuery) -> Iterator[Lit]:
        """Trace shadow rays made by Mitsuba's ``spawn_ray_to``."""
        scene = self.scene(query)
        surface = scene.ray_intersect(self._rays(query.o, query.d))
        rays = surface.spawn_ray_to(self.mi.Point3f(query.light.T))
        yield Lit(surface.is_valid().numpy(), scene.ray_test(rays).numpy())


class RobustMitsuba(Mitsuba):
    """Mitsuba with Embree's robust intersections, which are off by default."""

    name, robust = "Mitsuba, robust", True


class Trimesh(OtherTracer):
    """trimesh's ray tracer in NumPy, in float64."""

    name, modules, dtype = "trimesh", ("trimesh", "rtree"), np.dtype(np.float64)

    def scene(self, query: RayQuery | LightQuery) -> Any:  # noqa: D102
        from trimesh import Trimesh as TrimeshMesh
        from trimesh.ray.ray_triangle import RayMeshIntersector

        return RayMeshIntersector(TrimeshMesh(*mesh_of(query), process=False)), query

    def closest(self, scene: Any, o: Reals, d: Reals) -> Hits:  # noqa: D102
        hits = Hits(np.full(len(o), np.inf), np.full(len(o), -1, np.int32), *np.zeros((2, len(o))))
        good = np.flatnonzero(
            np.isfinite(o).all(axis=1) & np.isfinite(d).all(axis=1)
        )  # it raises an error for the others
        with np.errstate(all="ignore"):
            p, row, prim = scene[0].intersects_location(o[good], d[good], multiple_hits=False)
            if len(row):
                row = good[row]
                hits.t[row] = ((p - o[row]) * d[row]).sum(axis=1) / (d[row] ** 2).sum(axis=1)
                hits.prim_id[row] = prim
                a, b, c = (scene[1].vertices[scene[1].faces[prim, k]] for k in range(3))
                n = np.cross(b - a, c - a)
                area = (n * n).sum(axis=1)
                hits.u[row] = (np.cross(p - a, c - a) * n).sum(axis=1) / area
                hits.v[row] = (np.cross(b - a, p - a) * n).sum(axis=1) / area
        return hits

    def any(self, scene: Any, o: Reals, d: Reals, tmax: float) -> Flags:  # noqa: D102
        return np.asarray(self.closest(scene, o, d).t < tmax)

    def blocked(self, query: RayQuery) -> Iterator[Flags]:
        """Yield nothing: it has no occlusion query of its own."""
        yield from ()


OTHER_TRACERS = (Open3D, Embreex, Mitsuba, RobustMitsuba, Trimesh)


def installed_tracers() -> tuple[list[Tracer], dict[str, str]]:
    """Tracers that can run here; and for each other one the reason why not, by name."""
    found: list[Tracer] = []
    missing = {}
    for tracer in OTHER_TRACERS:
        try:
            found.append(tracer())
        except ImportError as error:
            missing[tracer.name] = str(error)
    return found, missing
