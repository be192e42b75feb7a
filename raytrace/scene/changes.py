"""Changes of single values of a scene, such as ``camera.fov=30``: for ``--set`` and ``Scene.replace``."""

import json
import re
from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

from raytrace.errors import SceneError, printable, shortened
from raytrace.scene import positions, schema_text
from raytrace.scene.files import Reach, check_root
from raytrace.scene.load import is_mesh_file, load, read_scene
from raytrace.scene.positions import Path
from raytrace.scene.problems import listed, quote, unknown_key, unknown_name
from raytrace.scene.text import Text, read_file

if TYPE_CHECKING:
    from raytrace.records import Scene

STEP = re.compile(r'\.?(?:(?P<key>[^.\[\]="\s][^.\[\]="]*)|\[(?P<index>\d{1,9})\]|\[?(?P<quoted>"(?:[^"\\]|\\.)*")\]?)')
FORM = "expected KEY=VALUE, such as camera.fov=30 or lights[0].flux=[9,9,9]"
NO_PATH = "is no path of keys; expected one such as camera.fov or lights[0].flux"
LONGEST = 80  # characters of a change that a message repeats


class Change(NamedTuple):
    """A value for a key of a scene."""

    path: Path  # keys and indices from the root
    value: Any  # as JSON types; None: the key is removed
    word: str  # as the user wrote it


def parse_path(text: str) -> Path:
    """Return the keys and indices of a dotted path.

    Raises
    ------
    ValueError
        It is none.

    Examples
    --------
    >>> parse_path("lights[0].flux"), parse_path('materials["a.b"].albedo')
    (('lights', 0, 'flux'), ('materials', 'a.b', 'albedo'))
    """
    path, at = list[str | int](), 0
    while at < len(text):
        step = STEP.match(text, at)
        if step is None or (step.lastgroup == "key" and (at == 0) == step[0].startswith(".")):
            raise ValueError(f"{quote(text)} {NO_PATH}")
        word = step[step.lastgroup or 0]
        path.append(int(word) if step.lastgroup == "index" else json.loads(word) if word[0] == '"' else word)
        at = step.end()
    if not path or isinstance(path[0], int):
        raise ValueError(f"{quote(text)} {NO_PATH}")
    return tuple(path)


def parse_change(word: str) -> Change:
    """Parse a change. The value is JSON, or else a word such as ``path``.

    Raises
    ------
    ValueError
        It has no such form.

    Examples
    --------
    >>> parse_change("camera.fov=30").value, parse_change("render.integrator=path").value
    (30, 'path')
    """
    key = re.match(r'(?:"(?:[^"\\]|\\.)*"|[^="])*', word)
    end = key.end() if key else 0
    if word[end : end + 1] != "=":
        raise ValueError(f"{FORM}; got {quote(word)}")
    text = word[end + 1 :].strip()
    try:
        value = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        if not re.fullmatch(r"[^\s\[\]{}\",][^\[\]{}\"]*", text):
            raise ValueError(f"{quote(text)} is no JSON value; {FORM}") from None
        value = text
    return Change(parse_path(word[:end].strip()), value, word)


def _refuse_constant(word: str) -> float:
    raise ValueError(word)


def apply_change(data: dict[str, Any], change: Change) -> None:
    """Set the value in a scene, or remove the key.

    Parameters
    ----------
    data : dict
        A scene as JSON types; it is changed.
    change : Change

    Raises
    ------
    ValueError
        There is no such place; the message names the keys that there are.

    Examples
    --------
    >>> scene = {"camera": {"fov": 40}, "lights": [{"flux": [1, 1, 1]}]}
    >>> apply_change(scene, parse_change("lights[0].flux[2]=5"))
    >>> scene["lights"]
    [{'flux': [1, 1, 5]}]
    """
    place: Any = data
    for k, step in enumerate(change.path[:-1]):
        if k == 0 and step not in place:
            _check_section(step)
            place[step] = {}
        place = place[_existing(place, step, change.path[:k])]
    last = change.path[-1]
    if len(change.path) == 1:
        _check_section(last)
    if not isinstance(place, dict) or isinstance(last, int):
        place[_existing(place, last, change.path[:-1])] = change.value
    elif change.value is None:
        place.pop(last, None)
    else:
        place[last] = change.value


