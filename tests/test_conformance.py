"""The conformance suite: its answers, its judgement, and that known mistakes fail with their cause."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from light_catches import BUGS
from raytrace.cli.main import main
from raytrace.conformance import writing
from raytrace.conformance.cases import suite
from raytrace.conformance.judging import FAILS, MISSING, PASSES, UNJUDGED, judge
from raytrace.conformance.measuring import find_images
from raytrace.conformance.writing import ANSWERS, SCHEMA, entry, scene_of, write_suite
from raytrace.errors import FileError
from raytrace.exporting import images
from raytrace.image.files import save, srgb_decode, srgb_encode
from raytrace.rendering import path_wavefront

DOCS = Path(__file__).parents[1] / "docs"
CASES = {case.name: case for case in suite()}
RENDERED = (  # those that need few kernels and small meshes
    "furnace-room-1", "furnace-room-48", "point-light", "shadow", "large-lamp", "lamp-back", "inside-slab-48",
    "film-pinhole",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The suite without the scenes of other renderers."""
    path = tmp_path_factory.mktemp("suite")
    answers = {"schema": SCHEMA, "scenes": [entry(case) for case in CASES.values()]}
    (path / ANSWERS).parent.mkdir()
    (path / ANSWERS).write_text(json.dumps(answers))
    for case in CASES.values():
        (path / f"{case.name}.json").write_text(json.dumps(scene_of(case)))
        for name, data in case.files.items():
            (path / name).write_bytes(data)
    return path


def painted(case, values=None):
    """An image whose regions have their expected colours, or others."""
    width, height = case.scene["film"]["size"]
    rgb = np.full((height, width, 3), 0.123, np.float32)
    for region, value in zip(case.regions, values or [region.expected for region in case.regions], strict=True):
        x0, y0, x1, y1 = region.box
        rgb[y0:y1, x0:x1] = value
    return rgb


def judged(folder, tmp_path, images):
    """Verdicts of images by name."""
    for name, rgb in images.items():
        save(tmp_path / name, rgb)
    return {scene.name: scene for scene in judge(folder, tmp_path).scenes}


def test_answers_fit_into_a_png_and_names_do_not_collide():
    for case in CASES.values():
        for region in case.regions:
            assert all(0.04 <= value <= 0.9 for value in region.expected), case.name
            assert 0.003 <= region.tolerance <= 0.1
        assert not [other for other in CASES if other != case.name and other.startswith(f"{case.name}-")
                    and other.removeprefix(f"{case.name}-").isdigit()]  # fmt: skip


@pytest.mark.parametrize("suffix", [".npz", ".png"])
def test_right_images_pass(folder, tmp_path, suffix):
    found = judged(folder, tmp_path, {name + suffix: painted(case) for name, case in CASES.items()})
    assert {scene.name: scene.verdict for scene in found.values()} == dict.fromkeys(CASES, PASSES)


def test_every_known_mistake_fails_with_its_cause(folder, tmp_path):
    assert sum(len(case.causes) for case in CASES.values()) > 150
    for k in range(max(len(case.causes) for case in CASES.values())):
        some = {name: case for name, case in CASES.items() if k < len(case.causes)}
        where = tmp_path / str(k)
        where.mkdir()
        images = {f"{name}.npz": painted(case, case.causes[k].expected) for name, case in some.items()}
        found = judged(folder, where, images)
        for name, case in some.items():
            cause = case.causes[k]
            same = [other.text for other in case.causes if np.allclose(other.expected, cause.expected, rtol=0.015)]
            assert found[name].verdict == FAILS, (name, cause.text)
            assert found[name].reason in same, (name, cause.text)


def test_the_documents_derive_every_scene():
    text = (DOCS / "closed-forms.md").read_text("utf-8")
    headings = {line[3:].lower() for line in text.splitlines() if line.startswith("## ")}
    assert {case.section for case in CASES.values()} <= headings
    for page in ("docs/check-your-renderer.md", "CHANGELOG.md"):
        assert re.search(rf"\b{len(CASES)} (small )?scenes", (DOCS.parent / page).read_text("utf-8")), page


