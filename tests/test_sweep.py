"""The whole report on a tiny scene: what is written, and what comes back."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.errors import FileError, OptionError, RaytraceError
from raytrace.image import files
from raytrace.records import Settings
from raytrace.rendering.rendering import render
from raytrace.reporting import configurations, reference, sweep
from raytrace.reporting.configurations import ConfiguredScene, renders_of
from raytrace.reporting.plots import make_plots
from raytrace.reporting.sweep import report
from small_scenes import Part, look, make_scene, quad

SIZE = (12, 10)
FILES = ["error-against-samples.png", "error-against-samples.svg", "error-against-time.png", "error-against-time.svg",
         "error-spectrum.png", "error-spectrum.svg", "report.html", "report.json"]  # fmt: skip


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A lit square, few samples of it, and an empty cache of references."""
    monkeypatch.setattr(reference, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr(configurations, "SPP", (1, 2, 4))
    monkeypatch.setattr(configurations, "FEW_SPP", (4,))
    monkeypatch.setattr(configurations, "TARGETS", (0.02,))
    monkeypatch.setattr(sweep, "make_plots", lambda _shown: {"plot.svg": b"<svg/>"})  # one test asks for the real ones
    square = quad((-1, -0.7, 0), (0.8, -1, 0), (1, 0.8, 0), (-0.7, 1, 0))
    settings = Settings(SIZE, 1, 16, "sobol", "float32", 0)
    return make_scene([Part(square)], [((0, 0, 3), (150, 150, 150))], look((0, 0, 5), (0, 0, 0)), settings)


def test_a_report_is_measured_written_and_returned(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep, "make_plots", make_plots)
    told = []
    found = report(scene, tmp_path / "new" / "out", progress=told.append)
    folder = tmp_path / "new" / "out"
    assert sorted(path.name for path in folder.iterdir()) == FILES
    assert sorted(found.files) == sorted(folder.iterdir())
    assert found.files[-1].name == "report.html"  # what the command line prints last
    assert {p.configuration.name for p in found.points} >= {
        "sobol, float32",
        "independent, float32",
        "sobol, float32, no tree",
    }
    assert any(found.front)
    assert found.advice[0].startswith("For RMSE ")
    assert found.left_out == ()
    assert found.about_reference["ahead"] >= 5
    assert repr(found) == f"<Report on scene: {len(found.points)} points, {folder / 'report.html'}>"
    shares = [event.done / event.total for event in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_the_json_says_what_the_report_says(scene, tmp_path):
    found = report(scene, tmp_path)
    kept = json.loads((tmp_path / "report.json").read_text("utf-8"))
    assert kept["schema"] == "raytrace.report/1"
    assert kept["scene"]["sha256"] == scene.sha256
    assert [p["way"]["name"] for p in kept["points"]] == [p.configuration.name for p in found.points]
    assert [p["pareto"] for p in kept["points"]] == list(found.front)
    assert kept["advice"] == list(found.advice)
    assert kept["reference"]["spp"] == found.about_reference["spp"]


def test_all_but_clocks_is_the_same_again(scene, tmp_path):
    def without_clocks(folder):
        report(scene, folder)
        kept = json.loads((folder / "report.json").read_text("utf-8"))
        clocks = (
            "seconds_median",
            "seconds",
            "seconds_of_rounds",
            "rays_per_second",
            "efficiency",
            "pareto",
            "peak_bytes",
        )
        points = [{name: value for name, value in p.items() if name not in clocks} for p in kept["points"]]
        return (
            points,
            kept["orders"],
            kept["slopes"],
            kept["float32_floor"],
            kept["spectra"],
            kept["left_out"],
            kept["scene"],
        )

    assert without_clocks(tmp_path / "a") == without_clocks(tmp_path / "b")


def test_a_scene_may_be_a_file_and_the_film_smaller(tmp_path, monkeypatch, scene):
    box = Path(__file__).parents[1] / "scenes" / "cornell-box.json"
    found = report(box, tmp_path / "out", size=(8, 6), budget=1e6)
    assert (found.about_scene["name"], found.about_scene["size"]) == ("cornell-box", [8, 6])
    assert found.shown[0].rgb8.shape == (6, 8, 3)


def test_a_reference_of_ones_own_is_used(scene, tmp_path, monkeypatch):
    path = files.save(tmp_path / "truth.npz", render(scene, 256, seed=9).rgb)
    monkeypatch.setattr(sweep, "make_reference", None)
    found = report(scene, tmp_path / "out", reference=path)
    assert found.about_reference["origin"] == str(path)
    assert "its error is unknown" in str(found)


def test_what_has_no_time_is_left_out_and_named(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(configurations, "SPP", (1, 65536))
    found = report(scene, tmp_path, budget=2.0, reference=files.save(tmp_path / "t.npz", render(scene, 64).rgb))
    assert {p.step for p in found.points} <= {1, 4, 0.02}
    assert {what for what, _ in found.left_out} >= {"sobol, float32: 65536 spp"}
    assert "65536 spp" in str(found)


def test_an_interrupt_leaves_a_report_of_what_was_measured(scene, tmp_path, monkeypatch):
    draw = ConfiguredScene.render

    def interrupted(self, step, seed):
        if seed == 1:  # the second round
            raise KeyboardInterrupt
        return draw(self, step, seed)

    monkeypatch.setattr(ConfiguredScene, "render", interrupted)
    found = report(scene, tmp_path)
    assert found.interrupted
    assert {len(p.times) for p in found.points} == {1}
    assert json.loads((tmp_path / "report.json").read_text("utf-8"))["complete"] is False


def test_an_interrupt_before_any_point_writes_nothing(scene, tmp_path, monkeypatch):
    def interrupted(self, step, seed):
        raise KeyboardInterrupt

    monkeypatch.setattr(ConfiguredScene, "render", interrupted)
    with pytest.raises(KeyboardInterrupt):
        report(scene, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("options", "error", "told"),
    [
        ({"budget": 0.0}, OptionError, "budget: expected seconds"),
        ({"budget": float("nan")}, OptionError, "budget: expected seconds"),
        ({"budget": 1e-9, "reference": "t.npz"}, OptionError, "not enough for a single point"),
        ({"size": (0, 4)}, OptionError, "size: "),
        ({"reference": "nowhere.npz"}, FileError, "nowhere.npz"),
        ({"reference": "t.npz", "size": (4, 4)}, OptionError, "has 12x10 pixels, the film 4x4"),
    ],
)
def test_a_wrong_option_is_one_clear_line(scene, tmp_path, monkeypatch, options, error, told):
    monkeypatch.chdir(tmp_path)
    files.save("t.npz", np.ones((10, 12, 3), np.float32))
    with pytest.raises(error, match=told) as caught:
        report(scene, "out", **options)
    assert len(str(caught.value).splitlines()) == 1


def test_a_folder_that_cannot_be_made_is_found_before_anything_is_drawn(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep, "make_reference", None)
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="file: can't be made"):
        report(scene, tmp_path / "file")


def test_without_matplotlib_nothing_is_drawn(scene, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr(sweep, "make_reference", None)
    with pytest.raises(RaytraceError, match="pip install matplotlib"):
        report(scene, tmp_path / "out")


def test_a_scene_without_noise_has_no_error_and_still_a_report(tmp_path, scene):
    empty = make_scene([Part(quad((9, 9, -9), (9.1, 9, -9), (9.1, 9.1, -9), (9, 9.1, -9)))], background=(0.5, 0.5, 0.5))
    found = report(empty, tmp_path / "out")
    assert {p.rmse_srgb for p in found.points} == {0.0}
    assert found.orders == ()


def test_it_measures_the_same_pictures_that_render_draws(scene, tmp_path):
    (point,) = (p for p in report(scene, tmp_path).points if p.configuration.name == "sobol, float32" and p.step == 4)
    kept = files.load(next((tmp_path / "cache" / "references").iterdir()))
    errors = [rt.compare(render(scene, 4, seed=k), kept.rgb).rmse for k in range(renders_of(point.configuration, 4))]
    assert point.rmse == pytest.approx(np.sqrt(np.mean(np.square(errors))))
