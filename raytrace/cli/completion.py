"""The command ``completion``: scripts that complete the command line in bash, zsh and fish.

The scripts are made of the parsers themselves, and start no Python: a shell that loads one has all words in it.
"""

import re
from argparse import Action, ArgumentParser
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

SHELLS = "bash", "zsh", "fish"
FIRST = "render"  # the command that may be omitted


class Option(NamedTuple):
    """An option of a command."""

    names: tuple[str, ...]  # such as -o and --output
    help: str
    takes: str  # what its value is called in the help; "" for a switch
    words: tuple[str, ...]  # values that it may have; () for any
    files: str  # "file" or "folder" where its value is one, else ""


class Syntax(NamedTuple):
    """What a command takes."""

    about: str
    options: tuple[Option, ...]
    words: tuple[str, ...]  # that its positional arguments may be
    files: bool  # whether these are files


def script(shell: str, parsers: Mapping[str, ArgumentParser]) -> str:
    """Return the script for a shell.

    Parameters
    ----------
    shell : {"bash", "zsh", "fish"}
    parsers : mapping
        Name of a command -> its parser. The first line of a description is what the command does.
    """
    commands = {name: _syntax(parser) for name, parser in parsers.items()}
    return {"bash": _bash, "zsh": _zsh, "fish": _fish}[shell](commands)


def _syntax(parser: ArgumentParser) -> Syntax:
    options = tuple(_option(action) for action in parser._actions if action.option_strings)
    places = [action for action in parser._actions if not action.option_strings]
    words = tuple(word for action in places for word in _words(action))
    about = (parser.description or "").strip().partition("\n")[0]
    return Syntax(about, options, words, any(action.type is Path for action in places))


def _option(action: Action) -> Option:
    takes = "" if action.nargs == 0 else str(action.metavar or action.dest.upper())
    files = "folder" if takes == "DIR" else "file" if takes == "FILE" or action.type is Path else ""
    text = (action.help or "").replace("%%", "%").partition("; ")[0].partition(" (default")[0]
    return Option(tuple(action.option_strings), text, takes, _words(action), files)


def _words(action: Action) -> tuple[str, ...]:
    """Values that an argument may have, where these are known."""
    return tuple(map(str, action.choices or getattr(action.type, "words", None) or ()))


def _quoted(text: str) -> str:
    """Quote a text for bash and zsh."""
    return "'" + text.replace("'", "'\\''") + "'"


# bash -----------------------------------------------------------------------------------------------------------------

BASH = """\
# bash completion for raytrace; docs/command-line.md says where to put this file
_raytrace() {{
    local IFS=$'\\n' current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD-1]}} command={first}
    if ((COMP_CWORD > 1)); then
        case ${{COMP_WORDS[1]}} in {names}) command=${{COMP_WORDS[1]}} ;; esac
    fi
    local words=() options=() files=-f
    case "$command $previous" in
{values}
        *)
            case $command in
{commands}
            esac
            if ((COMP_CWORD == 1)); then words=({all}); files=-f; fi
            if [[ $current == -* ]]; then words=("${{options[@]}}"); files=; fi
            ;;
    esac
    COMPREPLY=($(compgen -W "${{words[*]}}" -- "$current"))
    if [[ $files ]]; then COMPREPLY+=($(compgen $files -- "$current")); fi
}}
complete -o filenames -F _raytrace raytrace
"""


def _bash(commands: Mapping[str, Syntax]) -> str:
    values, cases = [], []
    for command, syntax in commands.items():
        for option in syntax.options:
            if option.takes:
                files = {"": "", "file": "-f", "folder": "-d"}[option.files]
                patterns = "|".join(f'"{command} {name}"' for name in option.names)
                values.append(f"        {patterns}) words=({' '.join(option.words)}) files={files} ;;")
        options = " ".join(name for option in syntax.options for name in option.names)
        files = "" if syntax.files else " files="
        cases.append(f"                {command}) options=({options}) words=({' '.join(syntax.words)}){files} ;;")
    text = {"values": "\n".join(values), "commands": "\n".join(cases)}
    return BASH.format(first=FIRST, names="|".join(commands), all=" ".join(commands), **text)


# zsh ------------------------------------------------------------------------------------------------------------------

ZSH = """\
#compdef raytrace
# zsh completion for raytrace; docs/command-line.md says where to put this file
_raytrace() {{
  local -a commands=(
{names}
  )
  if (( CURRENT == 2 )) && [[ $words[2] != -* ]]; then
    _describe command commands
    _files
    return
  fi
  local command={first}
  if (( ${{commands[(I)${{words[2]}}:*]}} )); then
    command=$words[2]
    shift words
    (( CURRENT-- ))
  fi
  case $command in
{commands}
  esac
}}
if [[ $funcstack[1] == _raytrace ]]; then _raytrace "$@"; else compdef _raytrace raytrace; fi
"""


def _zsh(commands: Mapping[str, Syntax]) -> str:
    names = [f"    {_quoted(f'{name}:{syntax.about}')}" for name, syntax in commands.items()]
    cases = []
    for command, syntax in commands.items():
        rows = [_zsh_option(option, name) for option in syntax.options for name in option.names]
        if syntax.words:
            rows.append(_quoted(f"1:word:({' '.join(syntax.words)})"))
        if syntax.files:
            rows.append("'*:file:_files'")
        cases.append(f"    ({command}) _arguments {' '.join(rows)} ;;")
    return ZSH.format(names="\n".join(names), first=FIRST, commands="\n".join(cases))


def _zsh_option(option: Option, name: str) -> str:
    text = re.sub(r"([\[\]:])", r"\\\1", option.help)
    if not option.takes:
        return _quoted(f"{name}[{text}]")
    after = {"": "", "file": "_files", "folder": "_files -/"}[option.files]
    after = f"({' '.join(option.words)})" if option.words else after
    return _quoted(f"{name}[{text}]:{option.takes.replace(':', ' ')}:{after}")


# fish -----------------------------------------------------------------------------------------------------------------


def _fish(commands: Mapping[str, Syntax]) -> str:
    lines = ["# fish completion for raytrace; docs/command-line.md says where to put this file"]
    others = " ".join(name for name in commands if name != FIRST)
    for name, syntax in commands.items():
        about = _fish_quoted(syntax.about)
        lines.append(f"complete -c raytrace -n __fish_use_subcommand -a {name} -d {about}")
    for name, syntax in commands.items():
        seen = f"not __fish_seen_subcommand_from {others}" if name == FIRST else f"__fish_seen_subcommand_from {name}"
        begin = f"complete -c raytrace -n '{seen}'"
        for option in syntax.options:
            lines.append(f"{begin} {_fish_option(option)}")
        if syntax.words:
            lines.append(f"{begin} -x -a '{' '.join(syntax.words)}'")
        elif not syntax.files:
            lines.append(f"{begin} -f")
    return "\n".join(lines) + "\n"


def _fish_option(option: Option) -> str:
    names = " ".join(f"-l {name[2:]}" if name.startswith("--") else f"-s {name[1:]}" for name in option.names)
    takes = ""
    if option.takes:
        takes = {"": " -x", "file": " -r -F", "folder": " -x -a '(__fish_complete_directories)'"}[option.files]
        takes = f" -x -a '{' '.join(option.words)}'" if option.words else takes
    return f"{names}{takes} -d {_fish_quoted(option.help)}"


def _fish_quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
