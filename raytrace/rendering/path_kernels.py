"""Kernels that path tracing needs, with arguments of the kinds that it gives them."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from raytrace.accel import query
from raytrace.accel.lanes import PACKET
from raytrace.passes import compaction, environment, lights, materials, paths, textures
from raytrace.passes.camera import camera_rays
from raytrace.passes.film import make_film, make_frame
from raytrace.passes.lens import lens_rays
from raytrace.passes.light_layers import accumulate_layers, develop_layers, mark_first, split
from raytrace.records import (
    CONDUCTOR,
    DIELECTRIC,
    MIRROR,
    REFRACTIVE,
    Directions,
    Lights,
    Materials,
    Rays,
    Scene,
    Spots,
)
from raytrace.rendering.layered_wavefront import LayeredWavefront
from raytrace.rendering.path_wavefront import PathWavefront
from raytrace.scene.path_plan import NAMES, needs_lens
from raytrace.texture_records import ATTRIBUTE, BILINEAR, CHECKERBOARD, EnvironmentImage, Texture, Textures

Call = tuple[Callable[..., Any], tuple[Any, ...]]  # a kernel and its arguments


class TextureNeeds(NamedTuple):
    """What of the textures of a scene decides which kernels it needs."""

    reflectance: bool
    emission: bool
    uv: bool  # whether images or checkerboards are looked up
    colors: bool  # whether vertex colours are


class PathNeeds(NamedTuple):
    """What of a scene decides which kernels path tracing needs."""

    integrator: str
    kinds: tuple[int, ...]  # of materials
    points: bool
    spots: bool
    directions: bool
    environment: bool
    lamps: bool
    background: bool
    transparent: bool  # shadow rays pass a surface
    light: bool = False  # emission, direct and indirect light are kept
    textures: TextureNeeds | None = None  # None: there are none
    image: bool = False  # of the environment
    lens: bool = False  # a camera that is no pinhole, or a filter that is no box


def path_needs_of(scene: Scene, integrator: str, light: bool = False) -> PathNeeds:
    """What of a scene decides which kernels path tracing needs."""
    used = np.flatnonzero(np.bincount(scene.mesh.material_id))
    emission = scene.materials.emission
    return PathNeeds(
        integrator,
        tuple(sorted(set(scene.materials.kind[used].tolist()))),
        bool((scene.lights.flux > 0).any()),
        scene.lights.spots is not None,
        scene.lights.directions is not None,
        scene.lights.environment is not None,
        emission is not None and bool((emission[used] > 0).any()),
        bool(scene.background.any()),
        bool(scene.materials.transparent_shadow[used].any()),
        light,
        _texture_needs(scene),
        scene.lights.image is not None,
        needs_lens(scene),
    )


def every_need() -> tuple[PathNeeds, ...]:
    """Scenes that together need every kernel of path tracing: all kinds of lights and materials; and no light."""
    kinds = tuple(sorted(NAMES))
    dark = PathNeeds("path", kinds, False, False, False, False, False, background=True, transparent=False)
    return PathNeeds("path", kinds, True, True, True, True, True, background=False, transparent=True), dark


def _texture_needs(scene: Scene) -> TextureNeeds | None:
    textures = scene.textures
    if textures is None:
        return None
    kinds = {texture.kind for texture in textures.table}
    used = bool((textures.reflectance >= 0).any()), bool((textures.emission >= 0).any())
    return TextureNeeds(*used, kinds != {ATTRIBUTE}, ATTRIBUTE in kinds)


def _small_textures(needs: TextureNeeds, n: int) -> Textures:
    one, none = np.ones((1, 2, 3)), np.zeros((0, 0, 3))
    kinds = [(CHECKERBOARD, one)] * needs.uv + [(ATTRIBUTE, none)] * needs.colors
    table = tuple(Texture(kind, codes, None, (1.0, 1.0), np.ones(3)) for kind, codes in kinds)
    rows = (np.full(n, 0 if used else -1, np.int32) for used in (needs.reflectance, needs.emission))
    return Textures(table, *rows)


def small_scene(needs: PathNeeds, scene: Scene) -> Scene:
    """Few triangles that have it all, made from a scene of two triangles."""
    kinds = np.array(needs.kinds, np.int8)
    n = len(kinds)
    one, none = np.ones((n, 3)), np.zeros(n, np.bool_)
    names = tuple(map(str, range(n)))
    transparent = np.full(n, needs.transparent) & ((kinds == REFRACTIVE) | (kinds == DIELECTRIC))
    table = Materials(names, kinds, one, np.ones(n), none, transparent, one if needs.lamps else None, one, one)
    up, vector = np.array([[0.0, 1.0, 0.0]]), np.ones((1, 3))
    place = np.array([[0.0, 0.0, 3.0]])
    sources = Lights(
        position=place if needs.points else place[:0],
        flux=vector if needs.points else vector[:0],
        spots=Spots(place, up, vector, np.ones(1), np.ones(1) / 2) if needs.spots else None,
        directions=Directions(up, vector) if needs.directions else None,
        environment=np.ones(3) if needs.environment else None,
        image=EnvironmentImage(Texture(BILINEAR, vector[None], None, (1.0, 1.0), np.ones(3)), 1.0, np.eye(3))
        if needs.image
        else None,
    )
    mesh = scene.mesh
    rows = np.arange(max(n, 1)) % len(mesh.faces)
    mesh = mesh._replace(
        faces=mesh.faces[rows],
        normals=None if mesh.normals is None else mesh.normals[rows],
        material_id=np.arange(len(rows), dtype=np.int32),
        object_id=np.zeros(len(rows), np.int32),
    )
    textures = None
    if needs.textures is not None:
        textures, corners = _small_textures(needs.textures, n), np.zeros((len(rows), 3, 3))
        mesh = mesh._replace(uv=corners[:, :, :2], colors=corners)
    background = np.ones(3) if needs.background else np.zeros(3)
    settings = scene.settings._replace(integrator=needs.integrator)
    camera = scene.camera._replace(aperture=float(needs.lens))
    made = replace(scene, materials=table, lights=sources, mesh=mesh, background=background, settings=settings)
    return replace(made, textures=textures, camera=camera)


def path_tracing(front: PathWavefront, rays: Rays) -> Iterator[Call]:
    """Kernels that a wavefront of paths calls; ``rays`` are any of its precision."""
    scene, here, vertices, incident = front.scene, front.paths, front.vertices, front.incident
    pixels, numbers = np.zeros(PACKET, np.uint32), np.zeros(2, np.int64)
    yield query.closest_hit, (scene.bvh.tree, rays, here.rays.hits, 0, front.work)
    if front.samples_lights:
        yield query.any_hit, (scene.shadow_bvh.tree, rays, incident.occluded, 0, front.work)
    if scene.lens is None:
        yield camera_rays, (front.view, front.sampler, pixels, pixels, numbers, here.rays.d)
    else:
        yield lens_rays, (front.view, scene.lens, front.sampler, pixels, pixels, numbers, here.rays)
    yield paths.begin_paths, (front.sampler.seed, pixels, pixels, numbers, here, front.radiance)
    if scene.lamps:
        yield paths.see_lamps, (here, 0, scene.shading, scene.surfaces, scene.lamp_textures, front.radiance)
    if scene.image is not None:
        yield environment.see_image, (here, 0, scene.image, front.radiance)
    elif scene.environment is not None:
        yield paths.see_environment, (here, 0, scene.environment, front.radiance)
    elif scene.background is not None:
        yield paths.see_background, (here, 0, scene.background, front.radiance)
    yield paths.meet_surfaces, (here, 0, scene.shading, scene.normals, vertices)
    if scene.textures is not None:
        yield textures.look_up_reflectance, (here, 0, scene.textures, scene.surfaces, vertices)
    if front.samples_lights:
        yield from _light_calls(front)
        yield compaction.pack_shadow_rays, (incident, 0, front.grid, front.order, front.others)
        yield compaction.add_light, (here, 0, incident, front.order, front.radiance)
    yield from _material_calls(front)
    yield compaction.go_on, (here, 0, 1, front.grid, front.order, front.others)
    if isinstance(front, LayeredWavefront):
        yield from _layer_calls(front)


def _layer_calls(front: LayeredWavefront) -> Iterator[Call]:
    film, here = make_film(PACKET, light=True), front.paths
    yield mark_first, (here, 0)
    yield split, (here, 0, 1, front.light, front.radiance, front.layers)
    yield accumulate_layers, (front.layers, 0, 0, film.sums, 0, PACKET)
    yield develop_layers, (film.sums, film.samples, np.zeros(0, np.int64), 0, 0, make_frame(0).light)


def _light_calls(front: PathWavefront) -> Iterator[Call]:
    scene, here, vertices, incident = front.scene, front.paths, front.vertices, front.incident
    table, kinds = scene.lights, scene.light_kinds
    yield lights.pick_lights, (front.sampler, here, 0, 1, table, scene.surfaces, vertices, incident)
    if lights.TRIANGLE in kinds:
        lamps = scene.shading, scene.lamp_textures
        yield lights.sample_triangles, (front.sampler, here, 0, 1, table, *lamps, vertices, incident)
    if lights.POINT in kinds:
        yield lights.sample_points, (here, 0, table, vertices, incident)
    if lights.SPOT in kinds:
        yield lights.sample_spots, (here, 0, table, vertices, incident)
    if lights.DIRECTIONAL in kinds:
        yield lights.sample_directions, (here, 0, table, vertices, incident)
    if scene.image is not None:
        yield environment.sample_image, (front.sampler, here, 0, 1, table, scene.image, vertices, incident)
    elif lights.ENVIRONMENT in kinds:
        yield lights.sample_environment, (front.sampler, here, 0, 1, table, vertices, incident)
    if scene.passed_bvh is not None:
        yield lights.claim_light, (0, incident)


def _material_calls(front: PathWavefront) -> Iterator[Call]:
    scene, here, vertices = front.scene, front.paths, front.vertices
    surfaces, kinds = scene.surfaces, scene.kinds
    for _, scatter in front.scattering:
        yield scatter, (front.sampler, here, 0, 1, 0, surfaces, vertices, front.incident)
    if MIRROR in kinds:
        yield materials.reflect_mirrors, (here, 0, surfaces, vertices)
    if CONDUCTOR in kinds:
        yield materials.reflect_conductors, (here, 0, surfaces, vertices)
    if DIELECTRIC in kinds:
        yield materials.pass_dielectrics, (here, 0, 1, surfaces, vertices)
    if REFRACTIVE in kinds:
        yield materials.pass_interfaces, (here, 0, surfaces, vertices)
