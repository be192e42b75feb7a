"""The pytest plugin: options and the fixture ``golden``. Large packages are imported only for a check."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from raytrace.golden.check import Golden

GATES = {  # ini option -> description of the limit
    "golden_min_ssim": "smallest SSIM",
    "golden_max_bias": "largest relative error of a channel's mean",
    "golden_max_worst_tile": "largest error of the mean of an 8 x 8 tile, relative to the mean luminance",
    "golden_max_outliers": "largest share of pixels with a visible difference",
    "golden_alpha": "probability that the z-test rejects a correct noisy image",
    "golden_max_rejected": "largest share of pixels that may fail the z-test",
    "golden_max_flip": "largest mean FLIP; needs flip-evaluator",
}
WRITTEN, FAILED = "golden written", "golden failed"  # properties of a test's report, which pytest-xdist transfers


def _other_plugin(manager: pytest.PytestPluginManager) -> bool:
    """Whether pytest-golden is installed: it has an option and a fixture with the same names."""
    return find_spec("pytest_golden") is not None and not manager.is_blocked("pytest-golden")


def pytest_addoption(parser: pytest.Parser, pluginmanager: pytest.PytestPluginManager) -> None:
    """Add ``--update-goldens`` and the ini options."""
    if not _other_plugin(pluginmanager):
        group = parser.getgroup("raytrace-golden", "golden images")
        group.addoption(
            "--update-goldens",
            action="store_true",
            default=False,
            help="write golden images instead of comparing with them",
        )
    parser.addini("golden_folder", "folder of golden images; default: golden, next to the test file", default="")
    parser.addini("golden_failures", "folder of the pages of failures", default="golden-failures")
    for name, about in GATES.items():
        parser.addini(name, f"golden images: {about}; none: no limit", default=None)


def pytest_configure(config: pytest.Config) -> None:
    """Register the fixture under its short name, if no other plugin uses it."""
    if not _other_plugin(config.pluginmanager):
        config.pluginmanager.register(_ShortName(), "raytrace-golden-short-name")


@pytest.fixture
def raytrace_golden(request: pytest.FixtureRequest) -> Iterator[Golden]:
    """Compare images with golden images: ``golden.check(image, "name")``."""
    if find_spec("skimage") is None:
        pytest.fail("the fixture golden needs scikit-image: pip install scikit-image", pytrace=False)
    from raytrace.golden.check import Golden
    from raytrace.golden.locations import GoldenLocation, relative

    config, root = request.config, request.config.rootpath
    configured = str(config.getini("golden_folder"))
    folder = root / configured if configured else Path(request.path).parent / "golden"
    here, name = config.invocation_params.dir, request.node.nodeid.partition("::")[2]
    test = f"{relative(request.path, here)}::{name}"
    location = GoldenLocation(folder, root, root / str(config.getini("golden_failures")), here, test)
    gates = {name.removeprefix("golden_"): _limit(config, name) for name in GATES if config.getini(name) is not None}
    golden = Golden(location, gates, bool(config.getoption("update_goldens")))
    yield golden
    request.node.user_properties += [(WRITTEN, location.short(path)) for path in golden.written]
    request.node.user_properties += [(FAILED, location.short(path)) for path in golden.failed]


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """List the golden images that were written, so that they can be reviewed; and write a page of several failures."""
    reports = [report for kind in terminalreporter.stats.values() for report in kind]
    properties = {item for report in reports for item in getattr(report, "user_properties", ())}
    if found := sorted(path for name, path in properties if name == WRITTEN):
        terminalreporter.section("golden images written")
        for path in found:
            terminalreporter.line(f"{path} and .png")
    failures = config.rootpath / str(config.getini("golden_failures"))
    pages = sorted(config.invocation_params.dir / path for name, path in properties if name == FAILED)
    if len(pages) < 2 and failures.is_dir():
        from raytrace.golden.index_page import remove_index

        remove_index(failures)
    elif len(pages) > 1:
        from raytrace.golden.index_page import write_index
        from raytrace.golden.locations import relative

        index = relative(write_index(failures, pages), config.invocation_params.dir)
        terminalreporter.section("golden images that differ")
        terminalreporter.line(f"{len(pages)} failures, all in {index}")


class _ShortName:
    """A plugin with one fixture."""

    @pytest.fixture
    def golden(self, raytrace_golden: Golden) -> Golden:
        """Compare images with golden images: ``golden.check(image, "name")``."""
        return raytrace_golden


def _limit(config: pytest.Config, name: str) -> float | None:
    text = str(config.getini(name)).strip()
    if text.lower() == "none":
        return None
    try:
        return float(text)
    except ValueError:
        raise pytest.UsageError(f"{name}: expected a number or none, got {text!r}") from None
