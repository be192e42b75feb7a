"""Results of the suite of hard cases as tables, Markdown and JSON."""

import json
import math
import re
from pathlib import Path
from typing import Any

import raytrace
from raytrace.hardcases.judge import BACKWARD
from raytrace.hardcases.suite import Outcome, Score
from raytrace.output_folder import write as write_files

SCHEMA = "raytrace.hard-cases/1"  # of the JSON file; the number changes when a field changes its meaning or is removed
LEGEND = """\
w: a hit or miss that contradicts the exact answer beyond a backward error of {bound} eps x distance; l: a leak, between
neighbours of equal facing or out of a closed mesh; s: a lit point that shadows itself; t: light through a wall; a dash:
not run, because the tracer has no tmin and tmax."""

KINDS = {  # kinds of cases, and the pattern of their names
    "closed meshes from inside, at edges and vertices": ", from inside$",
    "closed meshes from outside, at edges and vertices": ", from outside$",
    "lattice rays, along axes, in slab planes": "^lattice|^axes",
    "components denormal or all but zero": "^denormal|^all but along",
    "origins on surfaces and in box planes": "^origins (on|in)",
    "triangles without area": "^no area",
    "slivers, aspect 1e6 to 1e9": "^slivers",
    "sizes 1e-12 to 1e12": "^scale",
    "translations 10 to 1e7": "^translation",
    "origins 1e2 to 1e12 away": "^origins .* away",
    "directions 1e-20 to 1e20 long": "^directions",
    "grazing at 1e-7 rad": "^grazing",
    "huge beside tiny": "^huge",
    "overlaps and 10,000 duplicates": "overlaps$|duplicates$",
    "intervals, rays not finite": "interval$|not finite$",
    "shadow rays from lit floors and spheres": "^lit",
    "a wall 1e-4 of the scene before the point": "^wall at (the|a) floor",
    "a wall 1e-4 of the scene before the light": "^wall at the light",
    "shadow rays to a light on a ceiling": "^light on",
}


EXTREME = r"\b(scale|by|translation|origins|directions) 1e[+-](0[6-9]|[1-9]\d)\b"  # names of cases with extreme values


def failures(score: Score | None) -> str:
    """Format the failures of one case for a cell.

    >>> failures(Score(100, 3, 2, 0, 0, 1e-7, 1e-7)), failures(Score(100, 0, 0, 0, 0, 1e-7, 1e-7)), failures(None)
    ('3w 2l', '0', '-')
    """
    if score is None:
        return "-"
    return " ".join(f"{count}{letter}" for count, letter in zip(score[1:5], "wlst", strict=True) if count) or "0"


def _error(error: float) -> str:
    return "-" if math.isnan(error) else f"{error:.1e}"


def totals_table(outcome: Outcome) -> list[list[str]]:
    """One row per tracer: rays, failures by type, largest errors."""
    header = ["", "rays", "wrong (w)", "leaks (l)", "self-shadows (s)", "through walls (t)", "worst t", "worst u, v"]
    rows = [(f"{tracer.name} ({tracer.version})", outcome.total(tracer)) for tracer in outcome.tracers]
    return [header, *([name, *map(str, score[:5]), *map(_error, score[5:])] for name, score in rows)]


def moderate(outcome: Outcome) -> Outcome:
    """Results without the cases whose sizes, distances, translations or lengths are 1e6 or more, or 1e-6 or less."""
    cases = tuple(case for case in outcome.cases if not re.search(EXTREME, case.name))
    names = {case.name for case in cases}
    scores = {key: score for key, score in outcome.scores.items() if key[0] in names}
    return outcome._replace(cases=cases, scores=scores)


def kinds_table(outcome: Outcome) -> list[list[str]]:
    """One row per kind of case: number of rays, and the failures of each tracer."""
    rows = [["", "rays", *(tracer.name for tracer in outcome.tracers)]]
    for kind, pattern in KINDS.items():
        names = {case.name for case in outcome.cases if re.search(pattern, case.name)}
        if not names:
            continue
        scores = {key: score for key, score in outcome.scores.items() if key[0] in names}
        totals = [outcome._replace(scores=scores).total(tracer) for tracer in outcome.tracers]
        found = [failures(total if total.rays else None) for total in totals]
        rows.append([kind, str(max(total.rays for total in totals)), *found])
    return rows