def _check_section(key: Any) -> None:
    """Refuse a key that no scene has."""
    known = json.loads(schema_text())["properties"]
    if key not in known and key not in ("integrator", "textures"):  # those of the dialect of the course
        raise ValueError(unknown_key(str(key), known))


def _existing(place: Any, step: str | int, path: Path) -> str | int:
    """Return a key or an index that a container has; else raise a ValueError that names what it has."""
    name = positions.show(path) or "the scene"
    if isinstance(place, list) and isinstance(step, int):
        if step >= len(place):
            have = f"{name}[0] to {name}[{len(place) - 1}]" if len(place) > 1 else f"{name}[0]" if place else "nothing"
            raise ValueError(f"no {name}[{step}]: there is {have}")
        return step
    if isinstance(place, dict) and isinstance(step, str):
        if step not in place:
            raise ValueError(unknown_name(f"key in {name}:", step, place))
        return step
    if isinstance(place, list):
        raise ValueError(f"{name} is a list; write an index, as in {name}[0]")
    if isinstance(place, dict):
        raise ValueError(f"{name} is an object; write one of its keys: {listed(place)}")
    raise ValueError(f"{name} is {quote(place)}, which has no parts")


class ChangedText(Text):
    """The text of a scene file, some of whose values are others; problems of these name the change, not a line.

    Parameters
    ----------
    text : Text
    changes : iterable of Change
    applied : bool
        Whether the text has them already.
    """

    def __init__(self, text: Text, changes: Iterable[Change], *, applied: bool = False) -> None:
        super().__init__(text.name, text.text, text.in_file, text.trusted, text.meshes)
        self._changes, self._applied = tuple(changes), applied
        self.changes = text.changes + tuple(change.word for change in self._changes)

    def parse(self) -> dict[str, Any]:
        """Return the changed scene as JSON types."""
        data = super().parse()
        for change in () if self._applied else self._changes:
            try:
                apply_change(data, change)
            except ValueError as error:
                raise SceneError([printable(f"{self.name}: {_label(change)}: {error}")]) from None
        return data

    def _line(self, where: positions.Positions, offset: int, path: Path, text: str) -> str:
        for change in reversed(self._changes):
            if path[: len(change.path)] == change.path:
                shown = shortened(positions.show(path), 200)
                return printable(": ".join((self.name, _label(change), shown, shortened(text, 500))))
        return super()._line(where, offset, path, text)


def _label(change: Change) -> str:
    return f"--set {shortened(change.word, LONGEST)}"


def load_changed(
    source: str | FilePath, changes: Iterable[Change], root: str | FilePath | None = None, max_memory: int | None = None
) -> "Scene":
    """Load a scene file or a mesh file, as ``load`` does, with other values.

    Parameters
    ----------
    source : str or Path
    changes : iterable of Change
        They count in their order.
    root, max_memory
        As for ``load``.

    Raises
    ------
    SceneError, FileError
        As ``load`` does; a problem of a change names it.
    """
    if is_mesh_file(source):
        return with_changes(load(source, root, max_memory), changes)
    path = FilePath(source)
    text = ChangedText(read_file(path), changes)
    return read_scene(text, path, Reach(path.parent, check_root(root), text.trusted, max_memory))


def with_changes(scene: "Scene", changes: Iterable[Change]) -> "Scene":
    """Return a loaded scene with other values; a ``SceneError`` names the change that is wrong."""
    from raytrace.scene.replaced import replaced

    changes = tuple(changes)
    return replaced(scene, changes, {}, label=_label, text_of=lambda text: ChangedText(text, changes, applied=True))
