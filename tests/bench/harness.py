"""What all benches share: interleaved rounds, ratios, tables, and on what they ran."""

import json
import os
import platform
import subprocess
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
PACKAGES = "raytrace", "numpy", "numba", "llvmlite", "open3d", "mitsuba", "drjit", "embreex"


def parser(about: str, rounds: int = 9) -> ArgumentParser:
    """Options that every bench has."""
    made = ArgumentParser(description=about)
    made.add_argument("--rounds", type=int, default=rounds, help="interleaved rounds; medians are taken (%(default)s)")
    made.add_argument("--json", type=Path, metavar="FILE", help="write all numbers there too")
    return made


def show(line: str = "") -> None:
    print(line, flush=True)  # noqa: T201  (the benches' only print)


def interleave(calls: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, np.ndarray]:
    """Seconds of each call, (rounds,) arrays: all in turn, each round in the other order, after one call unmeasured."""
    for call in calls.values():
        call()
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for k in range(rounds):
        for name in list(calls)[:: 1 - 2 * (k % 2)]:
            began = time.perf_counter()
            calls[name]()
            seconds[name].append(time.perf_counter() - began)
    return {name: np.array(times) for name, times in seconds.items()}


def times_faster(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Median of the rounds' ratios: what one round's noise does to both sides cancels."""
    return float(np.median(theirs / ours))


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Print a Markdown table, numbers to three digits."""
    cells = [list(header), *([_cell(value) for value in row] for row in rows)]
    width = [max(len(row[k]) for row in cells) for k in range(len(header))]
    cells.insert(1, ["-" * n for n in width])
    for row in cells:
        show("| " + " | ".join(text.ljust(n) for text, n in zip(row, width, strict=True)) + " |")
    show()


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if not isinstance(value, float):
        return str(value)
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def begin() -> dict[str, Any]:
    """Say, and return, on what the bench runs."""
    found = machine()
    for name, value in found.items():
        show(f"{name}: {value}")
    show()
    return found


def machine() -> dict[str, Any]:
    """Processor, cores, versions, commit, and how busy the machine already is."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
        "commit": _git("rev-parse", "--short", "HEAD") + (" with edits" if _git("status", "--porcelain") else ""),
        "date": time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    }


def _processor() -> str:
    about = Path("/proc/cpuinfo")
    fields = (
        dict(line.split(":", 1) for line in about.read_text().splitlines() if ":" in line) if about.exists() else {}
    )
    fields = {name.strip(): value.strip() for name, value in fields.items()}
    if "model name" not in fields:
        return platform.processor() or platform.machine()
    simd = [name for name in ("avx2", "avx512f") if name in fields.get("flags", "").split()]
    return f"{fields['model name']}, model {fields.get('model')} ({', '.join(simd)})"


def _git(*words: str) -> str:
    try:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def finish(args: Namespace, found: dict[str, Any], results: Any) -> None:
    """Write the JSON file that was asked for."""
    if args.json:
        content = {"command": sys.argv, "machine": found, "results": results}
        args.json.write_text(json.dumps(content, indent=1) + "\n")
        show(f"wrote {args.json}")
