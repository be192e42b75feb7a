"""Tables of the numbers of a path, as text and as HTML."""

from collections.abc import Iterable
from html import escape
from typing import NamedTuple

import numpy as np

from raytrace.show.path_steps import ShadowRay, Step, Steps


class Table(NamedTuple):
    """A table of text cells."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def tables_of(steps: Steps) -> list[Table]:
    """Tables of the path, the shadow rays and the radiance of the sample."""
    path = Table(
        "path: lengths in world units, angles in degrees to the shading normal, eta transmitted / incident",
        ("", "event", "material", "t", "p", "normal", "in", "out", "eta", "triangle"),
        tuple(_step(number, step) for number, step in enumerate(steps.path, 1)),
    )
    light = Table(
        "light: irradiance E = flux cos / (4 pi r^2), radiance L = albedo E / pi, for red, green and blue",
        ("light", "event", "distance", "direction", "E", "L"),
        tuple(map(_shadow, steps.shadows)),
    )
    total = Table("", ("radiance of the sample",), ((_vector(steps.radiance, 6),),))
    return [path, light, total] if steps.shadows else [path, total]


def _step(number: int, step: Step) -> tuple[str, ...]:
    numbers = [_number(angle, ".2f") for angle in (step.angle_in, step.angle_out)]
    return (
        str(number), step.event, step.material, _number(step.t, ".5g"), _vector(step.p), _vector(step.ns), *numbers,
        _number(step.eta, ".4g"), str(step.prim_id) if step.prim_id >= 0 else "",
    )  # fmt: skip


def _shadow(ray: ShadowRay) -> tuple[str, ...]:
    far = float(np.linalg.norm(ray.d.astype(np.float64)))
    event = f"blocked after {ray.t * far:.4g}" if ray.event == "blocked" else ray.event
    return (
        str(ray.light),
        event,
        f"{far:.5g}",
        _vector(ray.d / far),
        _vector(ray.irradiance, 6),
        _vector(ray.radiance, 6),
    )


def _number(value: float, form: str) -> str:
    return "" if np.isnan(value) else f"{value:{form}}"


def _vector(values: Iterable[float], digits: int = 4) -> str:
    numbers = [round(float(value), digits) + 0.0 for value in values]  # + 0.0 turns -0 into 0
    return "" if np.isnan(numbers).any() else " ".join(f"{value:.{digits}f}" for value in numbers)


def as_text(table: Table) -> str:
    """Format a table as text with aligned columns."""
    width = [max(len(row[k]) for row in (table.header, *table.rows)) for k in range(len(table.header))]
    lines = [
        "  ".join(cell.ljust(size) for cell, size in zip(row, width, strict=True)).rstrip()
        for row in (table.header, *table.rows)
    ]
    return "\n".join([table.title, *lines] if table.title else lines)


def as_html(table: Table) -> str:
    """Format a table as HTML."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    rows = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    caption = f'<caption style="text-align: left">{escape(table.title)}</caption>' if table.title else ""
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
