import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from raytrace.errors import PackageError
from raytrace.reporting.analysis import pareto
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.plots import DARK, NIGHT, Plotted, check_matplotlib, heat, make_plots
from raytrace.reporting.precision_floor import Floor
from raytrace.reporting.slopes import slopes_of
from raytrace.reporting.spectrum import BINS, spectrum_of
from synthetic_points import DOUBLE, SOBOL, curve

ROOT = Path(__file__).parents[1]
BRUTE = Configuration("sobol", "float32", tree="none")


def drawn():
    points = curve(SOBOL, lambda n: 0.1 / n, 0.1) + curve(DOUBLE, lambda n: 0.1 / n, 0.2)
    points += curve(BRUTE, lambda n: 0.1 / n, 0.5) + curve(
        Configuration("sobol", "float32", adaptive=True), lambda n: 0.05 / n, 0.1
    )
    spectrum = spectrum_of("sobol, float32, 4 spp", [(np.ones(BINS), 1.0)] * 2)
    return make_plots(Plotted(points, pareto(points), slopes_of(points), Floor(1e-4, 2e-4, 64, 6), [spectrum], "box"))


def test_all_plots_come_as_png_and_svg_and_for_a_dark_page():
    files = drawn()
    names = "error-against-samples", "error-against-time", "error-spectrum"
    assert sorted(files) == sorted(name + end for name in names for end in (".png", ".svg", DARK))
    assert all(NIGHT.paper.encode() in files[name + DARK] for name in names)
    assert all(NIGHT.paper.encode() not in files[f"{name}.svg"] for name in names)
    assert b"float32 floor: 1.0e-04" in files["error-against-time.svg"]
    assert all(files[name].startswith(b"\x89PNG") for name in files if name.endswith(".png"))
    assert all(b"<svg" in files[name] for name in files if name.endswith(".svg"))


def test_the_same_points_give_the_same_bytes():
    assert drawn() == drawn()


def test_points_without_error_or_fit_are_no_problem():
    points = curve(SOBOL, lambda n: 0.0, 0.1, (1,))
    assert len(make_plots(Plotted(points, [True], [], None, [], "black"))) == 6


@pytest.mark.parametrize(
    "name", [r"$\frac{$", "$x$", "a_b^c$_", r"\N{SNOWMAN}", "\N{CJK UNIFIED IDEOGRAPH-7BB1}", "#%{}~"]
)
def test_no_name_is_a_formula(name):
    points = curve(SOBOL, lambda n: 0.1 / n, 0.1)
    files = make_plots(Plotted(points, pareto(points), [], None, [], name))
    assert f"<!-- {name} -->" in files["error-against-time.svg"].decode()  # matplotlib notes each text that it draws


def test_no_window_system_is_asked_for():
    program = """
import sys
sys.path[:0] = [".", "tests"]
from test_plots import drawn
drawn()
assert "matplotlib.pyplot" not in sys.modules
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_without_matplotlib_the_message_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(PackageError, match="pip install matplotlib scikit-image"):
        check_matplotlib()


def test_errors_glow_by_their_logarithm():
    colours = heat(np.array([[0.0, 1e-4, 1e-2, 1.0, 7.0]])).astype(int).sum(axis=2)[0]
    assert colours[0] == colours[1] < colours[2] < colours[3] == colours[4]
