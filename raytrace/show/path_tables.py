"""Tables of the numbers of a path, as text and as HTML."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from raytrace.html_tables import html_table
from raytrace.show.path_steps import ShadowRay, Step, Steps


class Table(NamedTuple):
    """A table of text cells."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def tables_of(steps: Steps) -> list[Table]:
    """Tables of the path, of the light that it meets, of the shadow rays, and of the radiance of the sample."""
    tables = [_path(steps)]
    if steps.traced and any(step.added.any() for step in steps.path):
        tables.append(_met(steps))
    if steps.shadows:
        tables.append(_traced_light(steps) if steps.traced else _light(steps))
    return [*tables, Table("", ("radiance of the sample",), ((_vector(steps.radiance, 6),),))]


def _path(steps: Steps) -> Table:
    title = "path: lengths in world units, angles in degrees to the shading normal, eta transmitted / incident"
    header: tuple[str, ...] = ("", "event", "material", "t", "p", "normal", "in", "out", "eta", "triangle")
    if steps.traced:
        title += "; throughput before the hit; survival of Russian roulette after it"
        header += ("throughput", "survival")
    return Table(title, header, tuple(_step(k, step, steps.traced) for k, step in enumerate(steps.path, 1)))


def _step(number: int, step: Step, traced: bool) -> tuple[str, ...]:
    numbers = [_number(angle, ".2f") for angle in (step.angle_in, step.angle_out)]
    cells = (
        str(number), step.event, step.material, _number(step.t, ".5g"), _vector(step.p), _vector(step.ns), *numbers,
        _number(step.eta, ".4g"), str(step.prim_id) if step.prim_id >= 0 else "",
    )  # fmt: skip
    return (*cells, _vector(step.throughput), f"{step.survival:.4g}") if traced else cells


def _met(steps: Steps) -> Table:
    """Lamps, environment and background that rays of a path met."""
    rows = tuple(
        (str(k), step.material or "outside the scene", f"{step.pdf:.4g}", f"{step.weight:.4g}", _vector(step.added, 6))
        for k, step in enumerate(steps.path, 1)
        if step.added.any()
    )
    title = "light that rays meet: L = weight x throughput x radiance; pdf of the direction in 1 / sr, inf: specular"
    return Table(title, ("ray", "meets", "pdf", "weight", "L"), rows)


def _light(steps: Steps) -> Table:
    return Table(
        "light: irradiance E = flux cos / (4 pi r^2), radiance L = albedo E / pi, for red, green and blue",
        ("light", "event", "distance", "direction", "E", "L"),
        tuple((str(ray.light), *_shadow(ray), *_gain(ray)) for ray in steps.shadows),
    )


def _traced_light(steps: Steps) -> Table:
    rows = tuple(
        (str(ray.step + 1), ray.name, *_shadow(ray), _number(ray.pdf, ".4g"), _number(ray.weight, ".4g"), *_gain(ray))
        for ray in steps.shadows
    )
    title = (
        "shadow rays: E = incident light cos / density, L = weight x throughput x albedo E / pi; pdf inf: a light of"
    )
    header = ("at", "light", "event", "distance", "direction", "pdf", "weight", "E", "L")
    return Table(f"{title} no size", header, rows)


def _shadow(ray: ShadowRay) -> tuple[str, str, str]:
    """Event, distance and direction of a shadow ray."""
    far = float(np.linalg.norm(ray.d.astype(np.float64)))
    event = f"blocked after {ray.t * far:.4g}" if ray.event == "blocked" else ray.event
    if ray.event == "sends nothing here":
        return event, "", ""
    return event, "inf" if ray.far else f"{far:.5g}", _vector(ray.d / far)


def _gain(ray: ShadowRay) -> tuple[str, str]:
    return _vector(ray.irradiance, 6), _vector(ray.radiance, 6)


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
    return html_table(table.title, table.header, table.rows)
