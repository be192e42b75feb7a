"""How notebooks and terminals show a scene and its plan: one line as text, tables as HTML."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from raytrace.errors import printable

if TYPE_CHECKING:
    from raytrace.html_tables import Cell
    from raytrace.records import Lights, Scene
    from raytrace.scene.plan import Plan

MOST_ROWS = 30  # of a table; further rows are counted


class SceneDisplay:
    """The ``repr`` of a scene in one line, and its tables in a notebook."""

    def __repr__(self: Scene) -> str:  # type: ignore[misc]
        (width, height), settings = self.settings.size, self.settings
        name = printable(self.source.stem) if self.source else "(not from a file)"
        return f"<Scene {name}: {contents(self)}; {width}x{height}, {settings.spp} spp, {settings.integrator}>"

    def _repr_html_(self: Scene) -> str:  # type: ignore[misc]
        from raytrace.html_tables import html_table

        rows = list(_materials(self))
        if len(rows) > MOST_ROWS:
            rows[MOST_ROWS:] = [(f"and {len(rows) - MOST_ROWS:,} more", "", "", "")]
        facts = html_table(printable(self.about) or repr(self), (), _facts(self))
        return facts + html_table("", ("material", "type", "colour", "other"), rows)


def contents(scene: Scene) -> str:
    """What is in a scene: the numbers of triangles, objects, materials and lights."""
    from raytrace.scene.path_plan import light_words

    used = np.count_nonzero(np.bincount(scene.mesh.material_id))  # np.unique would import numpy.ma, in 10 ms
    objects, materials = count(len(scene.objects), "object"), count(int(used), "material")
    return f"{len(scene.mesh.faces):,} triangles in {objects}, {materials}, {light_words(scene)}"


def count(number: int, noun: str) -> str:
    """A number and its noun.

    >>> count(1, "object"), count(1200, "object")
    ('1 object', '1,200 objects')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def plan_line(plan: Plan) -> str:
    """The ``repr`` of a plan."""
    warned = f", {count(len(plan.warnings), 'warning')}" if plan.warnings else ""
    steps = f"{len(plan.passes)} passes, {len(plan.left_out)} left out"
    return f"<Plan: {plan.holds}; {plan.precision.name}; {steps}{warned}; print it>"


def plan_html(plan: Plan) -> str:
    """The tables of a plan: its passes, and what is left out."""
    from raytrace.html_tables import html_table

    facts = [("holds", plan.holds), ("precision", f"{plan.precision.name}: {plan.precision.why}")]
    facts += [("warning", printable(warning)) for warning in plan.warnings]
    passes = html_table("", ("pass", "cost"), plan.passes)
    return html_table(printable(plan.about), (), facts) + passes + html_table("", ("left out", "why"), plan.left_out)


def _facts(scene: Scene) -> Iterator[tuple[str, Cell]]:
    """Everything but the materials."""
    from raytrace.html_tables import numbers

    camera, settings = scene.camera, scene.settings
    if scene.source:
        yield "file", printable(scene.source)
    yield "holds", contents(scene)
    low, high = scene.mesh.vertices.min(axis=0), scene.mesh.vertices.max(axis=0)
    yield "bounds", f"({numbers(low)}) to ({numbers(high)}) world units"
    view = f"fov {camera.fov:g}\N{DEGREE SIGN}" if camera.height is None else f"orthographic, height {camera.height:g}"
    lens = f", aperture {camera.aperture:g}, focus {camera.focus:.4g}" if camera.aperture > 0 else ""
    yield "camera", f"at ({numbers(camera.position)}), looks at ({numbers(camera.look_at)}), {view}{lens}"
    yield "film", f"{settings.size[0]} x {settings.size[1]} pixels, filter {settings.filter}"
    yield "samples", f"{settings.spp} per pixel, {settings.sampler}, seed {settings.seed}"
    yield "integrator", f"{settings.integrator}, max_depth {settings.max_depth}, precision {settings.precision}"
    lights = list(_lights(scene.lights))
    yield from (("light", light) for light in lights[:MOST_ROWS])
    if len(lights) > MOST_ROWS:
        yield "light", f"and {len(lights) - MOST_ROWS:,} more"
    if scene.background.any():
        yield "background", f"radiance {numbers(scene.background)}"
    yield from (("warning", printable(warning)) for warning in scene.warnings)


def _lights(lights: Lights) -> Iterator[str]:
    """The lights that are no surfaces, in words."""
    from raytrace.html_tables import numbers

    for position, flux in zip(lights.position, lights.flux, strict=True):
        yield f"point at ({numbers(position)}), flux {numbers(flux)} W"
    if lights.spots is not None:
        for position, intensity in zip(lights.spots.position, lights.spots.intensity, strict=True):
            yield f"spot at ({numbers(position)}), intensity {numbers(intensity)} W/sr"
    if lights.directions is not None:
        for direction, irradiance in zip(lights.directions.direction, lights.directions.irradiance, strict=True):
            yield f"directional along ({numbers(direction)}), irradiance {numbers(irradiance)} W/m\N{SUPERSCRIPT TWO}"
    if lights.environment is not None:
        mean = "" if lights.image is None else "image, mean "
        yield f"environment, {mean}radiance {numbers(lights.environment)} W/(sr m\N{SUPERSCRIPT TWO})"


def _materials(scene: Scene) -> Iterator[tuple[Cell, ...]]:
    from raytrace.html_tables import Colour, numbers
    from raytrace.records import DIELECTRIC, REFRACTIVE, ROUGH_DIELECTRIC
    from raytrace.scene.path_plan import NAMES

    table, textures = scene.materials, scene.textures
    for row, (name, kind) in enumerate(zip(table.name, table.kind.tolist(), strict=True)):
        textured = textures is not None and textures.reflectance[row] >= 0
        clear = kind in (DIELECTRIC, ROUGH_DIELECTRIC, REFRACTIVE)
        colour: Cell = "texture" if textured else "" if clear else Colour(table.albedo[row].tolist())
        other = [
            f"ior {table.ior[row]:.4g}" if table.ior[row] != 1 else "",
            f"alpha {table.alpha[row]:.3g}" if table.alpha is not None and table.alpha[row] > 0 else "",
            "two-sided" if table.two_sided[row] else "",
            "transparent shadows" if table.transparent_shadow[row] else "",
            f"emission {numbers(table.emission[row])}"
            if table.emission is not None and table.emission[row].any()
            else "",
        ]
        yield printable(name), NAMES[kind], colour, ", ".join(filter(None, other))
