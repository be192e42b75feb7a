import json

import numpy as np
import pytest

from raytrace.reporting.analysis import fit_order
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.equal_cost import costs_of
from raytrace.reporting.measurements import First
from raytrace.reporting.precision_floor import Floor
from raytrace.reporting.report_json import SCHEMA, as_json
from raytrace.reporting.slopes import slopes_of
from raytrace.reporting.spectrum import BINS, spectrum_of
from raytrace.reporting.sweep import Report
from raytrace.reporting.sweep_table import HEADER, header, text
from synthetic_points import SOBOL, STRATIFIED, curve, point

ADAPTIVE = Configuration("sobol", "float32", adaptive=True)


def a_report(**other):
    points = (point(SOBOL, 4, 0.5, 0.02), point(ADAPTIVE, 0.01, 1.0, 0.01))
    values = {
        "version": "1.2.3",
        "about_scene": {"name": "box", "about": "A box.", "sha256": "ab" * 32, "size": [8, 8],
                        "triangles": 12, "seed": 0},
        "machine": {"threads": 2},
        "about_reference": {"origin": "drawn", "spp": 512, "precision": "float64", "error": 1e-4, "ahead": 100.0,
                            "seconds": 1.0},
        "budget": 60.0,
        "seconds": 12.0,
        "points": points,
        "front": (True, False),
        "orders": (fit_order(SOBOL, [1, 4], [0.04, 0.02]),),
        "firsts": (First(SOBOL, 2.0, 1.5, 0.1, 1_000_000),),
        "gaps": {4: 1e-6},
        "shown": (),
        "advice": ("Use it.",),
        "left_out": (("stratified, float32: 256 spp", "no time"),),
        "files": (),
        "interrupted": False,
    }  # fmt: skip
    return Report(**values | other)


def test_the_json_has_these_fields_as_long_as_its_version_stays():
    found = as_json(a_report())
    assert found["schema"] == SCHEMA == "raytrace.report/1"
    assert list(found) == [
        "schema", "raytrace", "scene", "machine", "reference", "budget_seconds", "seconds", "complete", "points",
        "first_pictures", "orders", "precision_gaps", "slopes", "costs", "float32_floor", "spectra", "equal_time",
        "left_out", "advice",
    ]  # fmt: skip
    assert set(found["points"][0]) == {
        "way", "target_error", "spp", "rays", "peak_bytes", "rmse", "rmse_srgb", "relative_mse", "bias", "worst_tile",
        "ssim", "mrse", "flip", "seconds", "seconds_of_rounds", "rays_per_second", "efficiency", "pareto",
        "seconds_median", "rmse_srgb_interval", "mse_srgb_of_rounds",
    }  # fmt: skip
    assert set(found["points"][0]["way"]) == {
        "name",
        "sampler",
        "precision",
        "triangle",
        "tree",
        "adaptive",
        "renderer",
    }
    assert set(found["orders"][0]) == {"way", "order", "low", "high", "error_at_1_spp", "points"}


def test_the_numbers_are_those_of_the_points():
    first, second = as_json(a_report())["points"]
    assert (first["spp"], first["seconds"], first["rmse_srgb"], first["pareto"]) == (4, 0.25, 0.02, True)
    assert first["seconds_median"] == {"value": 0.5, "low": 0.25, "high": 1.0}
    assert first["efficiency"] == pytest.approx(1 / (0.02**2 * 0.25))
    assert first["rays_per_second"] == 8000 / 0.25
    assert first["bias"] == [0.002, -0.004, 0.0]
    assert (first["target_error"], second["target_error"]) == (None, 0.01)


def test_what_json_lacks_is_null():
    found = as_json(a_report(points=(point(SOBOL, 4, 0.5, 0.0),), front=(True,)))
    assert json.loads(json.dumps(found, allow_nan=False))["points"][0]["efficiency"] is None
    assert found["orders"][0]["low"] is None  # two points have no interval


def test_flip_is_a_column_if_it_was_measured_and_else_one_line():
    without = a_report()
    assert "FLIP" not in header(without.points)
    told = "FLIP: not measured, it needs flip-evaluator: pip install flip-evaluator"
    assert text(without).count(told) == 1
    points = tuple(each._replace(flip=0.0123) for each in without.points)
    assert header(points)[-3:] == ["FLIP", "effic.", ""]
    assert "0.0123" in text(a_report(points=points)).splitlines()[2]
    assert told not in text(a_report(points=points))


def test_the_text_has_a_row_a_point_and_marks_the_front():
    told = text(a_report())
    lines = told.splitlines()
    assert all(name in lines[0] for name in HEADER)
    assert (lines[1], lines[3]) == ("sobol, float32", "sobol, adaptive, float32")  # a heading each
    assert (lines[2].endswith("*"), lines[4].endswith("*")) == (True, False)
    assert "-4.0e-03" in lines[2]  # the bias of the worst channel
    assert told.splitlines()[-1] == "Use it."
    assert "stratified, float32: 256 spp  no time" in told
    assert "2.00 s, 1.50 s of this is compilation" in told


def test_the_table_fits_a_terminal():
    assert max(len(line) for line in text(a_report()).splitlines()[:5]) <= 120


@pytest.mark.parametrize(("error", "told"), [(1e-4, "is 1.0e-04"), (None, "its error is unknown")])
def test_where_the_truth_came_from_is_said(error, told):
    about = {"origin": "drawn", "spp": 512, "error": error, "ahead": 12.0}
    assert told in a_report(about_reference=about).reference_text


def test_the_new_numbers_stand_in_text_and_json():
    points = (*curve(SOBOL, lambda n: 0.1 / n, 0.01), *curve(STRATIFIED, lambda n: 0.1 / n**0.5, 0.01))
    spectrum = spectrum_of("sobol, float32, 4 spp", [(np.ones(BINS), 1.0), (np.ones(BINS), 1.0)])
    report = a_report(points=points, front=(True,) * 8, slopes=tuple(slopes_of(points)), costs=costs_of(points),
                      floor=Floor(0.0, 1e-6, 64, 6), spectra=(spectrum,))  # fmt: skip
    told, found = text(report), as_json(report)
    assert "time to RMSE 0.01" in told
    assert "-1.00 ±0.00" in told
    assert "sobol, float32, 4 spp  1.00 (1.00 .. 1.00): white" in told
    assert "The bias floor of float32 is below RMSE (sRGB) 1.0e-06" in told
    assert found["slopes"][0]["slope"] == pytest.approx(-1)
    assert found["slopes"][0]["spp"] == [1, 4]
    at = {each["rmse_srgb"]: each["value"] for each in found["costs"][0]["seconds_to_error"]}
    assert at[0.01] == pytest.approx(0.1)
    assert found["float32_floor"] == {"rmse_srgb": 0.0, "high": 1e-6, "spp": 64, "renders": 6}
    assert found["spectra"][0]["verdict"] == "white"
