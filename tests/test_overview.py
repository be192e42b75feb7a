"""Reports on several scenes, and renderers beside this one."""

import os
from pathlib import Path

import numpy as np
import pytest

from raytrace.cli.main import main
from raytrace.errors import OptionError
from raytrace.image.metrics import compare
from raytrace.rendering.rendering import render
from raytrace.reporting import overview, peers
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.measurements import Shown
from raytrace.scene.load import load
from test_sweep_table import a_report

BOX = Path(__file__).parents[1] / "scenes" / "cornell-box.json"
GREY = (Shown("reference", np.full((6, 8, 3), 128, np.uint8), None),)


def fake(tmp_path, **other):
    return a_report(shown=GREY, files=(tmp_path / "report.html",), **other)


def test_one_scene_that_fails_does_not_lose_the_others(tmp_path):
    def one(path, folder):
        if path.stem == "bad":
            raise OptionError("size: <too> small\nmore")
        return fake(tmp_path)

    said = []
    entries, page = overview.report_all(
        [Path("a.json"), Path("bad.json"), Path("b&c.json")], tmp_path, one, said.append
    )
    text = page.read_text("utf-8")
    assert [entry.report is None for entry in entries] == [False, True, False]
    assert overview.exit_code(entries) == OptionError("").exit_code == 2
    assert text.count('<a href="a/report.html">') == 2
    assert 'href="b%26c/report.html"' in text
    assert "failed: size: &lt;too&gt; small" in text
    assert "RMSE 0.01: 1.00 s" in text
    assert len(said) == 3


def test_an_interrupt_ends_the_series_and_keeps_its_page(tmp_path):
    def one(path, folder):
        if path.stem == "b":
            raise KeyboardInterrupt
        return fake(tmp_path)

    entries, page = overview.report_all([Path("a.json"), Path("b.json"), Path("c.json")], tmp_path, one, lambda _: None)
    assert [entry.name for entry in entries] == ["a", "b"]
    assert overview.exit_code(entries) == 130
    assert "a/report.html" in page.read_text("utf-8")
    half = [overview.Entry("a", fake(tmp_path, interrupted=True))]
    assert overview.exit_code(half) == 130
    assert overview.exit_code([overview.Entry("a", fake(tmp_path))]) == 0


def test_the_command_writes_a_page_though_files_are_missing(tmp_path, capsys):
    code = main(["report", str(tmp_path / "x.json"), str(tmp_path / "y.json"), "-o", str(tmp_path / "out")])
    assert code == 4
    assert capsys.readouterr().out.strip() == str(tmp_path / "out" / "index.html")
    text = (tmp_path / "out" / "index.html").read_text("utf-8")
    assert text.count("failed: ") == 2
    assert main(["report", "x.json", "y.json", "-o", str(tmp_path / "out"), "--reference", "r.npz"]) == 2


def test_the_textbook_renders_the_same_image_as_a_row(monkeypatch):
    scene = load(BOX)
    monkeypatch.setattr(peers, "find_spec", lambda _name: None)
    found, missing = peers.peers_of(scene)
    assert [way.name for way in found] == ["textbook, stratified, float64"]
    assert missing == (("Mitsuba", "not installed; pip install mitsuba"),)
    image = peers.make_configured(scene, found[0], (16, 16)).render(4, 0)
    assert image.stats["samples"] == 4 * 16 * 16
    assert compare(image.rgb, render(scene, 256, (16, 16)).rgb).rmse_srgb < 0.05


def test_what_mitsuba_cannot_express_is_one_line(monkeypatch):
    monkeypatch.setattr(peers, "find_spec", lambda _name: True)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    assert "DRJIT_LIBLLVM_PATH" in peers.why_no_mitsuba(load(BOX))
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "libLLVM.so")
    assert peers.why_no_mitsuba(load(BOX)) == ""
    told = peers.why_no_mitsuba(load(BOX.with_name("glass-sphere-transparent-shadow.json")))
    assert told
    assert "\n" not in told


@pytest.mark.parametrize(("spp", "sampler", "expected"), [
    (64, "independent", (1, 64)), (256, "independent", (4, 64)), (256, "multijitter", (4, 64)),
    (7, "multijitter", (1, 9)), (7, "independent", (1, 7)),
])  # fmt: skip
def test_large_images_of_mitsuba_are_rendered_in_passes(spp, sampler, expected):
    subject = peers.MitsubaScene.__new__(peers.MitsubaScene)
    subject.size, subject.configuration = (512, 512), Configuration(sampler, "float32", renderer="Mitsuba")
    assert subject.passes_of(spp) == expected


@pytest.mark.skipif("DRJIT_LIBLLVM_PATH" not in os.environ, reason="needs Mitsuba and a libLLVM")
def test_mitsuba_renders_the_same_image_as_a_row():
    pytest.importorskip("mitsuba")
    scene = load(BOX)
    image = peers.MitsubaScene(scene, Configuration("multijitter", "float32", renderer="Mitsuba"), (16, 16)).render(
        64, 0
    )
    assert compare(image.rgb, render(scene, 256, (16, 16)).rgb).rmse_srgb < 0.02
    assert image.stats["samples"] == 64 * 16 * 16
