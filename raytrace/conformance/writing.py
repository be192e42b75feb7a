"""Writes the suite: scenes as JSON, Mitsuba and pbrt scenes, the answers, and what to render."""

import json
import warnings
from pathlib import Path
from typing import Any

import raytrace
from raytrace.conformance.case import Case
from raytrace.conformance.cases import suite
from raytrace.errors import FileError, RaytraceError, printable
from raytrace.exporting.images import check_exr
from raytrace.files import write_whole
from raytrace.output_folder import check_folder, write

SCHEMA = "raytrace.conformance/1"  # of the answers; the number changes when a field changes its meaning or is removed
ANSWERS = "answers/answers.json"  # in a folder of its own: so all *.json of the suite are scenes
FORMATS = ("mitsuba", "pbrt")
README = """\
# {count} scenes whose light has a closed form

Written by raytrace {version}. The answers are in `{answers}`; the documentation derives them ("Closed forms").

## What to render

| | |
|---|---|
| scenes | `*.json` here, for Mitsuba 3 below `mitsuba/`, for pbrt-v4 below `pbrt/`; a renderer may leave out any |
| algorithm | path tracing, all light, up to `max_depth` surfaces (Mitsuba: `max_depth` + 1; the folder has it so) |
| size, samples | of the table below: `film.size` and `render.spp` of the JSON |
| filter | a box of one pixel |
| file | linear EXR (32 bits, R, G, B), or NPZ with an array `rgb` (h, w, 3), or 8-bit sRGB PNG |
| name | that of the scene, such as `{first}.exr`; images of other seeds are `{first}-1.exr`, `{first}-2.exr` ... |

Then `raytrace conformance DIR --images IMAGES` judges the images: DIR is this folder, IMAGES that of the images.
raytrace itself: `for s in DIR/*.json; do raytrace $s -o IMAGES/$(basename $s .json).npz; done`.

Fewer samples are allowed: an image whose noise could explain its error is not judged.

| scene | size | samples | max_depth | what it shows |
|---|---|---|---|---|
{rows}
{missing}"""


def write_suite(folder: Path) -> tuple[Path, ...]:
    """Write the suite into a folder; existing files of the same names are replaced.

    Parameters
    ----------
    folder : Path
        Created if it does not exist.

    Returns
    -------
    tuple of Path
        The scene files, the answers and the README.

    Raises
    ------
    FileError
        The folder or a file can't be written, or OpenEXR is missing.
    """
    check_exr()
    check_folder(folder)
    cases = suite()
    files: dict[str, bytes] = {}
    for case in cases:
        files |= case.files
        files[f"{case.name}.json"] = _json(scene_of(case))
    paths = write(folder, files)
    missing = {to: _export(folder, cases, to) for to in FORMATS}
    answers = {"schema": SCHEMA, "raytrace": raytrace.__version__, "scenes": [entry(case) for case in cases]}
    check_folder((folder / ANSWERS).parent)
    write_whole(folder / ANSWERS, _json(answers | {"not_exported": missing}))
    write_whole(folder / "README.md", _readme(cases, missing).encode())
    return (*paths, folder / ANSWERS, folder / "README.md")


def scene_of(case: Case) -> dict[str, Any]:
    """Return the content of a case's scene file, with its number of samples."""
    return {"about": case.about, **case.scene, "render": {**case.scene["render"], "spp": case.samples}}


def entry(case: Case) -> dict[str, Any]:
    """Return a case as JSON types, without its scene."""
    return {
        "name": case.name,
        "about": case.about,
        "derivation": case.section,
        "size": case.scene["film"]["size"],
        "samples": case.samples,
        "max_depth": case.scene["render"]["max_depth"],
        "regions": [region._asdict() for region in case.regions],
        "suspect": case.suspect,
        "causes": [cause._asdict() for cause in case.causes],
    }


def _json(content: Any) -> bytes:
    return (json.dumps(content, indent=1) + "\n").encode()


def _export(folder: Path, cases: tuple[Case, ...], to: str) -> dict[str, str]:
    """Write the scenes of another renderer; return those that it cannot express, with the reason."""
    from raytrace.exporting.export import export_scene

    missing = {}
    for case in cases:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                scene = raytrace.load(folder / f"{case.name}.json")
                export_scene(scene, to, folder / to / case.name, to in case.approximate)
        except FileError:
            raise
        except RaytraceError as error:
            missing[case.name] = str(error).removeprefix(f"{folder / case.name}.json: ")
    return missing


def _readme(cases: tuple[Case, ...], missing: dict[str, dict[str, str]]) -> str:
    rows = []
    for case in cases:
        (width, height), depth = case.scene["film"]["size"], case.scene["render"]["max_depth"]
        rows.append(f"| `{case.name}` | {width} x {height} | {case.samples} | {depth} | {case.about} |")
    lines = [f"- {to}: `{name}`: {printable(why)}" for to, names in missing.items() for name, why in names.items()]
    left_out = "\n## Scenes that other formats cannot express\n\n" + "\n".join(lines) + "\n" if lines else ""
    return README.format(
        count=len(cases),
        version=raytrace.__version__,
        answers=ANSWERS,
        first=cases[0].name,
        rows="\n".join(rows),
        missing=left_out,
    )
