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
    cpu: float | None  # seconds of its threads: steadier on a busy machine; None where the system does not tell
    peak_mb: float | None  # most memory it held; None where the system does not tell, or it is less than this process
    output: str


def run(*words: str, cache: Path) -> Outcome:
    """A process of this Python, with a kernel cache of its own."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"RAYTRACE_CACHE": str(cache), "PYTHONPATH": path}
    began = time.perf_counter()
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen([sys.executable, *words], cwd=ROOT, env=environment, stdout=output)
        cpu, peak = wait(process)
        seconds = time.perf_counter() - began
        if process.returncode:
            raise SystemExit(f"{' '.join(words)}: exit code {process.returncode}")
        output.seek(0)
        return Outcome(seconds, cpu, peak, output.read())


def wait(process: subprocess.Popen) -> tuple[float | None, float | None]:
    """CPU seconds and peak memory of a process, at its end."""
    if not hasattr(os, "wait4"):
        process.wait()
        return None, None
    import resource

    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # a child is counted with its parent's until it starts
    unit = 1 << 20 if sys.platform == "darwin" else 1 << 10
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / unit if usage.ru_maxrss > own else None


def drawing(spp: int, folder: Path) -> list[str]:
    return ["-m", "raytrace", SCENE, "--size", "256x256", "--spp", f"{spp}", "--quiet", "-o", f"{folder}/box.png"]


def main() -> None:
    args = parser(__doc__, rounds=7).parse_args()
    found = begin()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cache = folder / "kernels"
        first = [run(*drawing(4, folder), cache=folder / f"empty{k}") for k in range(3)]
        run(*drawing(4, folder), cache=cache)
        repeated = {
            "draw, second time": drawing(4, folder),
            "draw at 64 spp": drawing(64, folder),
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
    rows = [
        [name, *(middle(column) for column in list(zip(*all_, strict=True))[:3])] for name, all_ in outcomes.items()
    ]
    rows.append(["draw in a warm process", warm, None, None])
    table(["process", "seconds", "CPU seconds", "peak MB"], rows)
    names = "process", "seconds", "cpu_seconds", "peak_mb"
    finish(args, found, [dict(zip(names, row, strict=True)) for row in rows])


def middle(values: tuple[float | None, ...]) -> float | None:
    return None if None in values else statistics.median(values)


if __name__ == "__main__":
    main()
