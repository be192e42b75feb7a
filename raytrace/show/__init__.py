"""Figures of the algorithm, as ``rt.show``: the tree, the path of a ray, samples, errors and convergence.

Each function returns a ``Drawing``. A notebook displays it, ``save`` writes it as PNG or SVG, and ``data`` has its
numbers. The functions need matplotlib: ``pip install matplotlib scikit-image``. ``live`` is an interactive viewer and
needs anywidget: ``pip install anywidget``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from raytrace.show.convergence_plot import convergence
    from raytrace.show.drawing import Drawing
    from raytrace.show.error_map import error
    from raytrace.show.live_viewer import live
    from raytrace.show.path_drawing import path
    from raytrace.show.sample_points import samples
    from raytrace.show.tree_boxes import bvh
    from raytrace.show.visit_counts import heatmap

_HOME = {
    "Drawing": "drawing",
    "bvh": "tree_boxes",
    "convergence": "convergence_plot",
    "error": "error_map",
    "heatmap": "visit_counts",
    "live": "live_viewer",
    "path": "path_drawing",
    "samples": "sample_points",
}

__all__ = ["Drawing", "bvh", "convergence", "error", "heatmap", "live", "path", "samples"]


if not TYPE_CHECKING:  # a type checker would take any name for one of these

    def __getattr__(name: str) -> Any:
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
