"""``python tests/screenshot.py``: draw docs/pictures/live.png anew, which shows rt.show.live in a browser."""

import sys
import tempfile
from pathlib import Path

from browser import ROOT, a_lab, a_page, run_all, why_not, write_notebook

CELL = 'import raytrace as rt\n\nrt.show.live("scenes/glass-sphere.json")'
PIXEL = 0.42, 0.74  # of the picture's width and height: in the glass ball


def main() -> None:
    if reason := why_not():
        sys.exit(reason)
    with tempfile.TemporaryDirectory() as folder, a_lab(Path(folder)) as lab, a_page(1100, 1180) as page:
        (Path(folder) / "scenes").symlink_to(ROOT / "scenes")
        write_notebook(Path(folder) / "live.ipynb", [CELL])
        run_all(page, lab.format("live.ipynb"))
        page.get_by_role("tab", name="File Browser").click()  # away with it
        whole = page.locator(".raytrace-viewer canvas[data-type='image/png']")
        whole.wait_for()
        page.get_by_label("index of glass").fill("1.33")
        page.wait_for_timeout(1000)
        whole.wait_for()
        box = whole.bounding_box()
        page.mouse.click(box["x"] + PIXEL[0] * box["width"], box["y"] + PIXEL[1] * box["height"])
        page.locator(".raytrace-viewer .path table").first.wait_for()
        page.wait_for_timeout(1000)  # until its picture is decoded
        page.screenshot(path=ROOT / "docs" / "pictures" / "live.png")


if __name__ == "__main__":
    main()
