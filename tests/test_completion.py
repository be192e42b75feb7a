"""Shell completion: the scripts by their text, and in the shells that are installed."""

import re
import shutil
import subprocess

import pytest

from raytrace.cli import main
from raytrace.cli.completion import SHELLS, script

ASKED = [  # what is typed, and what is proposed
    (["raytrace", "che"], ["check"]),
    (["raytrace", "--sam"], ["--sampler"]),
    (["raytrace", "check", "--js"], ["--json"]),
    (["raytrace", "check", "--sp"], []),  # an option of another command
    (["raytrace", "render", "a.json", "--sampler", "s"], ["sobol", "stratified"]),
    (["raytrace", "export", "a.json", "--to", "p"], ["pbrt"]),
    (["raytrace", "completion", "z"], ["zsh"]),
    (["raytrace", "check", "roo"], ["room one.json"]),
    (["raytrace", "roo"], ["room one.json"]),
]
BASH = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
_raytrace
printf '%s\\n' "${COMPREPLY[@]}"
"""
STUBS = """
compdef() { }
_describe() { print -l "${commands[@]%%:*}" }
_files() { print files }
_arguments() { print -l -- "$@" }
source "$1"; shift
words=("$@"); CURRENT=$#
_raytrace
"""


@pytest.fixture(scope="module")
def scripts(tmp_path_factory):
    """Folder with a script per shell."""
    folder = tmp_path_factory.mktemp("completion")
    (folder / "room one.json").touch()
    for shell in SHELLS:
        text = script(shell, {name: main.parser_of(name) for name in main.COMMANDS})
        (folder / f"raytrace.{shell}").write_text(text, "utf-8")
    return folder


def run(folder, shell, *words):
    """Lines that a shell prints."""
    if shutil.which(shell) is None:
        pytest.skip(f"needs {shell}")
    done = subprocess.run([shell, *words], capture_output=True, text=True, timeout=600, cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


@pytest.mark.parametrize("shell", SHELLS)
def test_the_command_prints_the_script_with_every_command_and_option(scripts, capsys, shell):
    assert main.main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert text == (scripts / f"raytrace.{shell}").read_text("utf-8")
    for name in main.COMMANDS:
        assert re.search(rf"\b{name}\b", text)
        for action in main.parser_of(name)._actions:
            for option in action.option_strings:
                assert (f"-l {option[2:]}" if shell == "fish" and option.startswith("--") else option[1:]) in text


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_accepts_its_script(scripts, shell):
    run(scripts, shell, "-n", f"raytrace.{shell}")


@pytest.mark.parametrize(("typed", "proposed"), ASKED, ids=lambda words: " ".join(words))
def test_bash_completes(scripts, typed, proposed):
    assert [line for line in run(scripts, "bash", "-c", BASH, "bash", "raytrace.bash", *typed) if line] == proposed


@pytest.mark.parametrize(("typed", "proposed"), ASKED, ids=lambda words: " ".join(words))
def test_fish_completes(scripts, typed, proposed):
    line = " ".join(typed)
    found = run(scripts, "fish", "--no-config", "-c", f"source raytrace.fish; complete -C '{line}'")
    assert sorted(each.partition("\t")[0].replace("\\", "") for each in found) == proposed


def test_zsh_asks_for_the_options_of_the_command(scripts):
    def asked(*words):
        return run(scripts, "zsh", "-f", "-c", STUBS, "zsh", "./raytrace.zsh", *words)

    assert asked("raytrace", "") == [*main.COMMANDS, "files"]
    check = asked("raytrace", "check", "--")
    assert [each.partition("[")[0] for each in check[:-1]] == [
        "-h",
        "--help",
        "--max-memory",
        "--root",
        "--set",
        "--json",
    ]
    assert check[-1] == "*:file:_files"
    render = asked("raytrace", "a.json", "--")
    assert "--sampler[sobol, stratified or independent]:NAME:(sobol stratified independent)" in render
    assert render == asked("raytrace", "render", "--")


def test_an_unknown_shell_is_refused(capsys):
    with pytest.raises(SystemExit, match="2"):
        main.main(["completion", "tcsh"])
    assert "'bash', 'zsh', 'fish'" in capsys.readouterr().err
