"""The scene format: these models are the format, and the JSON Schema is generated from them.

A model says what each key may hold by itself. What two keys must agree on (a material that exists, a camera that does
not look at itself) stands in ``checks.py``; where a problem lies in the file, in ``positions.py``.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from raytrace.limits import MAX_DEPTH, MAX_PIXELS, MAX_SEED, MAX_SIDE, MAX_SPP
from raytrace.scene.metals import Metal
from raytrace.scene.rules import check_film, check_scale, spread_number

Number = Annotated[float, Field(strict=True)]
NonNegative = Annotated[float, Field(strict=True, ge=0)]
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Side = Annotated[int, Field(strict=True, ge=1, json_schema_extra={"maximum": MAX_SIDE})]
Point = tuple[Number, Number, Number]
Colour = tuple[NonNegative, NonNegative, NonNegative]
Albedo = tuple[Share, Share, Share]
Index = Annotated[float, Field(strict=True, gt=0, le=1000)]
Absorption = Annotated[float, Field(strict=True, ge=0, le=1000)]
Positive = tuple[Index, Index, Index]
Extinction = tuple[Absorption, Absorption, Absorption]
Size = Annotated[tuple[Side, Side], AfterValidator(check_film)]
Scale = Annotated[
    Point, BeforeValidator(spread_number, json_schema_input_type=Number | Point), AfterValidator(check_scale)
]


class Model(BaseModel):
    """What all models share: no unknown keys, no NaN, no infinities, no change after loading."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class Camera(Model):
    """A pinhole camera."""

    position: Point = Field(description="The pinhole, world units.")
    look_at: Point = Field(description="The point seen at the centre of the film, world units.")
    up: Point = Field((0.0, 1.0, 0.0), description="Points to the top of the film; any length.")
    fov: Annotated[float, Field(strict=True, gt=0, lt=180)] = Field(
        description="Field of view from the bottom of the film to its top, degrees."
    )


class Film(Model):
    """The picture's raster."""

    size: Size = Field((512, 512), description=f"Width and height, pixels; at most {MAX_PIXELS} pixels in all.")


class Render(Model):
    """How the scene asks to be rendered; the command line and ``rt.render`` can override it."""

    spp: Annotated[int, Field(strict=True, ge=1, le=MAX_SPP)] = Field(16, description="Samples per pixel.")
    max_depth: Annotated[int, Field(strict=True, ge=1, le=MAX_DEPTH)] = Field(
        16, description="The most surfaces that a path may meet, the one that scatters its light included."
    )
    sampler: Literal["sobol", "stratified", "independent"] = Field(
        "sobol", description="Where in the pixel the samples lie: Owen-scrambled Sobol, jittered grid, or independent."
    )
    integrator: Literal["direct", "path"] = Field(
        "direct", description="direct: light that comes straight from the lights; path: all the light, by path tracing."
    )
    precision: Literal["auto", "float32", "float64"] = Field(
        "auto", description="Arithmetic of the rays; auto takes float32 where the scene allows it."
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=MAX_SEED)] = Field(
        0, description="Another seed gives other noise; the same seed gives the same bits."
    )


class PointLight(Model):
    """A point that sends its flux evenly in all directions."""

    type: Literal["point"] = Field(description="The kind of light: point.")
    position: Point = Field(description="Where the light stands, world units.")
    flux: Colour = Field(description="Power sent out in all directions together, watt for red, green and blue.")


class SpotLight(Model):
    """A point that sends light into a cone around an axis."""

    type: Literal["spot"] = Field(description="The kind of light: spot.")
    position: Point = Field(description="Where the light is, world units.")
    look_at: Point = Field(description="A point on the axis of the cone, world units.")
    intensity: Colour = Field(description="Intensity on the axis, W / sr for red, green and blue.")
    cutoff: Annotated[float, Field(strict=True, gt=0, le=90)] = Field(
        description="Angle from the axis from which on there is no light, degrees."
    )
    beam: Annotated[float, Field(strict=True, ge=0, le=90)] | None = Field(
        None,
        description="Angle from the axis up to which the intensity is full, degrees; linear in the angle from there to "
        "cutoff. Default: 3/4 of cutoff.",
    )


class DirectionalLight(Model):
    """Parallel light from infinitely far away."""

    type: Literal["directional"] = Field(description="The kind of light: directional.")
    direction: Point = Field(description="Where the light goes; any length but 0.")
    irradiance: Colour = Field(description="On a plane that faces the light, W / m2 for red, green and blue.")


class EnvironmentLight(Model):
    """The same radiance from all directions; it is visible."""

    type: Literal["environment"] = Field(description="The kind of light: environment.")
    radiance: Colour = Field(description="Radiance from all directions, W / (sr m2) for red, green and blue.")


