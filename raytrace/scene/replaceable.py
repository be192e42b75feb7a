"""``Scene.replace``, and a check of what ``dataclasses.replace`` is given instead."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from raytrace.errors import SceneError

if TYPE_CHECKING:
    from raytrace.records import Scene


class Replaceable:
    """A scene that can be copied with other values."""

    def replace(self, changes: Mapping[str, Any] | None = None, /, **sections: Any) -> Scene:
        """Return this scene with other values.

        Parameters
        ----------
        changes : mapping of str to object, optional
            Path of a key -> its value; None removes the key. They count in their order, after the sections.
        **sections
            ``camera``, ``film``, ``render``, ``lights``, ``materials``, ``objects``, ``background``, ``about``: each
            replaces the whole section, and is what a scene file has there, or a dict given to ``rt.load``.

        Returns
        -------
        Scene
            Checked as ``rt.load`` checks it, with a hash of its own. It shares the trees of this scene where the
            triangles are the same. Where lights, materials or objects change, the mesh files are read again.

        Raises
        ------
        SceneError, FileError
            As ``rt.load`` does; also where a program made the scene of records, which have no form as a file.

        Examples
        --------
        >>> import raytrace as rt
        >>> scene = rt.load("scenes/cornell-box.json")
        >>> scene.replace({"camera.fov": 30, "materials.grey.albedo": [0.5, 0.5, 0.5]}).camera.fov
        30.0
        >>> scene.replace(film={"size": [64, 64]}).settings.size
        (64, 64)
        >>> scene.replace({"camera.fow": 30})
        Traceback (most recent call last):
        raytrace.errors.SceneError: scenes/cornell-box.json: camera.fow: unknown key "fow"; did you mean "fov"?
        """
        from raytrace.scene.replaced import replaced_by_program

        return replaced_by_program(self, changes or {}, sections)  # type: ignore[arg-type]


def check_records(scene: Any, **kinds: type) -> None:
    """Refuse a scene whose fields are not records; kinds: the record of each field.

    Raises
    ------
    SceneError
        As for ``dataclasses.replace(scene, camera={...})``.
    """
    for name, kind in kinds.items():
        value = getattr(scene, name)
        if not isinstance(value, kind):
            cure = "film= or render=" if name == "settings" else f"{name}="
            text = f"expected a {kind.__name__} record, got {type(value).__name__}; use scene.replace({cure}...)"
            raise SceneError([f"{name}: {text}"])
