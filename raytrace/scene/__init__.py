"""From a scene file to arrays: the format, its errors, its meshes."""

from importlib.resources import files


def schema_text() -> str:
    """Return the JSON Schema of the scene format as shipped, without importing pydantic.

    Examples
    --------
    >>> schema_text().startswith("{")
    True
    """
    return files("raytrace.scene").joinpath("scene.schema.json").read_text("utf-8")
