"""What another renderer cannot express of a scene."""

from raytrace.errors import SceneError, printable
from raytrace.records import Scene


class Differences:
    """Collects what the other renderer has no equal for, and what the export writes instead.

    Parameters
    ----------
    scene : Scene
    renderer : str
        Name of the other renderer, for messages.
    """

    def __init__(self, scene: Scene, renderer: str) -> None:
        self.renderer = renderer
        self._source = printable(scene.source or "scene")
        self._found: list[tuple[str, str]] = []

    def add(self, where: str, what: str, instead: str) -> None:
        """Note one difference.

        Parameters
        ----------
        where : str
            Its key in the scene, such as ``materials.glass``.
        what : str
            What the other renderer does not have.
        instead : str
            What the export writes for it with ``approximate``.
        """
        row = f"{self._source}: {printable(where)}: {what}", instead
        if row not in self._found:
            self._found.append(row)

    def settle(self, approximate: bool) -> tuple[str, ...]:
        """Return one warning per difference.

        Raises
        ------
        SceneError
            There are differences, and no approximation is allowed.
        """
        if self._found and not approximate:
            raise SceneError([f"{what}; with --approximate, {instead}" for what, instead in self._found])
        return tuple(f"{what}; {instead}" for what, instead in self._found)
