import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

import raytrace
from raytrace.cli import main
from raytrace.errors import FileError, PackageError, SceneError

BOX = str(Path(__file__).parent.parent / "scenes" / "cornell-box.json")
HEAVY = {"numba", "llvmlite", "numpy", "trimesh", "rich", "PIL", "OpenEXR", "skimage", "webbrowser", "http", "secrets"}


class Event(NamedTuple):
    stage: str
    done: int
    total: int
    rays: int
    seconds: float


class Image(SimpleNamespace):
    def save(self, path, exposure):
        self.saved = (Path(path), exposure)
        Path(path).write_bytes(b"a picture")
        return Path(path)


@pytest.fixture
def library(monkeypatch, tmp_path):
    """Library that is asked and notes it, but draws nothing; the current folder is an empty one."""

    def load(path, root=None, max_memory=None):
        if library.problem:
            raise library.problem
        return SimpleNamespace(source=path, warnings=library.warnings)

    def render(scene, *, progress, checkpoint, **options):
        library.checkpoint = checkpoint
        library.asked.append((scene.source, {key: value for key, value in options.items() if value not in (None, ())}))
        progress(Event("compiling", 0, 1, 0, 0.0))
        progress(Event("rendering", 4, 4, 8_000_000, 2.0))
        return library.image

    stats = {"rays": np.int64(8), "error": np.inf, "pass": {"camera": (0.5,)}}
    stats |= {"estimated_error": 0.002, "target_reached": None, "compile_seconds": 0.0, "samples": 64}
    provenance = {"seed": 1, "spp": 16, "samples": 16}
    image = Image(
        complete=True,
        interrupted=False,
        stats=stats,
        provenance=provenance,
        rgb=np.full((2, 2, 3), 0.5, np.float32),
        stderr=np.zeros((2, 2), np.float32),
        checkpoint=None,
    )
    library = SimpleNamespace(problem=None, warnings=(), asked=[], image=image)
    monkeypatch.setattr("raytrace.scene.seen_backs.back_warnings", lambda _scene: [])
    monkeypatch.setattr(raytrace, "load", load, raising=False)
    monkeypatch.setattr(raytrace, "render", render, raising=False)
    monkeypatch.setattr(raytrace, "explain", lambda _scene: "", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RAYTRACE_DEBUG", raising=False)
    return library


def python(*words, **options):
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=600, **options)


# Starting -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words", [["--help"], ["--version"], ["explain", "--help"], ["compare"], ["--spp", "0", "a.json"]]
)
def test_help_and_mistakes_import_nothing_heavy(words):
    program = f"""
import sys
from raytrace.cli.main import main
try:
    main({words!r})
except SystemExit:
    print(*({HEAVY!r} & sys.modules.keys()), file=sys.stderr)
"""
    done = python("-c", program)
    assert done.stderr.splitlines()[-1].strip() == ""


def test_the_module_runs_as_a_program():
    done = python("-m", "raytrace", "--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"raytrace {raytrace.__version__}\n", "")


def test_help_leads_with_examples_and_names_every_verb(capsys):
    with pytest.raises(SystemExit, match="0"):
        main.main(["--help"])
    text = capsys.readouterr().out
    assert text.index("examples:") < text.index("options:")
    assert all(f"\n  {verb} " in text for verb in main.COMMANDS)


# render ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", [[], ["render"]])
def test_a_first_word_that_is_no_verb_is_a_scene(library, capsys, verb):
    assert main.main([*verb, "rooms/box.v2.json"]) == 0
    assert library.asked == [(Path("rooms/box.v2.json"), {})]
    assert library.image.saved == (Path("box.v2.png"), 0.0)  # in the current folder, not beside the scene
    assert capsys.readouterr().out == "box.v2.png\n"


def test_options_may_stand_before_the_scene(library):
    assert main.main(["--quiet", "--spp", "4", "box.json"]) == 0
    assert library.asked == [(Path("box.json"), {"spp": 4})]


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ("--size 64x48", {"size": (64, 48)}),
        ("--crop 0,8,16,4", {"crop": (0, 8, 16, 4)}),
        ("--seed 4294967295", {"seed": 2**32 - 1}),
        ("--precision float64", {"precision": "float64"}),
        ("--sampler independent", {"sampler": "independent"}),
        ("--threads 2", {"threads": 2}),
        ("--time-limit 0.5", {"time_limit": 0.5}),
        ("--target-error 0.001", {"target_error": 0.001}),
        ("--aov depth,normal -o a.npz", {"aov": ("depth", "normal")}),
    ],
)
def test_options_reach_the_renderer(library, words, asked):
    assert main.main(["box.json", *words.split()]) == 0
    assert library.asked == [(Path("box.json"), asked)]