@pytest.mark.parametrize(
    ("name", "change", "cause"),
    [
        ("point-light", lambda rgb: rgb * np.float32(2), "factor of 2"),
        ("point-light", lambda rgb: rgb / np.float32(np.pi), "a factor of pi is missing"),
        ("furnace-sphere", lambda rgb: rgb * np.float32(1.5**2), "2.25"),
        ("film-pinhole", lambda rgb: rgb[::-1], "upside down"),
        ("film-pinhole", lambda rgb: rgb[:, ::-1], "mirrored left to right"),
        ("film-orthographic", lambda rgb: rgb[..., ::-1], "red and blue"),
        ("texture-linear", lambda rgb: rgb[::-1, ::-1], "turned by 180"),
        ("conductor-75", lambda rgb: srgb_encode(rgb).astype(np.float32), "encoded twice"),
        ("texture-linear", lambda rgb: srgb_decode(rgb).astype(np.float32), "linear radiance was written"),
        ("film-pinhole", lambda rgb: rgb * np.float32(1.3), "same factor of 1.3"),
        ("point-light", lambda rgb: rgb * np.float32(1.37), "no known cause"),
        ("conductor-75", lambda rgb: rgb * np.float32(1.01), "no known cause"),
        ("corridor", lambda rgb: rgb**2, "look at: Russian roulette"),
        ("furnace-room-3", lambda rgb: rgb * np.float32(0.87), "or look at: weights of multiple"),
    ],
)  # fmt: skip
def test_changed_images_fail_with_their_cause(folder, tmp_path, name, change, cause):
    scene = judged(folder, tmp_path, {f"{name}.npz": change(painted(CASES[name]))})[name]
    assert scene.verdict == FAILS
    assert cause in scene.reason


def test_a_factor_that_scenes_share_is_named(folder, tmp_path):
    names = ("point-light", "furnace-room-1", "large-lamp", "rough-metal")
    found = judged(folder, tmp_path, {f"{name}.npz": np.float32(1.03) * painted(CASES[name]) for name in names})
    assert {found[name].reason for name in names} == {
        "off by a factor of 1.030, as 3 other scenes: units or exposure of lights, or energy lost at surfaces"
    }


def test_a_factor_of_most_scenes_outweighs_a_cause_that_fits_by_chance(folder, tmp_path):
    images = {f"{name}.npz": np.float32(0.98) * painted(case) for name, case in CASES.items()}
    found = judged(folder, tmp_path, images)
    assert "off by a factor of 0.980" in found["spot-in-beam"].reason  # not "the spot's own cosine counts"


def test_one_region_of_two_is_no_common_factor(folder, tmp_path):
    image = painted(CASES["shadow"], [(0.69, 0.69, 0.69), (0.2, 0.2, 0.2)])
    assert judged(folder, tmp_path, {"shadow.npz": image})["shadow"].reason == "no known cause fits"


def test_what_cannot_be_judged(folder, tmp_path):
    right, rng = painted(CASES["film-pinhole"]), np.random.default_rng(0)
    noisy = np.where(rng.random((32, 32, 1)) < 0.001, 520.0, 0.0) * np.ones(3)  # 0.5 on average, nearly
    nan = painted(CASES["point-light"])
    nan[0, 0] = np.nan
    found = judged(
        folder,
        tmp_path,
        {
            "film-pinhole.png": np.clip(right * 3, 0, 1),
            "film-orthographic.npz": np.full_like(right, 0.4),
            "furnace-sphere.npz": np.zeros((32, 32, 3)),
            "furnace-body.png": np.ones((32, 32, 3)),
            "furnace-glass.npz": noisy,
            "point-light.npz": nan,
            "large-lamp.npz": np.full((32, 31, 3), 0.4),
        },
    )
    reasons = {name: scene.reason for name, scene in found.items() if scene.verdict == UNJUDGED}
    for name, text in (
        ("film-pinhole", "clipped"),
        ("film-orthographic", "single colour"),
        ("furnace-sphere", "black"),
        ("furnace-body", "clipped"),
        ("furnace-glass", "too noisy"),
        ("point-light", "not finite"),
        ("large-lamp", "31 x 32"),
    ):
        assert text in reasons.pop(name)
    assert not reasons
    assert {scene.verdict for scene in found.values()} == {UNJUDGED, MISSING}


def test_seeds_and_variances_give_a_z_test(folder, tmp_path):
    rng, right = np.random.default_rng(1), painted(CASES["furnace-sphere"])
    for k in (1, 2, 10):
        save(tmp_path / f"furnace-sphere-{k}.npz", right * (1.005 + 0.01 * rng.standard_normal(right.shape)))
    var = np.full_like(right, (0.1 * 0.5) ** 2)
    save(tmp_path / "furnace-body.npz", 0.6 * right * (1 + 0.1 * rng.standard_normal(right.shape)), var=var)
    assert [path.stem[15:] for path in find_images(tmp_path, "furnace-sphere")] == ["1", "2", "10"]
    found = {scene.name: scene for scene in judge(folder, tmp_path).scenes}
    assert found["furnace-sphere"].verdict == PASSES
    assert "no chance" in found["furnace-sphere"].reason
    assert found["furnace-body"].worst.noise == pytest.approx(0.05 / 32 / 0.3, rel=1e-3)
    assert abs(found["furnace-body"].worst.z) < 4


