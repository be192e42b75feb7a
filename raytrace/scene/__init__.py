"""Scene files to arrays: the format, its errors, its meshes."""

from pkgutil import get_data


def schema_text() -> str:
    """Return the JSON Schema that defines the scene format.

    Examples
    --------
    >>> schema_text().startswith("{")
    True
    """
    return (get_data(__name__, "scene.schema.json") or b"").decode()  # from a zip as well
