"""What a render would do, beside what it does."""

import re

import pytest

import raytrace as rt
from raytrace.cli import main
from raytrace.errors import OptionError
from raytrace.memory import MemoryLimitError
from raytrace.rendering.forecast import LAYERS_ROW, forecast

FACTOR = {"": 1, "k": 1e3, "M": 1e6, "G": 1e9}


@pytest.fixture(scope="module")
def glass():
    return rt.load("scenes/glass-sphere.json")


def rows(scene, **options):
    return dict(forecast(scene, **options).rows)


def number(text):
    """A number as it is shown, with the half of its last digit."""
    digits, letter = re.match(r"([\d.]+)(?: ([kMG]))?\b", text).groups()
    return float(digits) * FACTOR[letter or ""] * 1.005


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_rays_are_at_most_what_is_said(glass, integrator):
    options = {"spp": 4, "size": (24, 24), "crop": (2, 3, 16, 12), "integrator": integrator}
    rays = rows(glass, **options)["rays"]
    bound = {kind: number(text) for text, kind in re.findall(r"([\d.]+(?: [kMG])?) (\w+)", rays.partition(": ")[2])}
    counted = rt.render(glass, **options, progress=False).stats["rays"]
    assert counted["camera"] == 4 * 16 * 12 == pytest.approx(bound["camera"] / 1.005, rel=0.005)
    assert sum(counted.values()) <= number(rays.removeprefix("at most "))
    assert 0 < counted["shadow"] <= bound["shadow"]
    assert ("on average" in rays) == (integrator == "path")


def test_every_option_has_its_line(glass):
    told = rows(
        glass, spp=8, size=(640, 480), crop=(1, 2, 4, 3), seed=5, sampler="stratified", threads=3, time_limit=2.5
    )
    assert told["image"] == "4 x 3 pixels of 640 x 480, from column 1 and row 2"
    assert told["samples"] == "8 per pixel (stratified, seed 5): 96 in all"
    assert told["ends"] == "after 2.5 s, with the samples so far"
    assert told["threads"] == "3"
    assert "layers" not in told


def test_adaptive_sampling_begins_with_few_samples(glass):
    told = rows(glass, size=(8, 8), target_error=0.002)["samples"]
    assert told.startswith("4 per pixel (sobol, seed 0), then more where the error is, up to 4,096, until")
    assert ", up to 64, until" in rows(glass, size=(8, 8), target_error=0.002, spp=64)["samples"]


def test_the_plan_is_that_of_the_options(glass):
    assert not forecast(glass, size=(8, 8)).plan.paths
    found = forecast(glass, size=(8, 8), integrator="path", precision="float64", aov=("depth", "emission"))
    assert found.plan.paths
    assert (found.plan.precision.name, found.plan.precision.why) == ("float64", "as asked")
    assert LAYERS_ROW not in dict(found.plan.left_out)
    assert LAYERS_ROW in dict(forecast(glass, size=(8, 8)).plan.left_out)
    assert {"layers", "light"} <= dict(found.rows).keys()


def test_what_render_refuses_is_refused(glass):
    for wrong in ({"crop": (0, 0, 9, 9), "size": (8, 8)}, {"aov": ("emission",)}, {"aov": ("colour",)}, {"spp": 0}):
        with pytest.raises(OptionError) as told:
            forecast(glass, **wrong)
        with pytest.raises(OptionError) as same:
            rt.render(glass, **wrong)
        assert str(told.value) == str(same.value)
    with pytest.raises(MemoryLimitError):
        forecast(glass, size=(4096, 4096), max_memory=2**20)


# The command ----------------------------------------------------------------------------------------------------------

FILE = "scenes/glass-sphere.json"


def test_explain_says_what_a_render_would_do(capsys):
    assert main.main(["explain", FILE]) == 0
    plan = capsys.readouterr().out
    assert plan == f"{rt.explain(FILE)}\n"
    assert main.main(["explain", FILE, "--spp", "4", "--size", "64x48"]) == 0
    with_options = capsys.readouterr().out
    assert with_options.startswith(f"{plan}render\n  image    64 x 48 pixels\n")
    assert "4 per pixel (sobol, seed 0): 12,288 in all" in with_options


def test_explain_takes_several_scenes(capsys):
    assert main.main(["explain", FILE, "scenes/prism.json"]) == 0
    assert (
        capsys.readouterr().out
        == f"{FILE}:\n{rt.explain(FILE)}\nscenes/prism.json:\n{rt.explain('scenes/prism.json')}\n"
    )
