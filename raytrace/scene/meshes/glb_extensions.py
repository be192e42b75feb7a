"""Extensions of glTF: which are read, which do not affect the shape, and the warning for all others   [glTF]."""

from raytrace.scene.meshes.errors import UnsupportedError
from raytrace.scene.meshes.glb_json import Record, entries

INSTANCING, VISIBILITY = "EXT_mesh_gpu_instancing", "KHR_node_visibility"
DRACO, MESHOPT = "KHR_draco_mesh_compression", ("EXT_meshopt_compression", "KHR_meshopt_compression")
READ = {INSTANCING, VISIBILITY, "KHR_mesh_quantization"}
HARMLESS = (  # names, or their beginnings: no triangle depends on them
    "ADOBE_materials_",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_lights_",
    "EXT_materials_",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "EXT_texture_",
    "FB_geometry_metadata",
    "KHR_animation_pointer",
    "KHR_audio",
    "KHR_interactivity",
    "KHR_lights_",
    "KHR_materials_",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_physics_",
    "KHR_techniques_webgl",
    "KHR_texture_",
    "KHR_xmp",
    "MSFT_lod",  # the node itself has the finest shape
    "MSFT_packing_",
    "MSFT_texture_",
    "VRM",  # avatars: materials, springs, expressions
    "WEBGL_materials_",
)
COMPRESSED = {DRACO, *MESHOPT}  # used, but not required: the file has the plain data too, or the reader names them


def check_extensions(document: Record) -> list[str]:
    """Return a warning for extensions that may change the shape and are not read.

    Raises
    ------
    UnsupportedError
        The file needs one that is not read.

    Examples
    --------
    >>> check_extensions({"extensionsUsed": ["KHR_materials_ior", "EXT_bend"]})
    ['the extension EXT_bend is not supported; if it changes the shape, the shape is wrong']
    """
    needed = _unknown(document, "extensionsRequired", READ)
    if needed:
        raise UnsupportedError(f"it needs extensions that are not supported: {needed}; export it without them")
    used = _unknown(document, "extensionsUsed", READ | COMPRESSED)
    plural = "s" * (", " in used)
    verb = "are" if plural else "is"
    text = f"the extension{plural} {used} {verb} not supported; if it changes the shape, the shape is wrong"
    return [text.replace("if it changes", "if they change") if plural else text] if used else []


def _unknown(document: Record, key: str, read: set[str]) -> str:
    """Return the names of extensions that are neither read nor harmless."""
    names = dict.fromkeys(map(str, entries(document, key)))
    unknown = [name for name in names if name not in read and not name.startswith(HARMLESS)]
    return ", ".join(name[:80] for name in unknown[:5])
