"""The lock file of development: whole, pinned, with checksums, and as the project's bounds want it."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
LOCK = (ROOT / ".ci/dev.lock").read_text("utf-8")
pytestmark = pytest.mark.nojit


def pinned() -> dict[str, set[str]]:
    """Versions of each package; several where they depend on the machine."""
    found: dict[str, set[str]] = {}
    for name, version in re.findall(r"^([\w.-]+)==([^ ;\\]+)", LOCK, re.M):
        found.setdefault(canonicalize_name(name), set()).add(version)
    return found


def needed() -> list[Requirement]:
    extras = [line for name, lines in EXTRAS.items() if name != "bench" for line in lines]
    return [Requirement(line) for line in [*PROJECT["dependencies"], *extras]]


@pytest.mark.parametrize("need", needed(), ids=str)
def test_what_is_needed_is_pinned_within_its_bounds(need):
    versions = pinned()[canonicalize_name(need.name)]
    assert all(need.specifier.contains(version) for version in versions)


@pytest.mark.parametrize("need", needed(), ids=str)
def test_what_is_needed_has_a_lower_bound_and_no_upper_one(need):
    assert {each.operator for each in need.specifier} == {">="}


def test_every_pin_has_checksums_and_no_address():
    blocks = re.split(r"\n(?=[\w.-]+==)", LOCK.strip())
    assert len(blocks) > 100
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}", block) for block in blocks)
    assert "://" not in LOCK
    assert "index" not in re.sub(r"^[\w.-]+==.*", "", LOCK, flags=re.M)
