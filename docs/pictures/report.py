"""Measure the Cornell box, and write the plot of docs/report.md: ``python docs/pictures/report.py``.

It takes about two minutes. Run it while nothing else uses the machine: the plot shows times. ``--json FILE`` keeps the
numbers.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import raytrace as rt

HERE = Path(__file__).parent
SCENE = HERE.parents[1] / "scenes" / "cornell-box.json"
BUDGET = 120.0  # s


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        report = rt.report(SCENE, folder, budget=BUDGET)
        shutil.copyfile(Path(folder) / "error-against-time.png", HERE / "report-cornell-box.png")
        if len(sys.argv) == 3 and sys.argv[1] == "--json":
            shutil.copyfile(Path(folder) / "report.json", sys.argv[2])
    print(report)


if __name__ == "__main__":
    main()
