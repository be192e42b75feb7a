"""The passes of materials that scatter light; a scene imports those of the materials that it has."""

from collections.abc import Callable, Collection
from typing import Any

from raytrace.passes import materials
from raytrace.records import DIFFUSE, PLASTIC, ROUGH_CONDUCTOR, ROUGH_DIELECTRIC


def scattering_passes(kinds: Collection[int]) -> list[tuple[str, Callable[..., Any]]]:
    """Kernels of the materials that scatter, with their names; all take the same arguments.

    Examples
    --------
    >>> [name for name, _ in scattering_passes({DIFFUSE})]
    ['diffuse']
    """
    passes = [("diffuse", materials.scatter_diffuse)] if DIFFUSE in kinds else []
    if ROUGH_DIELECTRIC in kinds or ROUGH_CONDUCTOR in kinds:
        from raytrace.passes import rough

        passes += [("rough dielectric", rough.scatter_dielectrics)] if ROUGH_DIELECTRIC in kinds else []
        passes += [("rough conductor", rough.scatter_conductors)] if ROUGH_CONDUCTOR in kinds else []
    if PLASTIC in kinds:
        from raytrace.passes.plastic import scatter_plastic

        passes.append(("plastic", scatter_plastic))
    return passes
