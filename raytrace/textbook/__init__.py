"""The algorithm as textbooks present it: NumPy with masks on batches of rays, and nothing else.

Each function is the formula of its source, without optimizations. ``render`` renders every scene that ships with the
package, slowly. Read this package before the kernels: docs/textbook.md leads from each function to the fast one.
"""

from raytrace.textbook.box import slab
from raytrace.textbook.camera import pinhole_rays, pixel_centres, stratified
from raytrace.textbook.integrator import integrate, render
from raytrace.textbook.shading import direct_light, irradiance, reflect, refract, surface_at
from raytrace.textbook.tree import Tree, median_split, traverse
from raytrace.textbook.triangle import moller_trumbore

__all__ = [
    "Tree",
    "direct_light",
    "integrate",
    "irradiance",
    "median_split",
    "moller_trumbore",
    "pinhole_rays",
    "pixel_centres",
    "reflect",
    "refract",
    "render",
    "slab",
    "stratified",
    "surface_at",
    "traverse",
]
