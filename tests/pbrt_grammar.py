"""A parser of pbrt-v4's scene format, as its documentation defines it: directives, parameter types, blocks, references.

It knows the parameters of the plugins that the export uses, so a misspelt or misplaced one is an error.
"""

import re
from dataclasses import dataclass, field
from typing import Any

TOKEN = re.compile(r'\s+|#[^\n]*|"(?:[^"\\\n]|\\.)*"|[\[\]]|[^\s"\[\]]+')
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")

# directive: how many numbers, or how many strings and then parameters, follow it
NUMBERS = {"LookAt": 9, "Scale": 3, "Translate": 3, "Rotate": 4}
PLUGINS = {
    **dict.fromkeys(("Camera", "Film", "Integrator", "PixelFilter", "Sampler", "Accelerator"), 1),
    **dict.fromkeys(("LightSource", "AreaLightSource", "Shape", "Material", "MakeNamedMaterial"), 1),
    "Texture": 3,
}
BARE = {"AttributeBegin", "AttributeEnd", "WorldBegin", "ReverseOrientation", "Identity"}
SETTINGS = {"Camera", "Film", "Integrator", "PixelFilter", "Sampler", "Accelerator", "Option"}  # before WorldBegin
SCENERY = {"LightSource", "AreaLightSource", "Shape", "Material", "MakeNamedMaterial", "NamedMaterial", "Texture"}

# parameter type: numbers in a value, or what a value is
TYPES = {"integer": 1, "float": 1, "point2": 2, "vector2": 2, "point3": 3, "vector3": 3, "normal": 3, "rgb": 3}
TYPES |= {"bool": 0, "string": 0, "texture": 0, "spectrum": 0}

SPECTRUM = ("rgb", "spectrum", "texture")
ROUGHNESS = {"roughness": ("float", "texture"), "remaproughness": ("bool",)}
UV = {"uscale": ("float",), "vscale": ("float",)}
SCREEN = {"screenwindow": ("float",), "lensradius": ("float",), "focaldistance": ("float",)}
KNOWN: dict[tuple[str, str], dict[str, tuple[str, ...]]] = {
    ("Integrator", "path"): {"maxdepth": ("integer",)},
    ("Sampler", "independent"): {"pixelsamples": ("integer",)},
    ("PixelFilter", "box"): {"xradius": ("float",), "yradius": ("float",)},
    ("PixelFilter", "triangle"): {"xradius": ("float",), "yradius": ("float",)},
    ("PixelFilter", "gaussian"): {"xradius": ("float",), "yradius": ("float",), "sigma": ("float",)},
    ("Film", "rgb"): {
        "xresolution": ("integer",),
        "yresolution": ("integer",),
        "filename": ("string",),
        "savefp16": ("bool",),
    },
    ("Camera", "perspective"): SCREEN | {"fov": ("float",)},
    ("Camera", "orthographic"): SCREEN,
    ("LightSource", "point"): {"from": ("point3",), "I": SPECTRUM[:2]},
    ("LightSource", "spot"): {
        "from": ("point3",),
        "to": ("point3",),
        "I": SPECTRUM[:2],
        "coneangle": ("float",),
        "conedeltaangle": ("float",),
    },
    ("LightSource", "distant"): {"from": ("point3",), "to": ("point3",), "L": SPECTRUM[:2]},
    ("LightSource", "infinite"): {"L": SPECTRUM[:2], "filename": ("string",)},
    ("AreaLightSource", "diffuse"): {"L": SPECTRUM[:2], "filename": ("string",), "twosided": ("bool",)},
    ("Shape", "plymesh"): {"filename": ("string",)},
    ("Texture", "imagemap"): UV | dict.fromkeys(("filename", "wrap", "filter", "encoding"), ("string",)),
    ("Texture", "checkerboard"): UV | {"tex1": SPECTRUM, "tex2": SPECTRUM},
    ("Material", "diffuse"): {"reflectance": SPECTRUM},
    ("Material", "coateddiffuse"): ROUGHNESS | {"reflectance": SPECTRUM, "eta": ("float",)},
    ("Material", "dielectric"): ROUGHNESS | {"eta": ("float",)},
    ("Material", "conductor"): ROUGHNESS | {"reflectance": SPECTRUM, "eta": SPECTRUM, "k": SPECTRUM},
}


@dataclass
class Directive:
    """A directive: its words, numbers, and parameters as name -> (type, values)."""

    name: str
    words: list[str] = field(default_factory=list)
    numbers: list[float] = field(default_factory=list)
    parameters: dict[str, tuple[str, list[Any]]] = field(default_factory=dict)
    depth: int = 0  # attribute blocks around it

    def values(self, name: str) -> list[Any]:
        return self.parameters[name][1]

    def value(self, name: str) -> Any:
        (found,) = self.values(name)
        return found


