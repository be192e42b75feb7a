"""The command line over several scenes; ``check --json``; images in folders."""

import json
import signal
from pathlib import Path

import pytest

import raytrace
from raytrace.cli import main, terminal
from raytrace.cli.progress_lines import ProgressLines
from raytrace.errors import OptionError, SceneError
from raytrace.rendering.progress import Progress
from raytrace.scene.problem_lines import parts_of
from scene_files import CUBE, scene, write
from test_cli import library  # noqa: F401  a fixture

NUMBERS = [getattr(signal, name) for name in terminal.ENDING if hasattr(signal, name)]
SMALL = ["--size", "8x8", "--spp", "1", "--quiet"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with two scenes and one that is wrong in three ways; it is the current one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "triangle.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "cube.obj").write_text(CUBE)
    for name in ("a", "b"):
        write(tmp_path, scene(), f"{name}.json")
    write(tmp_path, scene(camera={"position": [0, 1, 2], "look_at": [0, 1, 0], "fov": -1}, abuot="x"), "wrong.json")
    return tmp_path


# render ---------------------------------------------------------------------------------------------------------------


def test_each_scene_has_an_image_in_a_folder_that_is_made(folder, capsys):
    assert main.main(["render", "a.json", "b.json", "cube.obj", *SMALL, "-o", "new/images/"]) == 0
    paths = [str(Path("new/images") / f"{name}.png") for name in ("a", "b", "cube")]
    assert capsys.readouterr() == ("".join(f"{path}\n" for path in paths), "")
    assert all(Path(path).read_bytes().startswith(b"\x89PNG") for path in paths)


def test_images_of_a_command_have_the_bits_of_single_commands(folder):
    assert main.main(["a.json", "b.json", *SMALL, "--format", "npz"]) == 0
    for name in ("a", "b"):
        assert main.main([f"{name}.json", *SMALL, "-o", "one.npz"]) == 0
        assert main.main(["compare", "one.npz", f"{name}.npz", "--max-rmse", "0", "--no-flip"]) == 0


def test_a_scene_that_fails_loses_no_other_and_gives_its_code(folder, capsys):
    assert main.main(["a.json", "wrong.json", "QQQQQQ.QQ", "b.json", *SMALL]) == 3
    out, err = capsys.readouterr()
    assert out == "a.png\nb.png\n"
    lines = err.splitlines()
    assert lines[-2:] == [
        "QQQQQQ.QQ: no such file",
        "2 of 4 scenes done; not done: wrong.json, QQQQQQ.QQ",
    ]
    assert main.main(["QQQQQQ.QQ", "wrong.json", "b.json", *SMALL]) == 4


def test_a_message_that_names_no_scene_gets_its_name(library, capsys, monkeypatch):  # noqa: F811
    def refuse(scene, **_options):
        if scene.source == Path("b.json"):
            raise OptionError("crop: is not inside the film")
        return library.image

    monkeypatch.setattr(raytrace, "render", refuse, raising=False)
    assert main.main(["a.json", "b.json"]) == 2
    out, err = capsys.readouterr()
    assert out == "a.png\n"
    assert "b.json: crop: is not inside the film\n" in err


def test_the_same_scene_twice_is_rendered_once(library):  # noqa: F811
    assert main.main(["a.json", "a.json", "--quiet"]) == 0
    assert len(library.asked) == 1


def test_json_has_a_line_per_scene(library, capsys):  # noqa: F811
    assert main.main(["a.json", "b.json", "--json"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [json.loads(line)["scene"] for line in lines] == ["a.json", "b.json"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("a.json b.json -o a.png", "-o a.png: expected a folder for 2 images, such as -o images/"),
        ("a.json x/a.json", f"a.json and {Path('x/a.json')}: would both be written to a.png; render one at a time"),
        ("a.json b.json --aov depth", "--aov: a PNG file cannot contain layers; use --format exr or --format npz"),
        ("a.json -o a.png --format exr", "--format exr: -o a.png has another extension; leave one out"),
    ],
)
def test_outputs_that_cannot_be_are_refused_before_rendering(library, capsys, words, told):  # noqa: F811
    assert main.main(words.split()) == 2
    assert capsys.readouterr().err == f"raytrace: error: {told}\n"
    assert not library.asked


def test_one_scene_may_have_a_folder_too(library, capsys):  # noqa: F811
    Path("there").mkdir()
    for output in ("there", "new/"):
        assert main.main(["a.json", "-o", output, "--quiet"]) == 0
    assert capsys.readouterr().out.splitlines() == [str(Path("there/a.png")), str(Path("new/a.png"))]


@pytest.mark.parametrize("late", [False, True])
def test_ctrl_c_ends_all_scenes(library, capsys, monkeypatch, late):  # noqa: F811
    def render(scene, **_options):
        if scene.source == Path("b.json"):
            if not late:
                raise KeyboardInterrupt
            library.image.complete, library.image.interrupted = False, True
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        return library.image

    monkeypatch.setattr(raytrace, "render", render, raising=False)
    before = {number: signal.getsignal(number) for number in NUMBERS}
    try:
        assert main.main(["a.json", "b.json", "c.json", "--quiet"]) == 130
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    out, err = capsys.readouterr()
    assert out == ("a.png\nb.png\n" if late else "a.png\n")
    assert err.splitlines()[-1] == "1 of 3 scenes done; not done: b.json; not begun: c.json"


# check ----------------------------------------------------------------------------------------------------------------


def test_check_takes_several_scenes(folder, capsys):
    assert main.main(["check", "a.json", "wrong.json", "cube.obj"]) == 3
    out, err = capsys.readouterr()
    assert out == "a.json: ok\ncube.obj: ok\n"
    assert err.splitlines()[-1] == "2 of 3 scenes ok; not ok: wrong.json"


def test_problems_as_json_have_their_parts(folder, capsys):
    assert main.main(["check", "a.json", "wrong.json", "QQQQQQ.QQ", "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert (told["version"], told["ok"]) == (1, False)
    good, wrong, missing = told["scenes"]
    assert good == {"scene": "a.json", "ok": True, "problems": []}
    assert [problem["path"] for problem in wrong["problems"]] == ["camera.fov", "abuot"]
    fov = wrong["problems"][0]
    lines = Path("wrong.json").read_text("utf-8").splitlines()
    assert lines[fov["line"] - 1][fov["column"] - 1 :].startswith("-1")
    expected = {"severity": "error", "file": "wrong.json", "message": "expected a number > 0, got -1"}
    assert {key: fov[key] for key in expected} == expected
    nowhere = {"severity": "error", "file": "QQQQQQ.QQ", "line": None, "column": None, "path": ""}
    assert missing["problems"] == [nowhere | {"message": "no such file"}]


def test_a_missing_mesh_keeps_its_place_in_json(folder, capsys):
    write(folder, scene(objects=[{"mesh": "no: y.obj", "material": "white"}]), "mesh.json")
    assert main.main(["check", "mesh.json", "--json"]) == 4
    (problem,) = json.loads(capsys.readouterr().out)["scenes"][0]["problems"]
    assert (problem["path"], problem["message"]) == ("objects[0].mesh", "no: y.obj: no such file")
    assert problem["line"] >= 1


def test_warnings_as_json_are_no_failure(folder, capsys):
    text = scene()
    text["materials"]["spare"] = {"type": "diffuse", "albedo": [0, 0, 0]}
    write(folder, text, "spare.json")
    assert main.main(["check", "spare.json", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (problem,) = told["scenes"][0]["problems"]
    assert (told["ok"], problem["severity"], problem["path"]) == (True, "warning", "materials.spare")


def test_a_plain_line_is_parted_as_far_as_it_can_be():
    error = SceneError(["a.json:2:3: not UTF-8", "other: wrong"])
    assert parts_of(error.problems[0], "a.json")[1:] == (2, 3, "", "not UTF-8")
    assert parts_of(error.problems[1], "a.json")[1:] == (None, None, "", "other: wrong")


# Meshes ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["render", "check", "explain"])
def test_a_mesh_will_do_where_a_scene_is_expected(folder, capsys, verb):
    assert main.main([verb, "cube.obj", *(SMALL if verb == "render" else [])]) == 0
    out = capsys.readouterr().out
    assert {"render": "cube.png", "check": "cube.obj: ok", "explain": "1 environment"}[verb] in out


# Progress without a terminal ------------------------------------------------------------------------------------------


def said(seconds, total=100, stage="rendering"):
    lines = []
    progress = ProgressLines(lines.append)
    for done in range(total + 1):
        progress(Progress(stage, done, total, 0, seconds * done / total))
    return lines


def test_a_long_render_says_a_line_per_tenth():
    assert [line.partition(",")[0] for line in said(60.0)] == [f"rendering: {k} %" for k in range(10, 100, 10)]
    assert said(60.0)[0] == "rendering: 10 %, about 54 s left"
    assert len(said(60.0, total=127)) == 9
    assert said(60.0, total=3) == ["rendering: 30 %, about 40 s left", "rendering: 60 %, about 20 s left"]


def test_a_short_render_says_nothing():
    assert said(9.0) == []


def test_rounds_of_adaptive_sampling_begin_anew_without_repeating_themselves():
    lines = []
    progress = ProgressLines(lines.append)
    for part in range(1, 30):
        for done in range(100 * (part - 1), 100 * part + 1):
            progress(Progress("rendering", done, 100 * part, 0, 60.0 + done))
    assert lines[:9] == [f"rendering: {k} %, {lines[k // 10 - 1].partition(', ')[2]}" for k in range(10, 100, 10)]
    assert len(lines) < 50


@pytest.mark.parametrize("at_terminal", [False, True])
def test_the_hard_cases_say_a_line_per_tenth_or_show_a_bar(monkeypatch, capsys, at_terminal):
    seconds = iter(range(1000))
    monkeypatch.setattr(terminal.time, "monotonic", lambda: float(next(seconds)))
    monkeypatch.setattr(terminal, "at_terminal", lambda: at_terminal)
    monkeypatch.setattr(terminal, "_bar", lambda: bar)
    bar = Bar()
    with terminal.counting("hard cases") as progress:
        for k in range(127):
            progress("a case", k, 127)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == (0 if at_terminal else 9)
    assert bar.shown == ([("hard cases", k) for k in range(127)] if at_terminal else [])


class Bar:
    """A bar that notes what it shows."""

    def __init__(self):
        self.shown = []

    def start(self):
        """Show nothing."""

    stop = start

    def add_task(self, stage, **_options):
        return stage

    def update(self, stage, completed, **_options):
        self.shown.append((stage, completed))
