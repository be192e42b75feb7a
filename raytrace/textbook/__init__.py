"""The algorithm as textbooks present it: NumPy with masks on batches of rays, and nothing else.

Each function is the formula of its source, without optimizations. ``render`` renders every scene that ships with the
package, slowly. Read this package before the kernels: docs/textbook.md leads from each function to the fast one.
"""

from raytrace.textbook.box import slab
from raytrace.textbook.camera import pinhole_rays, pixel_centres, stratified
from raytrace.textbook.integrator import integrate, render
from raytrace.textbook.path import fresnel, path_trace
from raytrace.textbook.sampling import cosine_hemisphere, power_heuristic, to_world, uniform_triangle
from raytrace.textbook.shading import direct_light, irradiance, reflect, refract, surface_at
from raytrace.textbook.tree import Tree, median_split, traverse
from raytrace.textbook.triangle import moller_trumbore

__all__ = [
    "Tree",
    "cosine_hemisphere",
    "direct_light",
    "fresnel",
    "integrate",
    "irradiance",
    "median_split",
    "moller_trumbore",
    "path_trace",
    "pinhole_rays",
    "pixel_centres",
    "power_heuristic",
    "reflect",
    "refract",
    "render",
    "slab",
    "stratified",
    "surface_at",
    "to_world",
    "traverse",
    "uniform_triangle",
]
