"""One problem of a scene, and the wording that problems share: what is wrong, and the fix."""

import difflib
import json
import os
from collections.abc import Collection, Iterable, Iterator
from itertools import islice
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from raytrace.errors import FileError, FileMemoryError, SceneError, printable, shortened
from raytrace.scene.positions import Path

MAX_PROBLEMS = 100  # problems that are reported per scene
MAX_PATH = 300  # characters of a path that are shown
ESCAPED = "\b\t\n\f\r"  # results of a backslash and a letter
SEARCHED = 1000  # known names that are compared with a misspelt one
HINTED = 10  # misspelt names that get a suggestion
LISTED = 20  # names that a message lists
LONGEST = 100  # characters of a name that are compared or listed
OTHER_NAMES = {  # what other formats call a key
    "albedo": ("color", "colour", "reflectance", "base_color", "diffuse", "kd"),
    "size": ("width", "height", "resolution"),
    "position": ("eye", "origin"),
    "look_at": ("target", "lookat"),
    "ior": ("int_ior", "index"),
    "spp": ("samples", "samples_per_pixel"),
    "flux": ("power",),
}


class Problem(NamedTuple):
    """One problem, without its line and column."""

    path: Path  # of the wrong value, or of the container with a missing key
    text: str  # what is wrong, and the fix
    at_key: bool = False  # whether the key is wrong, not its value
    unreadable: bool = False  # whether a file can't be read; the scene itself may be valid
    lacks_memory: bool = False  # whether the cause is a lack of memory


def shape_problem(index: int, key: str, error: SceneError | FileError) -> Problem:
    """Return what is wrong with the shape of an object; key: mesh, sphere, rectangle or box."""
    return file_problem(("objects", index, key), error)


def file_problem(path: Path, error: Exception) -> Problem:
    """Return what is wrong with a file that a scene names."""
    memory = isinstance(error, FileMemoryError)
    return Problem(path, str(error), unreadable=isinstance(error, FileError), lacks_memory=memory)


def quote(value: Any) -> str:
    """Return a short description of a JSON value.

    Examples
    --------
    >>> quote("white"), quote([1, 2]), quote(-1.5)
    ('"white"', 'a list of 2', '-1.5')
    """
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, str):
        value = value[:LONGEST]
    return shortened(json.dumps(value, ensure_ascii=False))


def nearest(word: Any, known: Iterable[str]) -> str | None:
    """Return the known name with the most similar spelling, or None if none is similar.

    Of many names the first `SEARCHED` are compared, and of long ones the beginning.

    Examples
    --------
    >>> nearest("albeedo", ["type", "albedo"])
    'albedo'
    """
    names = {name[:LONGEST]: name for name in islice(known, SEARCHED)}
    close = difflib.get_close_matches(str(word)[:LONGEST], names, n=1)
    return names[close[0]] if close else None


def meant_key(key: str, known: Collection[str]) -> str | None:
    """Return the known key that has another name in other formats, or a similar spelling; None if there is none."""
    meant = [name for name, others in OTHER_NAMES.items() if key in others and name in known]
    return meant[0] if meant else nearest(key, known)


def _hint(word: Any, known: Iterable[str]) -> str:
    close = nearest(word, known)
    return "" if close is None else f"; did you mean {quote(close)}?"


def listed(known: Collection[str]) -> str:
    """Return names joined by commas, at most the first `LISTED`.

    Examples
    --------
    >>> listed(["type", "albedo"])
    'type, albedo'
    """
    names = [shortened(name, LONGEST) for name in islice(known, LISTED)]
    more = len(known) - len(names)
    return ", ".join(names) + (f" and {more:,} more" if more else "")


def unknown_name(kind: str, word: Any, known: Collection[str], hint: bool = True) -> str:
    """Return the message for an unknown name, with a suggestion if ``hint`` is true.

    Examples
    --------
    >>> unknown_name("material", "glas", ["white", "glass"])
    'unknown material "glas"; did you mean "glass"? (known: white, glass)'
    """
    suggestion = _hint(word, known) if hint else ""
    return f"unknown {kind} {quote(word)}{suggestion} (known: {listed(known) or 'none'})"


def unknown_key(key: str, known: Collection[str]) -> str:
    """Return the message for an unknown key.

    Examples
    --------
    >>> unknown_key("albeedo", ["type", "albedo"])
    'unknown key "albeedo"; did you mean "albedo"?'
    >>> unknown_key("color", ["type", "albedo"])
    'unknown key "color"; did you mean "albedo"?'
    >>> unknown_key("weight", ["type", "albedo"])
    'unknown key "weight" (known: type, albedo)'
    """
    meant = meant_key(key, known)
    hint = f" (known: {listed(known) or 'none'})" if meant is None else f"; did you mean {quote(meant)}?"
    return f"unknown key {quote(key)}" + hint


def no_such_file(path: FilePath) -> str:
    """Return the message for a missing file, with its name in another case or the most similar name in its folder."""
    name = str(path)
    name = name if len(name) <= MAX_PATH else f"{name[:100]}...{name[100 - MAX_PATH :]}"
    if alike := _other_case(path):
        return printable(f'{name}: no such file, but there is "{alike}"; upper and lower case differ')
    if "\\" in name and (other := FilePath(str(path).replace("\\", "/"))).exists():
        return printable(f'{name}: no such file; did you mean "{other}"?')
    if any(code in name for code in ESCAPED):
        return printable(
            f'{name}: no such file; write "/" between folders: "\\t" and the like are control characters in JSON'
        )
    if not path.parent.is_dir():
        return printable(f"{name}: no such file; there is no folder {name.removesuffix(path.name).rstrip(os.sep)}")
    return printable(f"{name}: no such file{_hint(path.name, _names(path.parent))}")


def _other_case(path: FilePath) -> str:
    """Return the end of an existing path that differs only in case or in the encoding of accents; "" if none does."""
    missing = list[str]()
    while not path.exists():
        missing.append(path.name)
        if path.name in ("", "..") or path == path.parent:
            return ""
        path = path.parent
    found = list[str]()
    try:
        for name in reversed(missing):
            entries = path.joinpath(*found).iterdir()
            found.append(min(entry.name for entry in entries if _folded(entry.name) == _folded(name)))
    except (OSError, ValueError):  # no folder, or nothing similar in it
        return ""
    return os.sep.join(found)


def _folded(name: str) -> str:
    import unicodedata

    return unicodedata.normalize("NFC", name.casefold())


def _names(folder: FilePath) -> Iterator[str]:
    with os.scandir(folder) as entries:
        yield from (entry.name for entry in islice(entries, SEARCHED))
