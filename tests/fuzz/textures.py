"""Textures of many kinds and their mutations, decoded here a second time, and scenes that show them texel by texel."""

import io
import json
import zlib
from pathlib import Path
from random import Random
from typing import Any

import images
import mutations
import numpy as np
from mill import Case

SCENE, PICTURE = "texture.json", "picture.npz"
SIZE = (6, 4)  # of the film
CODES16 = np.arange(96, dtype=np.uint32) * 40503 % 65536
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
PASSES = (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)
WORDS = [SCENE, "-o", PICTURE, "--threads", "1", "--quiet"]


def scene_of(name: str, encoding: str | None) -> dict[str, Any]:
    """A lamp whose radiance is an image, seen head-on: a film that just covers it."""
    texture = {"image": name, "filter": "nearest"} | ({"encoding": encoding} if encoding else {})
    height = SIZE[1] / SIZE[0]
    return {
        "camera": {"position": [0, 0, height], "look_at": [0, 0, 0], "fov": 90},
        "film": {"size": SIZE},
        "render": {"spp": 1, "sampler": "independent", "precision": "float64", "max_depth": 1},
        "materials": {"a": {"type": "diffuse", "albedo": [0, 0, 0], "emission": texture}},
        "objects": [{"rectangle": {}, "material": "a", "scale": [1, height, 1]}],
    }


def jpegs() -> dict[str, bytes]:
    """JPEG files; two of them are refused, or warned of."""
    from PIL import Image

    rgb = Image.fromarray(images.CODES.repeat(3, axis=0).repeat(3, axis=1))
    exif = Image.Exif()
    exif[0x0112] = 6
    kinds: dict[str, tuple[Any, dict[str, Any]]] = {
        "plain.jpg": (rgb, {}),
        "grey.jpg": (rgb.convert("L"), {}),
        "slow.jpeg": (rgb, {"progressive": True, "quality": 95}),
        "fine.jpg": (rgb, {"subsampling": 0, "restart_marker_blocks": 1}),
        "turned.jpg": (rgb, {"exif": exif}),
        "ink.jpg": (rgb.convert("CMYK"), {}),
    }
    files = {}
    for name, (image, options) in kinds.items():
        stream = io.BytesIO()
        image.save(stream, "JPEG", **options)
        files[name] = stream.getvalue()
    return files


def wide_pngs() -> dict[str, bytes]:
    """PNG files of 16 bits."""
    files = {}
    for kind, channels in CHANNELS.items():
        if kind != 3:
            codes = np.resize(CODES16, (4, 6, channels)).astype(">u2")
            files[f"wide{kind}.png"] = images.png([row.tobytes() for row in codes], 16, kind)
            parts = [codes[top::down, left::across] for left, top, across, down in PASSES]
            rows = [row.tobytes() for part in parts if part.size for row in part]
            files[f"woven{kind}.png"] = images.png(rows, 16, kind, interlaced=1)
    return files


def files() -> dict[str, bytes]:
    """Files of all kinds."""
    pngs, exrs = images.pngs() | images.odd_pngs() | wide_pngs(), images.exrs() | images.odd_exrs()
    return pngs | exrs | jpegs()


def case(name: str, data: bytes, about: str, encoding: str | None = None) -> Case:
    """A scene with a texture."""
    scene = json.dumps(scene_of(name, encoding)).encode()
    return Case({SCENE: scene, name: data}, WORDS, about, True, output=PICTURE)


def texture(seed: int, k: int, known: dict[str, bytes]) -> Case:
    """A texture mutated by its parts, by bytes, or both."""
    rng = Random(f"texture {seed} {k}")
    name = rng.choice(list(known))
    data = known[name]
    if name.endswith(("png", "exr")):
        data = images.mutate(name, data, rng)
    else:
        for _ in range(rng.choice([1, 1, 2])):
            data = mutate_jpeg(data, rng) if rng.random() < 0.5 else mutations.mutate("", data, rng)
    return case(name, data, f"texture {seed} {k}", rng.choice([None, None, "linear", "srgb"]))


def mutate_jpeg(data: bytes, rng: Random) -> bytes:
    """Change a byte behind a marker: sizes, tables, components."""
    found = [k for k in range(2, len(data) - 20) if data[k] == 0xFF and data[k + 1] not in (0, 0xFF)]
    if not found:
        return data
    at = rng.choice(found) + rng.randrange(1, 20)
    return data[:at] + bytes([rng.choice([0, 1, 2, 3, 7, 8, 16, 127, 128, 192, 255])]) + data[at + 1 :]


