"""Number of cores that this process may use: its CPU affinity, and the CPU quota of its container."""

import contextlib
import math
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PROC, CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")


def usable() -> int:
    """Return the number of cores that this process may use, at least 1: a quota of 1.5 cores counts as 2."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(allowed, math.ceil(min(quota(), allowed))))


@cache
def quota() -> float:
    """Return the smallest CPU quota, in cores, of the control groups of this process; inf if there is none."""
    return min(_quotas(), default=math.inf)


def _quotas() -> Iterator[float]:
    with contextlib.suppress(OSError, ValueError):
        for line in (PROC / "self/cgroup").read_text().splitlines():
            number, controllers, path = line.split(":", 2)
            within = Path(path.lstrip("/"))
            for group in (within, *within.parents):
                if number == "0":
                    yield from _version_2(CGROUPS / group)
                elif "cpu" in controllers.split(","):  # mounted under its own name, or under all names of its line
                    for folder in dict.fromkeys(("cpu", controllers)):
                        yield from _version_1(CGROUPS / folder / group)


def _version_2(group: Path) -> Iterator[float]:
    """Read the quota of a group from its file, "QUOTA PERIOD" in microseconds or "max PERIOD"."""
    with contextlib.suppress(OSError, ValueError):
        most, period = (group / "cpu.max").read_text().split()
        if most != "max":
            yield int(most) / max(int(period), 1)


def _version_1(group: Path) -> Iterator[float]:
    """Read the quota of a group from two files, in microseconds; -1 means no quota."""
    with contextlib.suppress(OSError, ValueError):
        most = int((group / "cpu.cfs_quota_us").read_text())
        if most > 0:
            yield most / max(int((group / "cpu.cfs_period_us").read_text()), 1)
