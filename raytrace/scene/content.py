"""What a scene was read from, so that it can be changed and written back."""

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from raytrace.errors import SceneError
from raytrace.scene import rdr
from raytrace.scene.files import Reach
from raytrace.scene.text import Text

if TYPE_CHECKING:
    from raytrace.records import Scene


class Content(NamedTuple):
    """The text of a loaded scene, and the folders of its files."""

    text: Text  # also has the meshes that a program gave
    reach: Reach

    def __reduce__(self) -> Any:
        """Leave out meshes that a program gave, which may be of any type, when a scene is sent to another process."""
        text = Text(self.text.name, self.text.text, self.text.in_file, self.text.trusted)
        text.meshes, text.changes = dict.fromkeys(self.text.meshes), self.text.changes
        return Content, (text if type(self.text) is Text else _settled(text, self.text), self.reach)


def _settled(text: Text, other: Text) -> Text:
    """Return a text with the content of one that is read in another way."""
    import json

    text.text = json.dumps(other.parse())
    return text


def content_of(scene: "Scene") -> Content:
    """Return what a scene was read from.

    Raises
    ------
    SceneError
        A program made its records, or it was sent here from a process that holds its meshes.
    """
    if scene.content is None:
        raise SceneError(["scene: a program made it of records, so it has no form as a file; use rt.load"])
    if any(mesh is None for mesh in scene.content.text.meshes.values()):
        raise SceneError(["scene: meshes that a program gave are not sent to other processes; load the scene here"])
    return scene.content


def data_of(scene: "Scene") -> dict[str, Any]:
    """Return a scene in the format's own keys, as JSON types, with its present camera, settings and background.

    Raises
    ------
    SceneError
        As ``content_of`` does.
    """
    from raytrace.scene.assemble import camera_of, settings_of
    from raytrace.scene.format import read_format
    from raytrace.scene.other_camera import entry_of

    data = content_of(scene).text.parse()
    if rdr.is_dialect(data):
        data = rdr.translate(data)[0]
    read: Any = read_format(data).scene or SimpleNamespace()
    if not same(camera_of(read.camera), scene.camera):
        data["camera"] = {key: plain(value) for key, value in entry_of(scene.camera).items()}
    if settings_of(read.film, read.render) != scene.settings:
        values = {key: plain(value) for key, value in scene.settings._asdict().items()}
        data["film"] = {key: values.pop(key) for key in ("size", "filter")}
        data["render"] = values
    if not np.array_equal(np.array(read.background), scene.background):
        data["background"] = scene.background.tolist()
    return data


def plain(value: Any) -> Any:
    """Return an array or a tuple as a list, and any other value as it is."""
    return value.tolist() if hasattr(value, "tolist") else list(value) if isinstance(value, tuple) else value


def same(a: Any, b: Any) -> bool:
    """Whether two records have equal values, in arrays of equal types; NaN equals NaN."""
    if isinstance(a, np.ndarray):
        alike = isinstance(b, np.ndarray) and a.dtype == b.dtype
        return alike and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    return not isinstance(b, np.ndarray) and bool(a == b)


def changes_of(scene: "Scene") -> tuple[str, ...]:
    """Return what ``--set`` has changed in a scene, as the user wrote it."""
    return scene.content.text.changes if scene.content else ()