def test_exposure_and_output_reach_the_file(library, capsys):
    assert main.main(["box.json", "-o", "a.png", "--exposure", "-1.5"]) == 0
    assert library.image.saved == (Path("a.png"), -1.5)
    assert capsys.readouterr().out == "a.png\n"


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("--spp 0", "whole number from 1"),
        ("--size 64", "expected WxH in whole numbers, such as 640x480, got '64'"),
        ("--crop 0,0,0,4", "X,Y,W,H"),
        ("--seed -1", "from 0 to 4294967295"),
        ("--precision float46", "did you mean 'float64'"),
        ("--sampler sobl", "did you mean 'sobol'"),
        ("--threads 0", "whole number from 1"),
        ("--time-limit nan", "number from"),
        ("--aov depht", "did you mean 'depth'"),
        ("--exposure bright", "number from"),
        ("--samples 4", "unrecognized arguments: --samples"),
        ("--sppp 4", "unrecognized arguments: --sppp 4; did you mean '--spp'?"),
        ("--sizes=4x4", "did you mean '--size'?"),
    ],
)
def test_a_wrong_option_says_what_was_expected(library, capsys, words, reason):
    with pytest.raises(SystemExit, match="2"):
        main.main(["box.json", *words.split()])
    assert reason in capsys.readouterr().err
    assert not library.asked


def test_layers_are_refused_for_a_png(library, capsys):
    assert main.main(["box.json", "--aov", "depth"]) == 2
    assert (
        capsys.readouterr().err
        == "raytrace: error: --aov: a PNG file cannot contain layers; use -o box.exr or box.npz\n"
    )
    assert not library.asked


@pytest.mark.parametrize("output", ["missing/a.png", "a.jpg", "a", "folder.png"])
def test_an_output_that_cannot_be_written_is_found_before_rendering(library, capsys, output):
    Path("folder.png").mkdir()
    assert main.main(["box.json", "-o", output]) == 4
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert err.startswith(f"{output}: ")
    assert not library.asked


def test_messages_go_to_stderr_and_no_bar_is_drawn_off_a_terminal(library, capsys):
    library.warnings = ("box.json:3:5: fov: 200 degrees is very wide",)
    assert main.main(["box.json"]) == 0
    out, err = capsys.readouterr()
    assert out == "box.png\n"
    warning, compiling, summary = err.splitlines()
    assert warning == "warning: box.json:3:5: fov: 200 degrees is very wide"
    assert compiling == "compiling kernels (first run only)"
    assert summary.endswith(" s, 4.0 M rays/s, estimated error 0.002")


def test_quiet_says_nothing_but_the_path(library, capsys):
    library.warnings = ("strange",)
    assert main.main(["box.json", "--quiet"]) == 0
    assert capsys.readouterr() == ("box.png\n", "")


