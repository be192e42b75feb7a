"""How many cores a process may use: affinity, and the CPU quota of containers, of both versions of control groups."""

import math
import os

import pytest

from raytrace import cores, doctor
from raytrace.parallel import thread_count

pytestmark = pytest.mark.nojit


@pytest.fixture
def machine(monkeypatch, tmp_path):
    """A machine of 64 cores; the fixture writes files of control groups and returns the quota."""
    monkeypatch.setattr(cores, "PROC", tmp_path / "proc")
    monkeypatch.setattr(cores, "CGROUPS", tmp_path / "groups")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(64), raising=False)
    (tmp_path / "proc/self").mkdir(parents=True)

    def write(groups, **files):
        (tmp_path / "proc/self/cgroup").write_text(groups)
        for name, content in files.items():
            path = tmp_path / "groups" / name.replace("__", "/").replace("_dot_", ".")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
        cores.quota.cache_clear()
        return cores.quota()

    cores.quota.cache_clear()
    yield write
    cores.quota.cache_clear()


@pytest.mark.parametrize(
    ("quota", "threads"), [("50000", 1), ("100000", 1), ("150000", 2), ("200000", 2), ("9900000", 64), ("max", 64)]
)
def test_threads_follow_the_quota_of_version_2(machine, quota, threads):
    machine("0::/job\n", job__cpu_dot_max=f"{quota} 100000\n")
    assert thread_count(None) == threads
    assert thread_count(7) == 7  # as asked


def test_the_smallest_quota_above_counts(machine):
    files = {"a__b__cpu_dot_max": "max 100000\n", "a__cpu_dot_max": "300000 100000\n", "cpu_dot_max": "80 10\n"}
    assert machine("0::/a/b\n", **files) == 3


@pytest.mark.parametrize("controllers", ["cpu", "cpu,cpuacct", "cpuacct,cpu"])
def test_threads_follow_the_quota_of_version_1(machine, controllers):
    files = {"cpu.cfs_quota_us": "250000\n", "cpu.cfs_period_us": "100000\n"}
    files = {f"{controllers}__job__{name}": content for name, content in files.items()}
    assert machine(f"9:name=systemd:/x\n4:{controllers}:/job\n3:memory:/job\n0::/\n", **files) == 2.5
    assert thread_count(None) == 3


def test_a_container_that_sees_its_own_group_as_the_root_has_its_quota(machine):
    files = {"cpu__cpu.cfs_quota_us": "100000\n", "cpu__cpu.cfs_period_us": "50000\n"}
    assert machine("1:cpu:/docker/0123\n", **files) == 2


@pytest.mark.parametrize(
    ("groups", "files"),
    [
        ("", {}),
        ("no such line\n", {}),
        ("0::/\n", {"cpu_dot_max": "nonsense\n"}),
        ("0::/\n", {"cpu_dot_max": "max 100000\n"}),
        ("1:cpu:/\n", {"cpu__cpu.cfs_quota_us": "-1\n", "cpu__cpu.cfs_period_us": "100000\n"}),
        ("1:cpuset:/\n", {"cpuset__cpu.cfs_quota_us": "100\n", "cpuset__cpu.cfs_period_us": "100\n"}),
    ],
)
def test_without_a_quota_all_cores_are_used(machine, groups, files):
    assert machine(groups, **files) == math.inf
    assert thread_count(None) == 64


def test_no_quota_gives_more_cores_than_the_process_may_use(machine, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3}, raising=False)
    machine("0::/\n", cpu_dot_max="800000 100000\n")
    assert thread_count(None) == 1


def test_doctor_names_the_quota(machine):
    machine("0::/\n", cpu_dot_max="150000 100000\n")
    assert dict(doctor.findings())["cores"] == f"2 usable of {os.cpu_count()} (CPU quota: 1.5)"