Light = Annotated[PointLight | SpotLight | DirectionalLight | EnvironmentLight, Field(discriminator="type")]


class Diffuse(Model):
    """A matt surface that sends albedo / pi of the irradiance in every direction."""

    type: Literal["diffuse"] = Field(description="The kind of material: diffuse.")
    albedo: Albedo = Field(description="Share of the light that is reflected, 0 to 1 for red, green and blue.")
    two_sided: Annotated[bool, Field(strict=True)] = Field(
        False, description="Whether light from behind the geometric normal is reflected too."
    )
    emission: Colour | None = Field(
        None, description="Radiance that the front of the surface emits, W / (sr m2) for red, green and blue: a lamp."
    )


class Refractive(Model):
    """A perfectly clear interface: Snell's law, all light transmitted, total internal reflection."""

    type: Literal["refractive"] = Field(description="The kind of material: refractive.")
    ior: Annotated[float, Field(strict=True, gt=0)] = Field(
        description="Index of refraction inside (behind the normal) over the one outside."
    )
    shadows: Literal["opaque", "transparent"] = Field(
        "opaque", description="Whether the surface stops shadow rays, or lets them pass straight through."
    )


class Dielectric(Model):
    """A smooth interface such as glass or water: reflects and transmits by Fresnel's equations."""

    type: Literal["dielectric"] = Field(description="The kind of material: dielectric.")
    ior: Annotated[float, Field(strict=True, gt=0)] = Field(
        description="Index of refraction inside (behind the normal) over the one outside."
    )
    shadows: Literal["opaque", "transparent"] = Field(
        "opaque", description="Whether the surface stops shadow rays, or lets them pass straight through, unbent."
    )


class Mirror(Model):
    """A mirror on both sides, whose reflectance does not depend on the angle."""

    type: Literal["mirror"] = Field(description="The kind of material: mirror.")
    reflectance: Albedo = Field((1.0, 1.0, 1.0), description="Share of the light that is reflected, 0 to 1.")


class Conductor(Model):
    """A smooth metal, by name, by index of refraction, or by reflectance: Fresnel's equations on both sides."""

    type: Literal["conductor"] = Field(description="The kind of material: conductor.")
    metal: Metal | None = Field(None, description="A metal of the table in docs/conventions.md.")
    eta: Positive | None = Field(None, description="Index of refraction for red, green and blue; with k.")
    k: Extinction | None = Field(None, description="Absorption index for red, green and blue; with eta.")
    reflectance: Albedo | None = Field(None, description="Share that is reflected at normal incidence, 0 to 1.")


Material = Annotated[Diffuse | Mirror | Dielectric | Conductor | Refractive, Field(discriminator="type")]


class Rotation(Model):
    """A turn about an axis through the mesh's origin, counter-clockwise seen from the axis' tip."""

    axis: Point = Field(description="Direction of the axis; any length but 0.")
    angle: Number = Field(description="Angle of the turn, degrees.")


class Object(Model):
    """A mesh, what it is made of, and where it stands: scaled, then rotated, then translated."""

    mesh: Annotated[str, Field(min_length=1)] = Field(
        description="Path of an OBJ, PLY, STL, GLB or glTF file, or of another format that trimesh reads; plain or "
        "with .gz; relative to the scene file."
    )
    material: str = Field(description="A name in materials.")
    scale: Scale = Field(
        (1.0, 1.0, 1.0), description="Factor for all axes, or one for each; negative mirrors, 0 is an error."
    )
    rotate: Rotation | None = Field(None, description="A turn, or null for none.")
    translate: Point = Field((0.0, 0.0, 0.0), description="Shift, world units.")
    normals: Literal["flat", "smooth"] = Field(
        "flat",
        description="Shading normals: of the triangles, or of the file's vertices (averaged where it has none).",
    )


class SceneFile(Model):
    """A whole scene."""

    schema_: str | None = Field(None, alias="$schema", description="For editors: the address of this schema; unused.")
    about: str = Field("", description="One sentence for people.")
    camera: Camera = Field(description="Where the picture is taken from.")
    film: Film = Field(Film(), description="How large the picture is.")
    render: Render = Field(Render(), description="How to render.")
    lights: list[Light] = Field([], description="What lights the scene.")
    materials: dict[str, Material] = Field(description="What surfaces are made of, by name.")
    objects: list[Object] = Field(min_length=1, description="What stands in the scene.")
    background: Colour = Field(
        (0.0, 0.0, 0.0), description="Radiance of rays that leave the scene, W / (sr m2) for red, green and blue."
    )


def json_schema() -> dict[str, Any]:
    """Generate the JSON Schema (draft 2020-12) of the scene format.

    Examples
    --------
    >>> json_schema()["title"]
    'raytrace scene'
    """
    schema = SceneFile.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "raytrace scene"}
