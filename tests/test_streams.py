"""Standard streams that are closed, narrow or full: images and exit codes are what they are on a terminal."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from raytrace.cli import main, streams

ROOT = Path(__file__).parents[1]
SCENES = ROOT / "scenes"
SNOWMAN = "\N{SNOWMAN}"
DESCRIPTORS = {"stdin": "<&-", "stdout": ">&-", "stderr": "2>&-"}
posix = pytest.mark.skipif(os.name == "nt", reason="needs a shell that can close descriptors")


def raytrace(*words, encoding="utf-8", closed=(), **options):
    """Run the command line with some of its streams closed, and the others in an encoding."""
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    command = [sys.executable, "-m", "raytrace", *map(str, words)]
    if closed:
        command = ["sh", "-c", f'exec "$@" {" ".join(DESCRIPTORS[name] for name in closed)}', "sh", *command]
    return subprocess.run(command, capture_output=True, timeout=600, env=environment, **options)


@pytest.fixture
def snowman(tmp_path):
    """A folder with a scene whose name and description few encodings hold."""
    (tmp_path / "meshes").symlink_to(SCENES / "meshes")
    text = (SCENES / "glass-slab.json").read_text("utf-8")
    head, _, tail = text.partition('"about": "')
    (tmp_path / f"{SNOWMAN}.json").write_text(f'{head}"about": "{SNOWMAN} {tail}', "utf-8")
    return tmp_path


def words_of(verb, folder):
    scene, image = f"{SNOWMAN}.json", f"{SNOWMAN}.npz"
    np.savez(folder / image, rgb=np.ones((16, 16, 3), np.float32))
    root = ["--root", SCENES]
    return {
        "render": [scene, *root, "--spp", 1, "--size", "8x8"],
        "json": [scene, *root, "--spp", 1, "--size", "8x8", "--json"],
        "explain": ["explain", scene, *root],
        "check": ["check", scene, *root],
        "compare": ["compare", image, image],
        "schema": ["schema"],
        "doctor": ["doctor"],
    }[verb]


VERBS = ["render", "json", "explain", "check", "compare", "schema", "doctor"]


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("encoding", ["ascii", "ascii:strict", "cp1252:strict"])
def test_a_narrow_encoding_gets_escapes(snowman, verb, encoding):
    done = raytrace(*words_of(verb, snowman), encoding=encoding, cwd=snowman)
    assert done.returncode == 0, done.stderr
    assert b"failure" not in done.stderr
    text = done.stdout.decode("ascii" if "ascii" in encoding else "cp1252")
    assert SNOWMAN not in text
    if verb not in ("schema", "doctor", "compare"):
        assert "\\u2603" in text
    assert (snowman / f"{SNOWMAN}.png").exists() == (verb in ("render", "json"))


def test_a_wide_encoding_gets_the_characters_themselves(snowman):
    done = raytrace(*words_of("explain", snowman), cwd=snowman)
    assert done.stdout.decode().startswith(SNOWMAN)


@posix
@pytest.mark.parametrize("closed", [("stdout",), ("stderr",), ("stdout", "stderr"), ("stdin", "stdout", "stderr")])
@pytest.mark.parametrize("verb", VERBS)
def test_closed_streams_lose_neither_the_image_nor_the_exit_code(snowman, verb, closed):
    done = raytrace(*words_of(verb, snowman), closed=closed, cwd=snowman)
    assert done.returncode == 0, (done.stdout, done.stderr)
    path = snowman / f"{SNOWMAN}.png"
    assert path.exists() == (verb in ("render", "json"))
    if path.exists():
        assert path.read_bytes()[-8:-4] == b"IEND"


@posix
@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--spp", "0", "a.json"], 2),
        (["explian", "a.json"], 2),
        (["check", "bad.json"], 3),
        (["check", "nowhere.json"], 4),
        (["compare", "dark.npz", "light.npz", "--max-rmse", "0"], 5),
        (["--help"], 0),
    ],
)
def test_closed_streams_do_not_change_the_code_of_a_failure(tmp_path, words, code):
    (tmp_path / "bad.json").write_text("{}")
    for name, value in (("dark", 0.1), ("light", 0.9)):
        np.savez(tmp_path / name, rgb=np.full((16, 16, 3), value, np.float32))
    assert raytrace(*words, closed=("stdout", "stderr"), cwd=tmp_path).returncode == code


@posix
@pytest.mark.parametrize(("limit", "code"), [([], 0), (["--max-rmse", "0"], 5)])
def test_a_reader_that_has_gone_does_not_change_the_code(tmp_path, limit, code):
    for name, value in (("dark", 0.1), ("light", 0.9)):
        np.savez(tmp_path / name, rgb=np.full((16, 16, 3), value, np.float32))
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "raytrace", "compare", "dark.npz", "light.npz", *limit]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, stdout=write, stderr=write, timeout=600, cwd=tmp_path, env=environment)
    os.close(write)
    assert done.returncode == code


@pytest.mark.parametrize("verb", ["doctor", "schema"])
def test_streams_that_are_none_are_as_good_as_closed(monkeypatch, verb):
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    assert main.main([verb]) == 0
    assert main.main(["check", "nowhere.json"]) == 4
    with pytest.raises(SystemExit, match="2"):
        main.main(["--spp", "0", "a.json"])
    for stream in (sys.stdout, sys.stderr):
        stream.close()
    assert main.main([verb]) == 0  # closed by the program itself
    for stream in (sys.stdout, sys.stderr):
        stream.close()


@posix
def test_a_closed_descriptor_is_not_given_to_the_next_file(tmp_path):
    program = (
        "import os; from raytrace.cli import streams; streams.prepare(); print(os.open('file', os.O_CREAT), flush=True)"
    )
    command = ["sh", "-c", 'exec "$@" 2>&-', "sh", sys.executable, "-c", program]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, timeout=60, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert int(done.stdout) > 2


# What a terminal would obey -------------------------------------------------------------------------------------------

RED = "\x1b[31m"


def test_nothing_that_a_terminal_obeys_is_printed(capsys):
    streams.out(f"{RED}\a\b\r\u202e\x9b31m\u2028plain\ttext\u3000\nsecond")
    streams.say(f"{RED}")
    out, err = capsys.readouterr()
    assert out == "\\x1b[31m\\x07\\x08\\r\\u202e\\x9b31m\\u2028plain\\ttext\u3000\nsecond\n"
    assert err == "\\x1b[31m\n"


@pytest.mark.parametrize(
    "words",
    [
        [f"{RED}.json"],
        ["box.json", "-o", f"no{RED}\nfolder/a.png"],
        ["box.json", "-o", f"a{RED}\n.gif"],
        ["box.json", "--spp", f"{RED}\n"],
        ["box.json", f"--{RED}\n"],
        ["box.json", "--root", f"{RED}\n"],
        [f"explian{RED}\n"],
        ["check", f"{RED}\n.json"],
        ["compare", f"{RED}.npz", "b.npz"],
        ["report", "box.json", "-o", f"box.json/{RED}\n"],
    ],
)
def test_words_of_the_command_line_are_escaped(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.json").write_text("{}")
    with contextlib.suppress(SystemExit):
        assert main.main(words) in (2, 3, 4)
    out, err = capsys.readouterr()
    assert out == ""
    assert "\x1b" not in err
    if not err.startswith("usage"):
        assert len(err.splitlines()) == 1 or "box.json" in err


def test_a_message_about_a_long_word_is_short(capsys):
    with pytest.raises(SystemExit, match="2"):
        main.main(["box.json", "--spp", "9" * 100_000])
    assert len(capsys.readouterr().err.splitlines()[-1]) < 1100


def test_texts_of_a_scene_are_escaped(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").symlink_to(SCENES / "meshes")
    text = (SCENES / "glass-slab.json").read_text("utf-8").replace('"about": "', '"about": "\\u001b[31m\\nX')
    text = text.replace('"materials": {', '"materials": {"\\u001b[2J": {"type": "diffuse", "albedo": [0, 0, 0]},')
    Path(f"a{RED}b.json").write_text(text, "utf-8")
    Path("bad.json").write_text(text.replace('"objects"', '"\\u001b[2J"'), "utf-8")
    for verb in ("explain", "check"):
        assert main.main([verb, f"a{RED}b.json", "--root", str(SCENES)]) == 0
    assert main.main(["check", "bad.json", "--root", str(SCENES)]) == 3
    out, err = capsys.readouterr()
    assert "\x1b" not in out + err
    assert out.startswith("\\x1b[31m\\nX")
    assert '["\\u001b[2J"]' in out
    assert "\\x1b[2J" in err or "\\u001b[2J" in err