def failures_table(outcome: Outcome) -> list[list[str]]:
    """One row per case: number of rays, and the failures of each tracer."""
    rows = [["", "rays", *(tracer.name for tracer in outcome.tracers)]]
    for case in outcome.cases:
        found = [outcome.scores.get((case.name, tracer.name)) for tracer in outcome.tracers]
        rows.append([case.name, str(max(score.rays for score in found if score)), *map(failures, found)])
    return rows


def errors_table(outcome: Outcome) -> list[list[str]]:
    """One row per case with well-conditioned hits: largest relative error of t / largest error of u, v per tracer."""
    rows = [["", *(tracer.name for tracer in outcome.tracers)]]
    for case in outcome.cases:
        found = [outcome.scores.get((case.name, tracer.name)) for tracer in outcome.tracers]
        cells = [f"{_error(score.t_error)} / {_error(score.uv_error)}" if score else "-" for score in found]
        if set(cells) - {"-", "- / -"}:
            rows.append([case.name, *cells])
    return rows


def text_table(rows: list[list[str]], markdown: bool = False) -> str:
    """Format rows, the header first, for a terminal or as Markdown."""
    width = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = [[text.ljust(n) if k == 0 else text.rjust(n) for k, (text, n) in enumerate(zip(row, width, strict=True))]
             for row in rows]  # fmt: skip
    if not markdown:
        return "\n".join("  ".join(line).rstrip() for line in lines)
    lines.insert(1, ["-" * n if k == 0 else "-" * (n - 1) + ":" for k, n in enumerate(width)])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def legend(outcome: Outcome) -> str:
    """Explain the letters, and list the tracers that were not run."""
    absent = "".join(f"\n\nNot run: {name}: {reason}" for name, reason in outcome.missing.items())
    return LEGEND.format(bound=BACKWARD) + absent


def text(outcome: Outcome) -> str:
    """Format failures and totals for a terminal."""
    tables = text_table(failures_table(outcome)), text_table(totals_table(outcome))
    return "\n\n".join([*tables, legend(outcome)])


def markdown(outcome: Outcome) -> str:
    """Format all tables as a Markdown page."""
    parts = [
        f"# Hard cases, raytrace {raytrace.__version__}",
        text_table(totals_table(outcome), markdown=True),
        "## Totals without sizes, distances, translations and lengths of 1e6 or more, or 1e-6 or less",
        text_table(totals_table(moderate(outcome)), markdown=True),
        "## Failures by kind of case",
        text_table(kinds_table(outcome), markdown=True),
        "## Failures by case",
        legend(outcome),
        text_table(failures_table(outcome), markdown=True),
        "## Worst errors of well-conditioned hits: t, relative / u and v",
        text_table(errors_table(outcome), markdown=True),
    ]
    return "\n\n".join(parts) + "\n"


def as_json(outcome: Outcome) -> dict[str, Any]:
    """All numbers as JSON values; NaN becomes null."""

    def plain(score: Score) -> dict[str, int | float | None]:
        return {name: None if value != value else value for name, value in score._asdict().items()}

    return {
        "schema": SCHEMA,
        "raytrace": raytrace.__version__,
        "backward_error": BACKWARD,
        "tracers": [
            {"name": t.name, "version": t.version, "precision": t.dtype.name, "total": plain(outcome.total(t)),
             "total_without_extremes": plain(moderate(outcome).total(t))}
            for t in outcome.tracers
        ],
        "missing": dict(outcome.missing),
        "cases": [
            {"name": case.name, "seed": case.seed, "must": case.must,
             "scores": {t.name: plain(outcome.scores[key]) for t in outcome.tracers
                        if (key := (case.name, t.name)) in outcome.scores}}
            for case in outcome.cases
        ],
    }  # fmt: skip


def write(outcome: Outcome, folder: Path) -> tuple[Path, ...]:
    """Write ``hard-cases.json`` and ``hard-cases.md`` into a folder, each completely or not at all."""
    texts = {"hard-cases.json": json.dumps(as_json(outcome), indent=1) + "\n", "hard-cases.md": markdown(outcome)}
    return write_files(folder, {name: text.encode() for name, text in texts.items()})
