"""Errors of mesh files that are refused although their content may be valid."""


class UnsupportedError(ValueError):
    """The file uses something that is not supported; the text names it."""


class TooLargeError(ValueError):
    """The file is larger than a limit; the text names both numbers."""


class TooManyTrianglesError(TooLargeError):
    """The file places more triangles than are allowed.

    Parameters
    ----------
    triangles : int
        How many it places.
    load : float
        The same, with the vertices that few triangles share included: its memory depends on this.
    """

    def __init__(self, triangles: int, load: float) -> None:
        super().__init__(f"it places {triangles:,} triangles")
        self.triangles, self.load = triangles, load
