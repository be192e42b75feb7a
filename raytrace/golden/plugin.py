"""The pytest plugin: options, and the fixture ``golden``. Nothing heavy is imported until a picture is checked."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from raytrace.golden.check import Golden

GATES = {  # ini option -> what it limits
    "golden_min_ssim": "least SSIM",
    "golden_max_bias": "largest relative error of a channel's mean",
    "golden_max_worst_tile": "largest error of the mean of an 8 x 8 tile, relative to the mean luminance",
    "golden_max_outliers": "largest share of pixels that are visibly off",
    "golden_alpha": "chance of a false alarm of the z-test of a whole noisy picture",
    "golden_max_rejected": "largest share of pixels that may fail the z-test",
}


def _other_plugin(manager: pytest.PytestPluginManager) -> bool:
    """Whether pytest-golden is there too: it has an option and a fixture of the same names."""
    return find_spec("pytest_golden") is not None and not manager.is_blocked("pytest-golden")


def pytest_addoption(parser: pytest.Parser, pluginmanager: pytest.PytestPluginManager) -> None:
    """Add ``--update-goldens`` and the ini options."""
    if not _other_plugin(pluginmanager):
        group = parser.getgroup("raytrace-golden", "golden pictures")
        group.addoption("--update-goldens", action="store_true", default=False, help="write golden pictures anew")
    parser.addini("golden_folder", "folder of golden pictures; default: golden, beside the test's file", default="")
    parser.addini("golden_failures", "folder of the pages that failures leave", default="golden-failures")
    for name, about in GATES.items():
        parser.addini(name, f"golden pictures: {about}; none: no limit", default=None)


def pytest_configure(config: pytest.Config) -> None:
    """Offer the fixture under its short name, if no other plugin does."""
    if not _other_plugin(config.pluginmanager):
        config.pluginmanager.register(_ShortName(), "raytrace-golden-short-name")


@pytest.fixture
def raytrace_golden(request: pytest.FixtureRequest) -> "Golden":
    """Compare pictures with golden ones: ``golden.check(image, "name")``."""
    from raytrace.golden.check import Golden, Place

    config, root = request.config, request.config.rootpath
    own = str(config.getini("golden_folder"))
    folder = root / own if own else Path(request.path).parent / "golden"
    place = Place(folder, root, root / str(config.getini("golden_failures")), request.node.nodeid)
    given = {name.removeprefix("golden_"): _limit(config, name) for name in GATES if config.getini(name) is not None}
    return Golden(place, given, bool(config.getoption("update_goldens")))


class _ShortName:
    """A plugin of one fixture."""

    @pytest.fixture
    def golden(self, raytrace_golden: "Golden") -> "Golden":
        """Compare pictures with golden ones: ``golden.check(image, "name")``."""
        return raytrace_golden


def _limit(config: pytest.Config, name: str) -> float | None:
    text = str(config.getini(name)).strip()
    if text.lower() == "none":
        return None
    try:
        return float(text)
    except ValueError:
        raise pytest.UsageError(f"{name}: expected a number or none, got {text!r}") from None