def test_a_small_error_of_an_even_image_is_no_flip(folder, tmp_path):
    image = painted(CASES["furnace-room-3"]) * np.random.default_rng(4).uniform(0.962, 1.0, (32, 32, 1))  # over codes
    scene = judged(folder, tmp_path, {"furnace-room-3.png": image})["furnace-room-3"]
    assert scene.verdict == FAILS
    assert scene.reason.startswith("no known cause")


def test_an_encoding_is_no_cause_where_another_scene_passes(folder, tmp_path):
    wrong = srgb_encode(painted(CASES["conductor-75"])).astype(np.float32)
    images = {"conductor-75.npz": wrong, "point-light.npz": painted(CASES["point-light"])}
    assert judged(folder, tmp_path, images)["conductor-75"].reason == "no known cause fits"


def test_noise_does_not_hide_the_cause(folder, tmp_path):
    """Fireflies of a divergent renderer are of no encoding."""
    rgb = painted(CASES["furnace-sphere"])
    rgb[::2, ::2] *= 1e6
    save(tmp_path / "furnace-sphere.npz", rgb, var=np.full_like(rgb, 1e10))
    scene = {scene.name: scene for scene in judge(folder, tmp_path).scenes}["furnace-sphere"]
    assert (scene.verdict, "no known cause" in scene.reason) == (FAILS, True)


def test_a_noisy_channel_does_not_hide_another(folder, tmp_path):
    rgb = painted(CASES["furnace-sphere"]) * np.float32([1.05, 1.03, 1.0])
    var = np.broadcast_to(np.float32([1, 1e-6, 1e-6]), rgb.shape)
    save(tmp_path / "furnace-sphere.npz", rgb, var=var)
    scene = {scene.name: scene for scene in judge(folder, tmp_path).scenes}["furnace-sphere"]
    assert scene.verdict == FAILS
    assert scene.worst.error == pytest.approx(0.03, abs=1e-3)


def test_a_mean_that_is_right_by_chance_is_no_pass(folder, tmp_path):
    rgb = painted(CASES["furnace-sphere"])
    save(tmp_path / "furnace-sphere.npz", rgb, var=np.full_like(rgb, 0.3))  # a standard error of 3.4 %
    scene = {scene.name: scene for scene in judge(folder, tmp_path).scenes}["furnace-sphere"]
    assert (scene.verdict, "too noisy" in scene.reason) == (UNJUDGED, True)


def test_copies_are_no_seeds_and_negative_variances_are_none(folder, tmp_path):
    rgb = painted(CASES["furnace-sphere"]) * np.random.default_rng(3).uniform(0, 2.1, (32, 32, 1)).astype(np.float32)
    for k in (1, 2):
        save(tmp_path / f"furnace-sphere-{k}.npz", rgb)
    save(tmp_path / "furnace-body.npz", 0.6 * rgb, var=np.full_like(rgb, -1))
    found = {scene.name: scene for scene in judge(folder, tmp_path).scenes}
    for name in ("furnace-sphere", "furnace-body"):
        assert found[name].worst.noise > 0.01
        assert found[name].worst.z is None


@pytest.mark.engine
def test_our_own_images_pass(folder, tmp_path):
    for name in RENDERED:
        rt.render(rt.load(folder / f"{name}.json"), spp=64).save(tmp_path / f"{name}.npz")
    found = [scene for scene in judge(folder, tmp_path).scenes if scene.images]
    assert {scene.name: scene.verdict for scene in found} == dict.fromkeys(RENDERED, PASSES)


PLANTED = {  # bug of tests/light_catches.py: scenes, and what the cause says
    "both sides shine": ("lamp-back", "shines on both sides"),
    "no factor (n_from / n_to)^2": ("inside-slab-48", "eta^2"),
    "a depth less": ("furnace-room-1", "off by -1"),
    "cosine twice": ("point-light", "cosine at the surface counts twice"),
    "weights do not sum to one": ("large-lamp", "look at: weights of multiple importance sampling"),
    "light 3 % brighter": ("point-light", "no known cause"),
    "roulette without compensation": ("furnace-room-48", "Russian roulette"),
    "area density not converted": ("tilted-lamp", "not converted to solid angle"),
}


