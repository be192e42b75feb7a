"""Make the plots of measurements, and the tables beside them: ``python docs/pictures/plots.py``; needs matplotlib.

A program of ``tests/bench`` writes ``measured/NAME.json`` with ``--json``. Between ``<!-- measured: BLOCK -->`` and
``<!-- end -->`` docs/benchmarks.md has the tables and plots of these files, so a table and its plot cannot differ. A
block whose file is missing stays as it is. With ``--page`` only the tables are written. A test compares them.
"""

import json
import math
import re
import sys
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PAGE, MEASURED = HERE.parent / "benchmarks.md", HERE / "measured"
OURS, COUNTS = "raytrace", (16, 64, 256)
LOOKS = {  # ray tracer: colour [Okabe2008], style of its curve
    OURS: ("#0072b2", "o-"),
    "Open3D": ("#e69f00", "s--"),
    "Mitsuba": ("#009e73", "v--"),
    "Mitsuba, coherent": ("#d55e00", "^--"),
}
SAMPLERS = {  # of the plot of errors: name, colour, style
    "sobol, float32": ("sobol", "#0072b2", "o-"),
    "sobol, adaptive, float32": ("adaptive", "#cc79a7", "*-"),
    "stratified, float32": ("stratified", "#009e73", "s-"),
    "independent, float32": ("independent", "#d55e00", "^-"),
    "Mitsuba multijitter, float32": ("Mitsuba multijitter", "#000000", "v--"),
}


def table(header: list[str], rows: Iterable[list[str]]) -> str:
    """A Markdown table."""
    return "\n".join("| " + " | ".join(row) + " |" for row in [header, *rows]).replace(
        "\n", "\n|" + "---|" * len(header) + "\n", 1
    )


def digits(x: float, count: int) -> str:
    """So many digits, or all before the point."""
    if not math.isfinite(x):
        return "-"
    return f"{x:.{max(0, count - 1 - math.floor(math.log10(abs(x))))}f}"


def power(x: float, decimals: int) -> str:
    """With a power of ten of one digit, as 1.4e-4."""
    return re.sub(r"e([+-])0", r"e\1", f"{x:.{decimals}e}")


def growth_table(results: Any) -> str:
    """Nanoseconds per camera ray and seconds per build, by the number of triangles."""
    first = results[0]
    names = list(first["ns_per_ray"])
    rows = []
    for row in results:
        ns = row["ns_per_ray"]
        ratios = ns[OURS] / first["ns_per_ray"][OURS], math.log(row["triangles"]) / math.log(first["triangles"])
        numbers = [row["build_seconds"], *(ns[name] for name in names)]
        shown = [f"{x:.3g}" if x < 100 else f"{x:.0f}" for x in numbers]
        rows.append([f"{row['triangles']:,}", *shown, *(digits(x, 2) for x in ratios)])
    return table(["triangles", "build, s", *names, f"{OURS} / its first", "log n / its first"], rows)


def growth_plot(results: Any, axes: Any) -> None:
    """Time per ray against triangles."""
    count = [row["triangles"] for row in results]
    for name in results[0]["ns_per_ray"]:
        colour, style = LOOKS[name]
        axes.plot(count, [row["ns_per_ray"][name] for row in results], style, color=colour, label=name)
    first = results[0]["ns_per_ray"][OURS]
    axes.plot(
        count, [first * math.log(n) / math.log(count[0]) for n in count], "k:", label=f"log n, from {OURS}'s first"
    )
    axes.set(xscale="log", yscale="log", xlabel="triangles", ylabel="ns per camera ray, all cores")


def box(results: Any) -> Any:
    """What was measured on the Cornell box."""
    return results["cornell-box"]


def errors_table(results: Any) -> str:
    """Errors at equal samples, and the slopes between neighbouring columns."""
    rows = []
    points = box(results)["points"]
    for name in dict.fromkeys(point["way"]["name"] for point in points if not point["way"]["adaptive"]):
        row = [next(p for p in points if p["way"]["name"] == name and p["spp"] >= count) for count in COUNTS]
        taken = [f"{p['spp']:g}" for p in row]
        label = sampler(name) + ("" if taken == [str(n) for n in COUNTS] else f" ({', '.join(taken)} spp)")
        slopes = [math.log(b["rmse_srgb"] / a["rmse_srgb"]) / math.log(b["spp"] / a["spp"]) for a, b in pairwise(row)]
        numbers = [power(p["rmse_srgb"], 2) for p in row]
        rows.append([label, *numbers, *(f"{slope:.2f}" for slope in slopes)])
    return table(["samples per pixel", *map(str, COUNTS), *(f"slope {a} to {b}" for a, b in pairwise(COUNTS))], rows)


