"""Seconds and memory of whole processes, as a shell sees them, first with an empty kernel cache."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from harness import ROOT, begin, finish, parser, show, table

SCENE = "scenes/cornell-box.json"
WARM = f"""
import json, statistics, time
import raytrace as rt
scene = rt.load({SCENE!r})
seconds = []
for _ in range(21):
    began = time.perf_counter()
    rt.render(scene, size=(256, 256), spp=4)
    seconds.append(time.perf_counter() - began)
print(json.dumps(statistics.median(seconds[1:])))
"""


class Outcome(NamedTuple):
    """What one process took."""

    seconds: float
    peak_mb: float | None  # most memory it held; None where the system does not tell
    output: str


def run(*words: str, cache: Path) -> Outcome:
    """A process of this Python, with a kernel cache of its own."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"RAYTRACE_CACHE": str(cache), "PYTHONPATH": path}
    began = time.perf_counter()
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen([sys.executable, *words], cwd=ROOT, env=environment, stdout=output)
        if hasattr(os, "wait4"):
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            peak = usage.ru_maxrss / (1 << 20 if sys.platform == "darwin" else 1 << 10)
        else:
            process.wait()
            peak = None
        seconds = time.perf_counter() - began
        if process.returncode:
            raise SystemExit(f"{' '.join(words)}: exit code {process.returncode}")
        output.seek(0)
        return Outcome(seconds, peak, output.read())


def drawing(spp: int, size: int, folder: Path) -> list[str]:
    return ["-m", "raytrace", SCENE, "--size", f"{size}x{size}", "--spp", f"{spp}", "-q", "-o", f"{folder}/box.png"]


def main() -> None:
    args = parser(__doc__, rounds=7).parse_args()
    found = begin()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cache = folder / "kernels"
        first = [run(*drawing(4, 256, folder), cache=folder / f"empty{k}") for k in range(3)]
        run(*drawing(4, 256, folder), cache=cache)
        repeated = {
            "draw, second time": drawing(4, 256, folder),
            "draw at 64 spp": drawing(64, 256, folder),
            "import raytrace": ["-c", "import raytrace"],
            "--help": ["-m", "raytrace", "--help"],
            "python alone": ["-c", ""],
        }
        outcomes = {"draw, empty kernel cache": first}
        outcomes |= {name: [] for name in repeated}
        for _ in range(args.rounds):
            for name, words in repeated.items():
                outcomes[name].append(run(*words, cache=cache))
        warm = json.loads(run("-c", WARM, cache=cache).output)
    show(f"{SCENE}, 256 x 256, 4 spp unless it says otherwise; medians of processes:\n")
    rows = [[name, statistics.median(o.seconds for o in all_), max(o.peak_mb or 0 for o in all_) or None]
            for name, all_ in outcomes.items()]  # fmt: skip
    rows.append(["draw in a warm process", warm, None])
    table(["process", "seconds", "peak MB"], rows)
    finish(args, found, [dict(zip(("process", "seconds", "peak_mb"), row, strict=True)) for row in rows])


if __name__ == "__main__":
    main()
