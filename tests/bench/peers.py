"""Ray tracers for Python behind one interface: ``calls`` returns the calls to time, ``hits`` reads an answer."""

import os
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from workloads import Mesh, RaySet

import raytrace as rt
from raytrace.accel import build


class Ours:
    """``rt.BVH``, with column-major and with row-major rays."""

    name = "raytrace"

    def __init__(self, mesh: Mesh, **options: str) -> None:
        self.bvh = rt.BVH(mesh.vertices, mesh.faces, **options)

    def calls(self, rays: RaySet, threads: int) -> dict[str, Callable[[], Any]]:
        ask = self.bvh.any_hit if rays.any_hit else self.bvh.closest_hit
        dtype = self.bvh.precision
        columns = [np.asarray(a, dtype, "F") for a in (rays.o, rays.d)]
        rows = [np.asarray(a, dtype, "C") for a in (rays.o, rays.d)]
        return {
            self.name: lambda: ask(*columns, tmax=rays.tmax, threads=threads),
            f"{self.name}, row-major": lambda: ask(*rows, tmax=rays.tmax, threads=threads),
        }

    def counts(self, rays: RaySet) -> tuple[float, float]:
        """Return nodes visited and triangles tested per ray; the work of a packet counts once for all its rays."""
        used, make = [], self.bvh.work
        self.bvh.work = lambda: used.append(make()) or used[-1]
        ask = self.bvh.any_hit if rays.any_hit else self.bvh.closest_hit
        ask(np.asfortranarray(rays.o), np.asfortranarray(rays.d), tmax=rays.tmax)
        self.bvh.work = make
        nodes, triangles = sum(work.counts for work in used) / len(rays.o)
        return float(nodes), float(triangles)

    @staticmethod
    def hits(answer: Any) -> float:
        return float(np.mean(answer if isinstance(answer, np.ndarray) else answer.prim_id >= 0))


class Whole(Ours):
    """The same, with each triangle in one leaf."""

    name = "raytrace, whole triangles"

    def __init__(self, mesh: Mesh) -> None:
        least, build.DIVIDED = build.DIVIDED, sys.maxsize
        super().__init__(mesh)
        build.DIVIDED = least


class Open3D:
    """Embree in robust mode, one call for all rays."""

    name, module = "Open3D", "open3d"

    def __init__(self, mesh: Mesh) -> None:
        import open3d as o3d

        self.tensor = o3d.core.Tensor
        self.scene = o3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(self.tensor(mesh.vertices), self.tensor(mesh.faces.astype("u4")))

    def calls(self, rays: RaySet, threads: int) -> dict[str, Callable[[], Any]]:
        tensor = self.tensor(np.concatenate([rays.o, rays.d], 1))
        if rays.any_hit:
            return {self.name: lambda: self.scene.test_occlusions(tensor, tfar=rays.tmax, nthreads=threads)}
        return {self.name: lambda: self.scene.cast_rays(tensor, nthreads=threads)}

    @staticmethod
    def hits(answer: Any) -> float:
        return float(np.mean(np.isfinite(answer["t_hit"].numpy()) if isinstance(answer, dict) else answer.numpy()))


class Mitsuba:
    """Embree in packets of the machine's width, called from a compiled loop over all rays.

    Its robust setting is off, as by default: the faster one. ``raytrace.hardcases`` compares robustness with both.
    """

    name, module = "Mitsuba", "mitsuba"

    def __init__(self, mesh: Mesh) -> None:
        mi = self.mi = mitsuba()
        shape = mi.Mesh("mesh", len(mesh.vertices), len(mesh.faces))
        parameters = mi.traverse(shape)
        parameters["vertex_positions"] = mi.Float(mesh.vertices.ravel())
        parameters["faces"] = mi.UInt32(mesh.faces.ravel().astype("u4"))
        parameters.update()
        self.scene = mi.load_dict({"type": "scene", "mesh": shape})

    def calls(self, rays: RaySet, threads: int) -> dict[str, Callable[[], Any]]:
        import drjit as dr

        mi = self.mi
        dr.set_thread_count(threads)  # including the caller's thread
        ray = mi.Ray3f(mi.Point3f(rays.o.T), mi.Vector3f(rays.d.T))
        ray.maxt = mi.Float(rays.tmax)
        dr.eval(ray)
        ask = self.scene.ray_test if rays.any_hit else self.scene.ray_intersect_preliminary

        def call(coherent: bool) -> Any:
            answer = ask(ray, coherent=coherent)
            dr.eval(answer)
            dr.sync_thread()
            return answer

        return {self.name: lambda: call(False), f"{self.name}, coherent": lambda: call(True)}

    @staticmethod
    def hits(answer: Any) -> float:
        return float(np.mean((answer if hasattr(answer, "numpy") else answer.is_valid()).numpy()))


class Embreex:
    """Embree on one thread, one call for all rays.

    It holds the global interpreter lock, so more threads would not help.
    """

    name, module = "embreex", "embreex.rtcore_scene"

    def __init__(self, mesh: Mesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.scene = EmbreeScene()
        self.mesh = TriangleMesh(self.scene, mesh.vertices, mesh.faces)

    def calls(self, rays: RaySet, threads: int) -> dict[str, Callable[[], Any]]:
        if threads > 1:  # compared only where every ray tracer has one thread
            return {}
        o, d = np.ascontiguousarray(rays.o, "f4"), np.ascontiguousarray(rays.d, "f4")
        far = np.full(len(o), min(rays.tmax, 1e30), "f4")
        query = "OCCLUDED" if rays.any_hit else "INTERSECT"
        return {self.name: lambda: self.scene.run(o, d, dists=far, query=query, output=not rays.any_hit)}

    @staticmethod
    def hits(answer: Any) -> float:
        return float(np.mean((answer["primID"] if isinstance(answer, dict) else answer) >= 0))


def mitsuba() -> Any:
    """Return the module ``mitsuba``, set to the variant ``llvm_ad_rgb``, which runs compiled on the CPU."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)  # some samplers warn each time they round the number of samples
    return mi


def available() -> tuple[list[type], dict[str, str]]:
    """Return the ray tracers that can run here, and the reasons why the others cannot."""
    found, missing = [], {}
    for peer in (Open3D, Mitsuba, Embreex):
        try:
            import_module(peer.module)
        except ImportError as error:
            missing[peer.name] = f"not installed ({error}); in the clone: pip install '.[bench]'"
            continue
        if peer is Mitsuba and "DRJIT_LIBLLVM_PATH" not in os.environ:  # some versions of LLVM abort the process
            missing[peer.name] = "DRJIT_LIBLLVM_PATH does not name a libLLVM; version 19 works"
            continue
        found.append(peer)
    return found, missing
