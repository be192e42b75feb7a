"""``path``: the path of one sample of a pixel, with shadow rays and the numbers of each step."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.image.files import srgb8
from raytrace.limits import MAX_SPP
from raytrace.rendering.rendering import render, within
from raytrace.scene.path_plan import needs_paths
from raytrace.show.annotations import legend_handles
from raytrace.show.drawing import VERMILION, Drawing, new_figure, show_image
from raytrace.show.path_elevations import draw_elevations
from raytrace.show.path_section import draw_section
from raytrace.show.path_steps import Step, Steps, follow
from raytrace.show.path_tables import as_html, as_text, tables_of
from raytrace.show.prepared_scene import AnyScene, PreparedScene, prepare_scene

SIDE = 200  # pixels of the longer side of the image beside the path


class PathDrawing(Drawing):
    """A ``Drawing`` of a path; ``print`` it for tables, ``steps`` has all numbers.

    Attributes
    ----------
    steps : Steps
        ``path``: a Step for each ray; ``shadows``: a ShadowRay for each light; ``radiance``.
    """

    def __init__(self, title: str, steps: Steps, figure: Any) -> None:
        super().__init__(title, _arrays(steps), figure)
        self.steps = steps

    def __str__(self) -> str:
        return "\n\n".join([self.title, *(as_text(table) for table in tables_of(self.steps))])

    def _repr_html_(self) -> str:
        data, size = self._repr_png_()
        source = f"data:image/png;base64,{b64encode(data).decode()}"
        img = f'<img alt="{escape(self.title)}" width="{size["width"]}" src="{source}">'
        return "\n".join([img, *(as_html(table) for table in tables_of(self.steps))])


def _arrays(steps: Steps) -> dict[str, NDArray[Any]]:
    fields = [name for name in Step._fields if name not in ("material", "event", "onward")]
    data = {name: np.array([getattr(step, name) for step in steps.path]) for name in fields}
    for name in ("step", "light", "o", "d", "t", "pdf", "weight", "irradiance", "radiance"):
        data[f"shadow_{name}"] = np.array([getattr(ray, name) for ray in steps.shadows])
    return data | {"radiance": steps.radiance}


def path(
    scene: AnyScene,
    pixel: tuple[int, int],
    *,
    size: tuple[int, int] | None = None,
    sample: int = 0,
    integrator: str | None = None,
) -> PathDrawing:
    """Trace one sample of a pixel, and draw its path in section, from the side and from above.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A loaded scene, a scene file, or its content.
    pixel : (x, y)
        Column and row, (0, 0) is at the top left.
    size : (width, height), pixels, optional
        Image size; default: the scene's.
    sample : int
        Number of the sample, from 0.
    integrator : {"direct", "path"}, optional
        As for ``render``; default: what the scene says.

    Returns
    -------
    PathDrawing
        ``print`` it for the tables. ``data``: for each ray of the path "o", "d", "t", "prim_id", "p", "ng", "ns",
        "eta", "angle_in", "angle_out", "throughput", "pdf", "added", "weight", "survival"; for each shadow ray
        "shadow_step", "shadow_light", "shadow_o", "shadow_d", "shadow_t", "shadow_pdf", "shadow_weight",
        "shadow_irradiance", "shadow_radiance"; and the sample's "radiance". ``steps`` has the same as records.

    Raises
    ------
    SceneError, FileError
        As for ``load``.
    OptionError
        An unknown integrator; a pixel outside the image.
    RaytraceError
        matplotlib isn't installed.

    Notes
    -----
    The sample is traced by the kernels of ``render``, in the same precision and with the same random numbers: hits and
    radiance are bit-identical.

    Examples
    --------
    >>> import raytrace as rt
    >>> drawing = rt.show.path("scenes/cornell-box-glass.json", (24, 24), size=(64, 64))
    >>> [(step.event, step.material) for step in drawing.steps.path]
    [('enters', 'pane'), ('lands', 'grey')]
    >>> drawing = rt.show.path("scenes/cornell-box-glass.json", (24, 24), size=(64, 64), integrator="path")
    >>> drawing.steps.path[1].event, drawing.steps.shadows[0].event
    ('scatters', 'reaches')
    """
    prepared = prepare_scene(scene, size, integrator)
    column, row = (
        within("pixel", number, 0, side - 1) for number, side in zip(pixel, prepared.settings.size, strict=True)
    )
    steps = follow(prepared, (column, row), within("sample", sample, 0, MAX_SPP - 1))
    title = f"{prepared.name}: sample {sample} of pixel ({column}, {row}), {prepared.compiled.bvh.precision}"
    with new_figure(14, 8.4) as figure:
        figure.suptitle(title)
        grid = figure.add_gridspec(2, 1, height_ratios=(5, 3))
        top, bottom = grid[0].subgridspec(1, 3, width_ratios=(4, 7, 2)), grid[1].subgridspec(1, 2)
        _image(figure.add_subplot(top[0]), prepared, (column, row))
        draw_section(prepared, steps, figure.add_subplot(top[1]))
        _legend(figure.add_subplot(top[2]), needs_paths(prepared.scene, prepared.settings.integrator))
        draw_elevations(prepared, steps, [figure.add_subplot(bottom[k]) for k in range(2)])
    return PathDrawing(title, steps, figure)


def _image(axes: Any, prepared: PreparedScene, pixel: tuple[int, int]) -> None:
    """Show the rendered scene with a ring around the pixel."""
    width, height = prepared.settings.size
    scale = min(SIDE / max(width, height), 1.0)
    small = max(round(scale * width), 1), max(round(scale * height), 1)
    ask: Any = {"spp": 4, "size": small, "progress": False}
    show_image(axes, srgb8(render(prepared.scene, integrator=prepared.settings.integrator, **ask).rgb))
    at = [
        (number + 0.5) * part / whole - 0.5 for number, part, whole in zip(pixel, small, (width, height), strict=True)
    ]
    axes.plot(*at, "o", markersize=15, markerfacecolor="none", markeredgecolor="white", markeredgewidth=3.5)
    axes.plot(*at, "o", markersize=15, markerfacecolor="none", markeredgecolor=VERMILION, markeredgewidth=2)


def _legend(axes: Any, paths: bool) -> None:
    axes.axis("off")
    axes.legend(handles=legend_handles(paths), loc="center")
