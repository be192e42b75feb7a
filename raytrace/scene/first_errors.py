"""The first errors of a scene that has very many: pydantic words all that it finds, at a kilobyte each."""

from itertools import islice
from typing import Any

from pydantic import BaseModel, ValidationError

from raytrace.scene import schema
from raytrace.scene.problems import MOST

ENOUGH = 20 * MOST  # errors that are worded at once
DEPTH = 4  # of objects in each other that hold keys of the format
MODELS: tuple[type[BaseModel], ...] = (
    *(schema.SceneFile, schema.Camera, schema.Film, schema.Render, schema.PointLight),
    *(schema.SpotLight, schema.DirectionalLight, schema.EnvironmentLight),
    *(schema.Diffuse, schema.Mirror, schema.Dielectric, schema.Conductor, schema.Refractive),
    *(schema.Object, schema.Rotation),
)
KEYS = {field.alias or name for model in MODELS for name, field in model.model_fields.items()}


def first_errors(error: ValidationError, data: Any) -> ValidationError:
    """Return the errors of the beginning of a scene, more than `MOST` if it has as many.

    Parameters
    ----------
    error : pydantic.ValidationError
        Of the whole.
    data : object
        The scene as JSON types.

    Returns
    -------
    pydantic.ValidationError
        The same, where there are not very many.
    """
    if error.error_count() <= ENOUGH:
        return error
    low, high, found = 0, MOST, _errors(beginning(data, MOST))
    while found is None or found.error_count() <= MOST:  # ends: of the whole there are more
        low, high = high, 2 * high
        found = _errors(beginning(data, high))
    while found.error_count() > ENOUGH and high - low > 1:
        middle = (low + high) // 2
        fewer = _errors(beginning(data, middle))
        if fewer is None or fewer.error_count() <= MOST:
            low = middle
        else:
            high, found = middle, fewer
    return found


def beginning(value: Any, most: int, depth: int = DEPTH) -> Any:
    """Return a copy with at most so many entries of each list and object, and all keys of the format.

    Examples
    --------
    >>> beginning({"a": [1, 2, 3], "b": 1, "fov": 2}, 1)
    {'a': [1], 'fov': 2}
    """
    if depth and isinstance(value, list):
        return [beginning(item, most, depth - 1) for item in islice(value, most)]
    if depth and isinstance(value, dict):
        kept = set(islice(value, most)) | (KEYS & value.keys())
        return {key: beginning(item, most, depth - 1) for key, item in value.items() if key in kept}
    return value


def _errors(data: Any) -> ValidationError | None:
    try:
        schema.SceneFile.model_validate(data)
    except ValidationError as error:
        return error
    return None
