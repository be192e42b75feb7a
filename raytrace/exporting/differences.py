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
        self._found: dict[tuple[str, str], list[str]] = {}

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
        places = self._found.setdefault((what, instead), [])
        if where not in places:
            places.append(where)

    def settle(self, approximate: bool) -> tuple[str, ...]:
        """Return one warning per difference.

        Raises
        ------
        SceneError
            There are differences, and no approximation is allowed.
        """
        allowed = "" if approximate else "with --approximate, "
        lines = [
            f"{self._source}: {printable(', '.join(places))}: {what}; {allowed}{instead}"
            for (what, instead), places in self._found.items()
        ]
        if lines and not approximate:
            raise SceneError(lines)
        return tuple(lines)