def tokens(text: str) -> list[str]:
    """Split a text; white space and comments are dropped."""
    found, at = [], 0
    while at < len(text):
        match = TOKEN.match(text, at)
        assert match, f"no token at {text[at : at + 20]!r}"
        at = match.end()
        if not match.group().isspace() and not match.group().startswith("#"):
            found.append(match.group())
    return found


class Parser:
    """Parses a file into directives; an AssertionError says what is wrong."""

    def __init__(self, text: str) -> None:
        self.left = tokens(text)[::-1]

    def parse(self) -> list[Directive]:
        found, depth, world = [], 0, False
        while self.left:
            directive = self.directive(self.left.pop())
            assert not (world and directive.name in SETTINGS), f"{directive.name} after WorldBegin"
            assert world or directive.name not in SCENERY, f"{directive.name} before WorldBegin"
            assert not (world and directive.name == "WorldBegin"), "a second WorldBegin"
            world = world or directive.name == "WorldBegin"
            depth += {"AttributeBegin": 1, "AttributeEnd": -1}.get(directive.name, 0)
            assert depth >= 0, "AttributeEnd without AttributeBegin"
            directive.depth = depth
            found.append(directive)
        assert depth == 0, "AttributeBegin without AttributeEnd"
        assert world, "no WorldBegin"
        check_references(found)
        return found

    def directive(self, name: str) -> Directive:
        if name in BARE:
            return Directive(name)
        if name in NUMBERS:
            return Directive(name, numbers=[self.number() for _ in range(NUMBERS[name])])
        if name == "NamedMaterial":
            return Directive(name, [self.string()])
        if name == "Option":
            return Directive(name, [self.string(), self.left.pop()])
        assert name in PLUGINS, f"unknown directive {name}"
        made = Directive(name, [self.string() for _ in range(PLUGINS[name])])
        while self.left and self.left[-1].startswith('"'):
            kind, key = self.string().split()
            assert key not in made.parameters, f"{key} twice"
            made.parameters[key] = kind, self.parameter(kind)
        check_parameters(made)
        return made

    def parameter(self, kind: str) -> list[Any]:
        assert kind in TYPES, f"unknown type {kind}"
        words = []
        if self.left[-1] == "[":
            self.left.pop()
            while self.left[-1] != "]":
                words.append(self.left.pop())
            self.left.pop()
        else:
            words.append(self.left.pop())
        if kind == "bool":
            assert set(words) <= {"true", "false"}
            return [word == "true" for word in words]
        if not TYPES[kind]:
            assert all(word.startswith('"') for word in words), f"{kind}: expected strings, got {words}"
            return [unquoted(word) for word in words]
        assert all(NUMBER.match(word) for word in words), f"{kind}: expected finite numbers, got {words}"
        assert len(words) % TYPES[kind] == 0, f"{kind}: {len(words)} numbers"
        return [int(word) if kind == "integer" else float(word) for word in words]

    def string(self) -> str:
        word = self.left.pop()
        assert word.startswith('"'), f"expected a string, got {word}"
        return unquoted(word)

    def number(self) -> float:
        word = self.left.pop()
        assert NUMBER.match(word), f"expected a number, got {word}"
        return float(word)


def unquoted(word: str) -> str:
    return re.sub(r"\\(.)", r"\1", word[1:-1])


def check_parameters(made: Directive) -> None:
    """Check that a plugin has these parameters, with these types."""
    plugin, given = (made.name, made.words[-1]), dict(made.parameters)
    if made.name == "MakeNamedMaterial":
        plugin = "Material", given.pop("type")[1][0]
    assert plugin in KNOWN, f"unknown plugin {plugin}"
    for key, (kind, _) in given.items():
        assert key in KNOWN[plugin], f"{plugin} has no parameter {key}"
        assert kind in KNOWN[plugin][key], f"{plugin}: {key} cannot be of type {kind}"
    if plugin == ("Material", "conductor"):
        assert not ("reflectance" in given and ("eta" in given or "k" in given)), "both reflectance and eta"
    if plugin[0] in ("LightSource", "AreaLightSource"):
        assert not {"L", "filename"} <= given.keys(), "both L and filename"


def check_references(directives: list[Directive]) -> None:
    """Check that materials and textures are defined before they are used."""
    materials, textures = set(), set()
    for each in directives:
        for kind, values in each.parameters.values():
            assert kind != "texture" or set(values) <= textures, f"unknown textures {values}"
        if each.name == "MakeNamedMaterial":
            assert each.words[0] not in materials, f"material {each.words[0]} twice"
            materials.add(each.words[0])
        if each.name == "Texture":
            textures.add(each.words[0])
        assert each.name != "NamedMaterial" or each.words[0] in materials, f"unknown material {each.words[0]}"


def parse(text: str) -> list[Directive]:
    """Return the directives of a file."""
    return Parser(text).parse()
