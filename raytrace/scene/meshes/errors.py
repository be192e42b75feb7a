"""Why a mesh file is refused although its content may be right."""


class UnsupportedError(ValueError):
    """The file uses something that is not supported; the text names it."""


class TooLargeError(ValueError):
    """The file is larger than a limit; the text names both numbers."""


class TooManyTrianglesError(TooLargeError):
    """The file places more triangles than there may be.

    Parameters
    ----------
    triangles : int
        How many it places.
    load : float
        The same, with vertices that few triangles share counted in: what its memory depends on.
    """

    def __init__(self, triangles: int, load: float) -> None:
        super().__init__(f"it places {triangles:,} triangles")
        self.triangles, self.load = triangles, load
