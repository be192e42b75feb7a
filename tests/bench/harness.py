"""Shared by all benchmarks: interleaved repetitions, ratios, tables, and a description of the machine."""

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
    """Return a parser with the options of every benchmark."""
    made = ArgumentParser(description=about)
    made.add_argument(
        "--rounds", type=int, default=rounds, help="interleaved repetitions, whose median counts (%(default)s)"
    )
    made.add_argument("--json", type=Path, metavar="FILE", help="also write all numbers to this file")
    return made


def show(line: str = "") -> None:
    print(line, flush=True)  # noqa: T201  (the only print of the benchmarks)


def interleave(calls: Mapping[Any, Callable[[], Any]], rounds: int, pause: float = 0.0) -> dict[Any, np.ndarray]:
    """Time calls in turn, with a pause in seconds before each, and return seconds as (rounds,) arrays.

    One call of each is not measured. Every second round runs in reverse order.
    """
    for call in calls.values():
        call()
    seconds: dict[Any, list[float]] = {name: [] for name in calls}
    for k in range(rounds):
        for name in list(calls)[:: 1 - 2 * (k % 2)]:
            time.sleep(pause)
            began = time.perf_counter()
            calls[name]()
            seconds[name].append(time.perf_counter() - began)
    return {name: np.array(times) for name, times in seconds.items()}


def times_faster(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return the median of the rounds' ratios: noise that affects both sides of a round cancels."""
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
    """Print and return a description of the machine."""
    found = machine()
    for name, value in found.items():
        show(f"{name}: {value}")
    show()
    return found


def machine() -> dict[str, Any]:
    """Return processor, caches, memory, cores, versions, commit, and the load of the machine."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory": _memory(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
        "LLVM of Mitsuba": os.environ.get("DRJIT_LIBLLVM_PATH", "unknown"),
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
    model = f"family {fields.get('cpu family')} model {fields.get('model')} stepping {fields.get('stepping')}"
    threads = int(fields.get("siblings", 1)) // max(int(fields.get("cpu cores", 1)), 1)
    clock = f"{fields.get('cpu MHz')} MHz (as the system states it)"
    return f"{fields['model name']}, {model}, {clock}, {threads} thread(s) per core, {', '.join([*simd, *_caches()])}"


def _caches() -> list[str]:
    """Return the caches of the first core, where Linux lists them."""
    folders = sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*"))
    return [
        f"L{_text(folder / 'level')} {_text(folder / 'type').lower()} {_text(folder / 'size')}" for folder in folders
    ]


def _memory() -> str:
    """Return the size of the physical memory."""
    if not hasattr(os, "sysconf") or "SC_PHYS_PAGES" not in os.sysconf_names:
        return "unknown"
    return f"{os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30:.1f} GiB"


def _text(path: Path) -> str:
    return path.read_text().strip() if path.exists() else "?"


def _git(*words: str) -> str:
    try:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def finish(args: Namespace, found: dict[str, Any], results: Any) -> None:
    """Write the JSON file, if one was requested."""
    if args.json:
        content = {"command": sys.argv, "machine": found, "results": results}
        args.json.write_text(json.dumps(content, indent=1) + "\n")
        show(f"wrote {args.json}")