# A second decoder ---------------------------------------------------------------------------------------------------


def decoded(path: Path, linear: bool) -> np.ndarray:
    """Linear colours (h, w, 3) of a file that was accepted, row 0 at the top."""
    from raytrace.image.files import srgb_decode

    if path.suffix == ".exr":
        return _exr(path)
    if path.suffix == ".png":
        codes = png_codes(path.read_bytes())
    else:
        from PIL import Image

        with Image.open(path) as image:
            codes = np.asarray(image.convert("RGB")) / 255
    return codes if linear else srgb_decode(codes)


def _exr(path: Path) -> np.ndarray:
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        for part in file.parts:
            if {"R", "G", "B"} <= part.channels.keys():
                return np.stack([part.channels[c].pixels.astype(np.float64) for c in "RGB"], axis=2)
    raise AssertionError


def png_codes(data: bytes) -> np.ndarray:
    """Codes of a PNG, 0 to 1, without its alpha: byte by byte, as the standard describes it [PNG]."""
    parts = list(images._chunks(data))
    head = next(body for kind, body in parts if kind == b"IHDR")
    width, height = int.from_bytes(head[:4], "big"), int.from_bytes(head[4:8], "big")
    depth, kind, woven = head[8], head[9], head[12]
    packed = zlib.decompressobj().decompress(b"".join(body for name, body in parts if name == b"IDAT"))
    image, at = np.zeros((height, width, CHANNELS[kind]), np.int64), 0
    for left, top, across, down in PASSES if woven else [(0, 0, 1, 1)]:
        rows, columns = len(range(top, height, down)), len(range(left, width, across))
        if rows and columns:
            values, at = _rows(packed, at, (rows, columns, CHANNELS[kind]), depth)
            image[top::down, left::across] = values
    if kind == 3:
        palette = next(body for name, body in parts if name == b"PLTE")
        return np.array(list(palette)).reshape(-1, 3)[image[:, :, 0]] / 255
    colours = image[:, :, :3] if kind in (2, 6) else image[:, :, :1].repeat(3, axis=2)
    return colours / (2**depth - 1)


def _rows(packed: bytes, at: int, shape: tuple[int, int, int], depth: int) -> tuple[np.ndarray, int]:
    """Numbers of one pass, and where the next one begins."""
    rows, columns, channels = shape
    length, step = (columns * channels * depth + 7) // 8, max(channels * depth // 8, 1)
    before, lines = bytes(length), []
    for _ in range(rows):
        line = bytearray(packed[at + 1 : at + 1 + length])
        for k in range(length):
            a, b = (line[k - step] if k >= step else 0), before[k]
            c = before[k - step] if k >= step else 0
            nearest = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
            line[k] = (line[k] + (0, a, b, (a + b) // 2, nearest)[packed[at]]) % 256
        at, before = at + 1 + length, bytes(line)
        bits = np.unpackbits(np.frombuffer(before, np.uint8))[: columns * channels * depth].reshape(-1, depth)
        lines.append((bits.astype(np.int64) << np.arange(depth)[::-1]).sum(axis=1))
    return np.array(lines).reshape(shape), at


def right(words: list[str]) -> str:
    """Compare an image with its texture, decoded a second time; "": alike; else what differs."""
    import naive_sampling
    from raytrace.image.files import load

    texture = json.loads(Path(words[0]).read_text())["materials"]["a"]["emission"]
    image = decoded(Path(texture["image"]), texture.get("encoding") == "linear")
    found, (height, width) = load(words[words.index("-o") + 1]).rgb, image.shape[:2]
    points = naive_sampling.film_points("independent", 0, 1, (0, 0, *SIZE))[:, :, 0]
    columns = np.floor(points[..., 0] / SIZE[0] * width).astype(int)
    rows = np.floor(points[..., 1] / SIZE[1] * height).astype(int)
    want = np.minimum(image[rows, columns], np.finfo(np.float32).max)
    near = np.isclose(found, want, rtol=1e-5, atol=1e-7).all(axis=2)
    return "" if near.all() else f"{(~near).sum()} of {near.size} pixels are not those of the texture"