@pytest.mark.parametrize("bug", PLANTED)
def test_a_bug_in_the_renderer_fails_with_its_cause(folder, tmp_path, monkeypatch, bug):
    name, cause = PLANTED[bug]
    monkeypatch.setattr(path_wavefront, "PathWavefront", BUGS[bug])
    with np.errstate(all="ignore"):
        rt.render(rt.load(folder / f"{name}.json"), spp=128).save(tmp_path / f"{name}.npz")
    scene = next(scene for scene in judge(folder, tmp_path).scenes if scene.images)
    assert scene.verdict == FAILS
    assert cause in scene.reason


def test_the_command_judges_and_writes_a_page(folder, tmp_path, capsys):
    save(tmp_path / "point-light.npz", painted(CASES["point-light"]))
    assert main(["conformance", str(folder), "--images", str(tmp_path)]) == 0
    assert "1 pass, 0 fail, 0 cannot be judged, 51 not rendered" in capsys.readouterr().out
    save(tmp_path / "furnace-sphere.npz", np.pi * painted(CASES["furnace-sphere"]))
    assert main(["conformance", str(folder), "--images", str(tmp_path), "-o", str(tmp_path / "report")]) == 5
    content = json.loads((tmp_path / "report" / "conformance.json").read_text())
    scene = next(scene for scene in content["scenes"] if scene["verdict"] == FAILS)
    assert not content["ok"]
    assert (scene["name"], scene["regions"][0]["expected"]) == ("furnace-sphere", [0.5, 0.5, 0.5])
    page = (tmp_path / "report" / "conformance.html").read_text()
    assert "1 / pi is missing" in page
    assert 'name="viewport"' in page  # narrow screens: one column
    assert "@media (max-width: 700px)" in page
    assert page.index("furnace-sphere") < page.index("point-light")
    (tmp_path / "none").mkdir()
    assert main(["conformance", str(folder), "--images", str(tmp_path / "none")]) == 5


def test_the_suite_is_written_for_three_renderers(tmp_path, monkeypatch, capsys):
    few = tuple(CASES[name] for name in ("texture-linear", "spot-in-beam", "spot-falloff", "triangle-lamp"))
    monkeypatch.setattr(writing, "suite", lambda: few)
    for _ in range(2):  # a second time over the first
        assert main(["conformance", "-o", str(tmp_path / "suite")]) == 0
    assert capsys.readouterr().out.splitlines()[-1].endswith("README.md")
    answers = json.loads((tmp_path / "suite" / ANSWERS).read_text())
    assert [scene["name"] for scene in answers["scenes"]] == [case.name for case in few]
    assert answers["not_exported"]["mitsuba"] == {}
    assert list(answers["not_exported"]["pbrt"]) == ["spot-falloff"]
    assert answers["not_exported"]["pbrt"]["spot-falloff"].startswith("lights.spot: pbrt has no spot")
    assert len([*(tmp_path / "suite").glob("*.json")]) == len(few)
    readme = (tmp_path / "suite" / "README.md").read_text()
    assert "| `texture-linear` | 24 x 16 | 1024 | 1 |" in readme
    assert "`spot-falloff`: lights.spot" in readme
    for to, count in (("mitsuba", 4), ("pbrt", 3)):
        assert len([*(tmp_path / "suite" / to).glob(f"*/*.{'xml' if to == 'mitsuba' else 'pbrt'}")]) == count
    for case in few:
        assert rt.load(tmp_path / "suite" / f"{case.name}.json").settings.spp == case.samples


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        ([], 2, "expected -o DIR"),
        (["nowhere", "--images", "."], 4, "write a suite first"),
        ([".", "--images", "nowhere"], 4, "answers.json"),
    ],
)
def test_mistakes_are_named(words, code, text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["conformance", *words]) == code
    assert text in capsys.readouterr().err


def test_a_suite_is_checked(folder, tmp_path, capsys):
    (tmp_path / ANSWERS).parent.mkdir()
    (tmp_path / ANSWERS).write_text('{"schema": "raytrace.conformance/9", "scenes": []}')
    assert main(["conformance", str(tmp_path), "--images", str(tmp_path)]) == 4
    assert "raytrace.conformance/9" in capsys.readouterr().err


def test_without_openexr_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(images, "find_spec", lambda name: None)
    with pytest.raises(FileError, match="pip install OpenEXR"):
        write_suite(tmp_path / "suite")
    assert not (tmp_path / "suite").exists()
