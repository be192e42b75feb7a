"""The suite, one noun per file; ``suite`` makes all cases."""

from raytrace.conformance.case import Case


def suite() -> tuple[Case, ...]:
    """Return all cases, in the order of the documents."""
    from raytrace.conformance.cases import cameras, environments, furnaces, glass, lamps, lights, mirrors, textures

    modules = (furnaces, lights, lamps, environments, mirrors, glass, cameras, textures)
    return tuple(case for module in modules for case in module.cases())
