"""A reference ray tracer in NumPy and Numba: correct, fast, small, and easy to inspect.

``render`` renders a scene, ``BVH`` traces rays, ``explain`` shows what a scene needs, ``compare`` compares images. Each
name is imported on first use, so that ``import raytrace`` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0.dev0"

if TYPE_CHECKING:
    from raytrace import bsdf, show, testing, textbook
    from raytrace.accel.bvh import BVH
    from raytrace.errors import FileError, OptionError, RaytraceError, SceneError
    from raytrace.image.metrics import compare
    from raytrace.optics import reflect, refract, spawn_ray
    from raytrace.point_records import ClosestPoint
    from raytrace.records import AllHits, Hits, Scene, Surface
    from raytrace.rendering.given_rays import radiance
    from raytrace.rendering.pixel_rays import camera_rays
    from raytrace.rendering.rendering import render
    from raytrace.rendering.result import Render
    from raytrace.reporting.sweep import report
    from raytrace.scene.demo_scene import demo
    from raytrace.scene.load import load
    from raytrace.scene.plan import explain
    from raytrace.scene.save import save

_HOME = {
    "AllHits": "records",
    "BVH": "accel.bvh",
    "ClosestPoint": "point_records",
    "FileError": "errors",
    "Hits": "records",
    "OptionError": "errors",
    "RaytraceError": "errors",
    "Render": "rendering.result",
    "Scene": "records",
    "SceneError": "errors",
    "Surface": "records",
    "camera_rays": "rendering.pixel_rays",
    "compare": "image.metrics",
    "demo": "scene.demo_scene",
    "explain": "scene.plan",
    "load": "scene.load",
    "radiance": "rendering.given_rays",
    "reflect": "optics",
    "refract": "optics",
    "render": "rendering.rendering",
    "report": "reporting.sweep",
    "save": "scene.save",
    "spawn_ray": "optics",
}

__all__ = [  # noqa: RUF022  (in the order of sorted)
    "AllHits",
    "BVH",
    "ClosestPoint",
    "FileError",
    "Hits",
    "OptionError",
    "RaytraceError",
    "Render",
    "Scene",
    "SceneError",
    "Surface",
    "bsdf",
    "camera_rays",
    "compare",
    "demo",
    "explain",
    "load",
    "radiance",
    "reflect",
    "refract",
    "render",
    "report",
    "save",
    "show",
    "spawn_ray",
    "testing",
    "textbook",
]


if not TYPE_CHECKING:  # a type checker would take any name for one of these

    def __getattr__(name: str) -> Any:
        if name in ("bsdf", "show", "testing", "textbook"):  # packages with public names of their own
            return import_module(f"{__name__}.{name}")
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
