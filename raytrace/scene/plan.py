"""The plan of a scene: which passes run, on what data, in which precision; and what is left out, and why."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from raytrace.errors import OptionError, printable
from raytrace.records import REFRACTIVE, Scene
from raytrace.scene.display import contents, plan_html, plan_line
from raytrace.scene.path_plan import needs_paths, path_left_out, path_passes
from raytrace.scene.precision import Precision, choose_precision
from raytrace.scene.sources import Source

INTEGRATORS = "direct", "path"


@dataclass(frozen=True, repr=False)
class Plan:
    """The result of ``rt.explain``; ``print`` it, or show it in a notebook.

    Attributes
    ----------
    precision : Precision
    refraction, smooth, transparent : bool
        Whether there are refractive surfaces, interpolated normals, and surfaces that let shadow rays pass.
    lights : int
        Point lights.
    paths : bool
        Whether the passes of path tracing run: for ``integrator`` "path", and for materials and lights that need them.
    passes : tuple of (str, str)
        Name and cost driver of each pass that runs, in order.
    left_out : tuple of (str, str)
        What does not run or is not stored, and why.
    warnings : tuple of str
        What is legal but probably not meant, as in ``Scene.warnings``; light that is not physical, or found badly.
    """

    about: str
    holds: str
    precision: Precision
    refraction: bool
    smooth: bool
    transparent: bool
    lights: int
    paths: bool
    passes: tuple[tuple[str, str], ...]
    left_out: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return plan_line(self)

    def _repr_html_(self) -> str:
        return plan_html(self)

    def __str__(self) -> str:
        lines = [
            printable(self.about),
            f"holds      {self.holds}",
            f"precision  {self.precision.name}: {self.precision.why}",
        ]
        lines += [*_table("passes", self.passes), *_table("left out", self.left_out)]
        lines += [f"warning: {warning}" for warning in self.warnings]
        return "\n".join(line for line in lines if line)


def _table(title: str, rows: tuple[tuple[str, str], ...]) -> list[str]:
    if not rows:
        return []
    width = max(len(name) for name, _ in rows)
    return [title, *(f"  {name:<{width}}  {text}" for name, text in rows)]


def make_plan(scene: Scene) -> Plan:
    """Return the plan of a scene.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Plan

    Raises
    ------
    SceneError
        No precision can represent the scene.
    """
    used = np.flatnonzero(np.bincount(scene.mesh.material_id))  # np.unique would import numpy.ma, in 10 ms
    refractive = used[scene.materials.kind[used] == REFRACTIVE]
    refraction, smooth = len(refractive) > 0, scene.mesh.normals is not None
    transparent = bool(scene.materials.transparent_shadow[used].any())
    lights = len(scene.lights.flux)
    paths = needs_paths(scene, scene.settings.integrator)
    warnings = scene.warnings
    if paths or transparent:
        from raytrace.scene.path_costs import light_warnings

        warnings += light_warnings(scene)
    return Plan(
        about=scene.about,
        holds=contents(scene),
        precision=choose_precision(scene),
        refraction=refraction,
        smooth=smooth,
        transparent=transparent,
        lights=lights,
        paths=paths,
        passes=path_passes(scene) if paths else _passes(scene, refraction, smooth, transparent),
        left_out=path_left_out(scene) if paths else _left_out(refraction, smooth, transparent, lights),
        warnings=warnings,
    )


def _passes(scene: Scene, refraction: bool, smooth: bool, transparent: bool) -> tuple[tuple[str, str], ...]:
    depth, lights = scene.settings.max_depth, len(scene.lights.flux)
    rows = [("camera", "one ray per sample"), ("closest hit", "one query per ray")]
    if refraction:
        rows.append(("refraction", f"one more query per interface hit, up to depth {depth}; finished rays drop out"))
    if lights:
        normals = "interpolated normals" if smooth else "one normal per triangle"
        rows.append(("surface", f"points and {normals} at the hits"))
        each = "one ray per sample" if lights == 1 else f"{lights} rays per sample, one light at a time"
        tree = "a tree without transparent surfaces" if transparent else "the same tree"
        rows.append(("shadow", f"{each}, through {tree}, or one without the triangles that the light lies on"))
        rows.append(("light", "albedo / pi times the irradiance"))
    rows.append(("film", "twelve sums per pixel: three channels in four batches"))
    return tuple(rows)


def _left_out(refraction: bool, smooth: bool, transparent: bool, lights: int) -> tuple[tuple[str, str], ...]:
    rows = [
        ("refraction pass", "no surface is refractive", refraction),
        ("normal interpolation", "all meshes are flat", smooth),
        ("second tree for shadows", "shadow rays pass through no surface", transparent),
        ("surface, shadow and light passes", "there is no light", lights > 0),
        ("loop over lights", "there is one light", lights != 1),
        ("layers (AOVs)", "stored only when asked for", False),
    ]
    return tuple((what, why) for what, why, needed in rows if not needed)


def explain(scene: Scene | Source, integrator: str | None = None) -> Plan:
    """Return what rendering a scene needs, what is left out, and why.

    Parameters
    ----------
    scene : Scene, str, Path, dict or mesh
        A loaded scene, or what ``load`` accepts.
    integrator : {"direct", "path"}, optional
        As for ``render``; default: what the scene says.

    Returns
    -------
    Plan
        ``print`` it.

    Raises
    ------
    SceneError, FileError
        As ``load`` does; and SceneError for a scene that no precision can represent.
    OptionError
        An unknown integrator.

    Examples
    --------
    >>> import raytrace as rt
    >>> rt.explain("scenes/cornell-box.json").precision.name
    'float32'
    """
    from raytrace.scene.load import load

    scene = scene if isinstance(scene, Scene) else load(scene)
    if integrator not in (None, *INTEGRATORS):
        raise OptionError(f"integrator: expected one of {', '.join(INTEGRATORS)}, got {integrator!r}")
    if integrator is not None:
        scene = replace(scene, settings=scene.settings._replace(integrator=integrator))
    return make_plan(scene)