def test_json_is_one_object_without_infinities(library, capsys):
    assert main.main(["box.json", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told.pop("seconds") > 0
    stats = {"estimated_error": 0.002, "target_reached": None, "rays": 8, "error": None, "pass": {"camera": [0.5]}}
    stats |= {"compile_seconds": 0.0, "samples": 64}
    provenance = {"seed": 1, "spp": 16, "samples": 16}
    assert told == {"scene": "box.json", "path": "box.png", "complete": True, "stats": stats, "provenance": provenance}


def test_a_time_limit_saves_what_is_finished_and_says_so(library, capsys):
    library.image.complete = False
    assert main.main(["box.json", "--time-limit", "1"]) == 0
    assert "time limit reached at 16 samples per pixel\n" in capsys.readouterr().err
    assert Path("box.png").exists()


def test_a_target_that_is_not_reached_is_told(library, capsys):
    library.image.stats["target_reached"], library.image.provenance["spp"] = False, 64
    assert main.main(["box.json", "--target-error", "1e-5", "--spp", "64"]) == 0
    assert "target error 1e-05 not reached with 64 samples per pixel\n" in capsys.readouterr().err


def test_an_interrupt_saves_what_is_finished_and_leaves_with_130(library, capsys):
    library.image.complete, library.image.interrupted = False, True
    assert main.main(["box.json"]) == 130
    out, err = capsys.readouterr()
    assert out == "box.png\n"
    assert "interrupted at 16 samples per pixel\n" in err
    assert Path("box.png").exists()


def test_an_interrupt_before_anything_is_finished_keeps_an_older_picture(library, capsys):
    library.image.complete, library.image.interrupted = False, True
    library.image.provenance["samples"] = 0
    Path("box.png").write_bytes(b"older")
    assert main.main(["box.json"]) == 130
    assert "nothing was saved" in capsys.readouterr().err
    assert Path("box.png").read_bytes() == b"older"


# Mistakes -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("word", "verb"), [("explian", "explain"), ("rendr", "render"), ("doctr", "doctor")])
def test_a_misspelt_verb_gets_a_suggestion(library, capsys, word, verb):
    assert main.main([word, "box.json"]) == 2
    assert (
        capsys.readouterr().err
        == f"raytrace: error: '{word}' is neither a command nor a file; did you mean '{verb}'?\n"
    )


def test_a_file_whose_name_is_like_a_verb_is_a_scene(library):
    Path("explian").touch()
    assert main.main(["explian", "--quiet"]) == 0
    assert main.main(["explian.json", "--quiet"]) == 0
    assert [scene for scene, _ in library.asked] == [Path("explian"), Path("explian.json")]


@pytest.mark.parametrize(
    ("problem", "code", "told"),
    [
        (SceneError(["a.json:1:2: fov: too wide", "a.json:2:1: film: empty"]), 3, "fov: too wide\na.json:2:1"),
        (FileError("a.json: there is no such file"), 4, "a.json: there is no such file\n"),
        (PermissionError(13, "Permission denied", "a.json"), 4, "a.json: Permission denied\n"),
        (PackageError("needs a: pip install a"), 2, "needs a: pip install a\n"),
        (KeyboardInterrupt(), 130, "interrupted; nothing was saved\n"),
        (ZeroDivisionError("by zero"), 1, "internal failure: ZeroDivisionError: by zero; please report"),
    ],
)
@pytest.mark.parametrize("verb", ["render", "check", "explain"])
def test_every_failure_is_told_without_a_traceback(library, capsys, verb, problem, code, told):
    library.problem = problem
    assert main.main([verb, "a.json"]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert told in err
    assert "Traceback" not in err


def test_the_traceback_of_an_internal_failure_can_be_had(library, monkeypatch):
    library.problem = ZeroDivisionError("by zero")
    monkeypatch.setenv("RAYTRACE_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        main.main(["a.json"])


@pytest.mark.skipif(os.name == "nt", reason="pipes of another kind")
def test_a_reader_that_leaves_early_is_no_failure():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "raytrace", "schema"], stdout=write, stderr=subprocess.PIPE, text=True, timeout=600
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_told_in_one_line():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "raytrace", "schema"], stdout=full, stderr=subprocess.PIPE, text=True, timeout=600
        )
    assert (done.returncode, done.stderr) == (4, "output: No space left on device\n")


# The other verbs ------------------------------------------------------------------------------------------------------


def test_check_tells_warnings_and_ok(library, capsys):
    library.warnings = ("material grey: not used",)
    assert main.main(["check", "box.json"]) == 0
    assert capsys.readouterr() == ("warning: material grey: not used\nbox.json: ok\n", "")
    assert not library.asked


def test_explain_prints_the_plan(library, capsys, monkeypatch):
    monkeypatch.setattr(raytrace, "explain", lambda scene: f"the plan of {scene.source}", raising=False)
    assert main.main(["explain", "box.json"]) == 0
    assert capsys.readouterr().out == "the plan of box.json\n"


def test_schema_is_json(capsys):
    assert main.main(["schema"]) == 0
    assert "properties" in json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(("failures", "code"), [(0, 0), (3, 5)])
def test_report_runs_the_hard_cases_and_fails_if_ours_do(tmp_path, monkeypatch, capsys, failures, code):
    from raytrace.hardcases import suite, table

    outcome = SimpleNamespace(our_failures=failures)
    monkeypatch.setattr(suite, "run", lambda progress: outcome)
    monkeypatch.setattr(table, "text", lambda found: "the table" if found is outcome else "")
    monkeypatch.setattr(table, "write", lambda found, folder: [folder / "hard-cases.json", folder / "hard-cases.md"])
    folder = tmp_path / "new" / "folder"
    assert main.main(["report", "--hard-cases", "-o", str(folder)]) == code
    out, err = capsys.readouterr()
    assert out.splitlines() == ["the table", "", str(folder / "hard-cases.json"), str(folder / "hard-cases.md")]
    assert err == ""
    assert folder.is_dir()


def test_report_checks_its_folder_first(tmp_path, monkeypatch, capsys):
    from raytrace.hardcases import suite

    monkeypatch.setattr(suite, "run", lambda progress: pytest.fail("time was spent"))
    (tmp_path / "file").touch()
    assert main.main(["report", "--hard-cases", "-o", str(tmp_path / "file")]) == 4
    assert "can't be made" in capsys.readouterr().err


def test_doctor_prints_a_fact_a_line(capsys):
    assert main.main(["doctor"]) == 0
    facts = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert ["raytrace", raytrace.__version__] in facts
    assert {"flip-evaluator", "scikit-image"} <= {fact[0] for fact in facts}  # long names do not touch their facts


# With the whole library -----------------------------------------------------------------------------------------------


def test_a_scene_becomes_a_picture(tmp_path, capsys):
    path = tmp_path / "box.npz"
    small = ["--size", "8x8", "--crop", "0,2,8,6", "--spp", "2", "--quiet"]
    assert main.main([BOX, *small, "--aov", "depth", "-o", str(path)]) == 0
    assert capsys.readouterr() == (f"{path}\n", "")
    with np.load(path) as file:
        assert file["rgb"].shape == (6, 8, 3)
        assert np.isfinite(file["rgb"]).all()
        # the camera stands 5.8 before the open front of the room, which is 2 deep and 2 wide
        assert ((file["depth"] > 5.8) & (file["depth"] < np.sqrt(7.8**2 + 2))).all()


def test_a_picture_compares_with_itself_and_not_with_another(tmp_path, capsys):
    one, other = str(tmp_path / "one.npz"), str(tmp_path / "other.npz")
    for seed, path in enumerate((one, other)):
        small = ["--size", "16x16", "--spp", "1", "--sampler", "independent", "--quiet"]
        assert main.main([BOX, *small, "--seed", str(seed), "-o", path]) == 0
    assert main.main(["compare", one, one, "--max-rmse", "0", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["rmse"] == 0
    assert main.main(["compare", one, other, "--max-rmse", "0"]) == 5
    out, err = capsys.readouterr()
    assert "rmse" in out
    assert "rmse" in err


def test_pictures_of_different_size_differ(tmp_path, capsys):
    for size in (16, 17):
        np.savez(tmp_path / f"{size}.npz", rgb=np.ones((size, size, 3), np.float32))
    assert main.main(["compare", str(tmp_path / "16.npz"), str(tmp_path / "17.npz")]) == 5
    assert "different size" in capsys.readouterr().err


def test_warmup_leaves_nothing_to_compile(capsys):
    assert main.main(["warmup"]) == 0
    assert capsys.readouterr().out.startswith("kernels ready after ")


# report ---------------------------------------------------------------------------------------------------------------


@pytest.fixture
def measured(library, monkeypatch):
    """Report that is asked and notes it, but measures nothing."""

    class Found(SimpleNamespace):
        def __str__(self):
            return "the table"

    def report(scene, folder, **options):
        library.asked.append((scene.source, folder, options))
        options.pop("progress")(Event("rendering", 4, 4, 8_000_000, 2.0))
        return library.found

    library.found = Found(files=(Path("out/report.json"), Path("out/report.html")), interrupted=False)
    monkeypatch.setattr("raytrace.reporting.sweep.report", report)
    return library


def test_report_prints_the_table_and_the_page_last(measured, capsys):
    assert main.main(["report", "box.json", "-o", "out"]) == 0
    assert measured.asked == [
        (Path("box.json"), Path("out"), {"reference": None, "budget": 60.0, "size": None, "peers": False})
    ]
    assert capsys.readouterr().out.splitlines() == ["the table", "out/report.json", "out/report.html"]


def test_options_of_a_report_reach_it(measured):
    words = ["--reference", "truth.exr", "--budget", "7.5", "--size", "64x48", "--peers"]
    assert main.main(["report", "box.json", "-o", "out", *words]) == 0
    wanted = {"reference": Path("truth.exr"), "budget": 7.5, "size": (64, 48), "peers": True}
    assert measured.asked[0][2] == wanted


def test_an_interrupted_report_leaves_with_130(measured):
    measured.found.interrupted = True
    assert main.main(["report", "box.json", "-o", "out"]) == 130


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["-o", "out"], "report: expected a scene"),
        (["box.json"], "-o/--output"),
        (["box.json", "--hard-cases", "-o", "out"], "not both"),
        (["--hard-cases"], "-o/--output"),
        (["box.json", "-o", "out", "--budget", "0"], "expected a number from 1"),
        (["box.json", "-o", "out", "--size", "64"], "WxH"),
    ],
)
def test_a_wrong_report_says_what_was_expected(measured, capsys, words, told):
    try:
        code = main.main(["report", *words])
    except SystemExit as left:
        code = left.code
    assert code == 2
    assert told in capsys.readouterr().err
    assert not measured.asked


def test_every_limit_of_a_comparison_is_an_option(tmp_path, capsys):
    dark, light = np.full((16, 16, 3), 0.1, np.float32), np.full((16, 16, 3), 0.9, np.float32)
    np.savez(tmp_path / "dark.npz", rgb=dark)
    np.savez(tmp_path / "light.npz", rgb=light)
    pair = ["compare", str(tmp_path / "light.npz"), str(tmp_path / "dark.npz"), "--no-flip"]
    for option in ("rmse", "rmse-srgb", "relative-mse", "bias", "worst-tile", "outliers"):
        assert main.main([*pair, f"--max-{option}", "0.01"]) == 5
        assert len(capsys.readouterr().err.splitlines()) == (3 if option == "bias" else 1)
    assert main.main([*pair, "--min-ssim", "0.999"]) == 5
    assert main.main(pair) == 0