def sampler(name: str) -> str:
    """The name of a sampler, as the tables write it."""
    peer, word = re.fullmatch(r"(Mitsuba )?([\w ]+).*", name).groups()  # type: ignore[union-attr]
    return f"{peer or ''}`{word}`"


def times_table(results: Any) -> str:
    """Seconds and samples to reach an error, and their ratios."""
    rows = box(results)["ratios"]
    header = [
        "error",
        "Mitsuba, its best sampler",
        "`sobol`",
        "adaptive",
        "Mitsuba / adaptive",
        "Mitsuba / `sobol`",
        "`sobol` / adaptive",
    ]
    lines = []
    for row in rows:
        costs = [(row[f"{way} s"], row[f"{way} spp"]) for way in ("peer", "uniform", "adaptive")]
        ways = [f"{s:.3f} s, {spp:.3g} spp" if math.isfinite(spp) else "-" for s, spp in costs]
        if row["peer"]:
            ways[0] = f"{sampler(row['peer']).removeprefix('Mitsuba ')}, {ways[0]}"
        ratios = [digits(row[ratio], 2) for ratio in ("peer / adaptive", "peer / uniform", "uniform / adaptive")]
        lines.append([power(row["error"], 1).replace(".0e", "e"), *ways, *ratios])
    return table(header, lines)


def times_plot(results: Any, axes: Any) -> None:
    """Error against time."""
    for way, (label, colour, style) in SAMPLERS.items():
        points = [point for point in box(results)["points"] if point["way"]["name"] == way]
        if points:
            at = [[point[field] for point in points] for field in ("seconds", "rmse_srgb")]
            axes.plot(*at, style, color=colour, label=label)
    axes.set(xscale="log", yscale="log", xlabel="seconds per image", ylabel="RMSE on a screen (sRGB)")


Plot = Callable[[Any, Any], None]
BLOCKS: dict[str, tuple[str, Callable[[Any], str], Plot | None, str]] = {  # block: file, table, plot, its text
    "growth": ("growth", growth_table, growth_plot, "Nanoseconds per camera ray against triangles"),
    "errors": ("error", errors_table, None, ""),
    "times": ("error", times_table, times_plot, "Error against time on the Cornell box, for raytrace and Mitsuba"),
}  # fmt: skip


def filled(text: str, folder: Path = MEASURED) -> str:
    """The page with the tables of all files that there are."""
    for block, (name, rows, plot, alt) in BLOCKS.items():
        if (folder / f"{name}.json").exists():
            made = rows(json.loads((folder / f"{name}.json").read_text("utf-8"))["results"])
            made += f"\n\n![{alt}](pictures/{block}.png)" if plot else ""
            text, count = re.subn(
                rf"(<!-- measured: {block} -->\n).*?(<!-- end -->)",
                lambda match, made=made: f"{match[1]}\n{made}\n\n{match[2]}",
                text,
                flags=re.DOTALL,
            )
            if count != 1:
                raise ValueError(f"{PAGE.name} has no block '{block}'")
    return text


def draw(block: str) -> None:
    """Write the plot of a block."""
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    name, _, plot, _ = BLOCKS[block]
    with mpl.rc_context({"font.size": 13, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure((8, 5), layout="constrained")
        axes = figure.add_subplot()
        if plot:
            plot(json.loads((MEASURED / f"{name}.json").read_text("utf-8"))["results"], axes)
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3)
        axes.legend(fontsize=12, frameon=False)
        figure.savefig(HERE / f"{block}.png", dpi=100)


def main() -> None:
    PAGE.write_text(filled(PAGE.read_text("utf-8")), "utf-8")
    for block, (name, _, plot, _) in BLOCKS.items():
        if plot and (MEASURED / f"{name}.json").exists() and "--page" not in sys.argv:
            draw(block)


if __name__ == "__main__":
    main()
