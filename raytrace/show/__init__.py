"""Pictures of the algorithm, as ``rt.show``: what the tree, a ray, a sampler and an error look like.

Each function returns a ``Drawing``: it shows itself in a notebook, saves itself as PNG or SVG, and holds the numbers
that it shows. They need matplotlib: ``pip install matplotlib scikit-image``. ``live`` is a widget, and needs
anywidget: ``pip install anywidget``.
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


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
