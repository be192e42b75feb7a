"""Plot error against time from several ``report.json`` files, one panel per scene."""

import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from harness import show
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

LOOKS = {  # sampler, adaptive: name, colour, marker
    ("sobol", False): ("sobol", "#0072b2", "o"),
    ("stratified", False): ("stratified", "#009e73", "s"),
    ("independent", False): ("independent", "#d55e00", "^"),
    ("sobol", True): ("sobol, adaptive", "#cc79a7", "*"),
}


def panel(axes: Any, report: dict[str, Any]) -> None:
    """Plot the samplers' curves of one report, in the default precision of the scene."""
    usual = report["points"][0]["way"]
    for (sampler, adaptive), (name, colour, marker) in LOOKS.items():
        way = {**usual, "sampler": sampler, "adaptive": adaptive}
        points = [point for point in report["points"] if {**point["way"], "name": usual["name"]} == way]
        at = [[point[field] for point in points] for field in ("seconds", "rmse_srgb")]
        axes.plot(*at, color=colour, marker=marker, markersize=5, label=name)
    scene = report["scene"]
    axes.set_title(f"{scene['name']}, {scene['triangles']:,} triangles", fontsize=10)
    axes.set(xscale="log", yscale="log")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)


def main() -> None:
    options = ArgumentParser(description=__doc__)
    options.add_argument("reports", nargs="+", type=Path, help="report.json files")
    options.add_argument("-o", "--output", type=Path, default=Path("error-against-time.png"), help="(%(default)s)")
    args = options.parse_args()
    columns = min(4, len(args.reports))
    rows = -(-len(args.reports) // columns)
    figure = Figure((3.4 * columns, 3 * rows + 0.6), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, path in zip(grid, args.reports, strict=False):
        panel(axes, json.loads(path.read_text("utf-8")))
    for axes in grid[len(args.reports) :]:
        axes.remove()
    figure.supxlabel("seconds per image", fontsize=11)
    figure.supylabel("RMSE on a screen (sRGB)", fontsize=11)
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(LOOKS), fontsize=10)
    figure.savefig(args.output, dpi=90)
    show(f"wrote {args.output}")


if __name__ == "__main__":
    main()
