"""Measure the frames per second of the live viewer while the mouse drags, in a real browser.

Run ``python tests/bench/live.py``. The measurement includes JupyterLab, its server, a kernel and a headless Chromium on
the same machine. A frame is an image on the canvas for a later mouse position than the previous one. Needs the extras
``notebook`` and ``browser``, and a Chromium.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, parser, show, table

sys.path.insert(0, str(ROOT / "tests"))
from browser import a_lab, a_page, run_all, why_not, write_notebook

SCENES = "cornell-box", "glass-sphere", "room", "prism"
CELL = """\
import os, raytrace as rt
os.chdir({root!r})
viewer = rt.show.live("scenes/{scene}.json", size=({side}, {side}))
viewer"""
SECONDS = 4.0  # of a drag


def drag(page: Any, seconds: float) -> float:
    """Frames a second while the hand moves."""
    canvas = page.locator(".raytrace-viewer canvas")
    box = canvas.bounding_box()
    x, y = box["x"] + 0.3 * box["width"], box["y"] + 0.4 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    began, before, steps = time.perf_counter(), int(canvas.get_attribute("data-frames")), 0
    while time.perf_counter() - began < seconds:
        steps += 1
        page.mouse.move(x + 80 * np.sin(steps / 20), y + 40 * np.sin(steps / 33))
        page.wait_for_timeout(8)  # ms: mice tell of themselves about a hundred times a second
    frames = int(canvas.get_attribute("data-frames")) - before
    passed = time.perf_counter() - began
    page.mouse.up()
    page.wait_for_timeout(500)
    canvas.and_(page.locator("[data-type='image/png']")).wait_for()
    return frames / passed


def main() -> None:
    options = parser(__doc__, rounds=5)
    options.add_argument("--side", type=int, default=256, help="pixels of the film's sides (%(default)s)")
    options = options.parse_args()
    if reason := why_not():
        sys.exit(reason)
    found = begin()
    rates: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder, a_lab(Path(folder)) as lab, a_page() as page:
        for scene in SCENES:
            cell = CELL.format(root=str(ROOT), scene=scene, side=options.side)
            write_notebook(Path(folder) / f"{scene}.ipynb", [cell])
            run_all(page, lab.format(f"{scene}.ipynb"))
            page.locator(".raytrace-viewer canvas[data-type='image/png']").wait_for()
            rates[scene] = [drag(page, SECONDS) for _ in range(options.rounds)]
    show(f"{options.side} x {options.side} pixels, {options.rounds} drags of {SECONDS:g} s\n")
    table(
        ["scene", "frames/s, median", "least", "most"],
        [(scene, float(np.median(each)), min(each), max(each)) for scene, each in rates.items()],
    )
    finish(options, found, {"frames_per_second": rates, "side": options.side})


if __name__ == "__main__":
    main()
