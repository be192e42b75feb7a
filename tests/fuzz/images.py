"""Image files of many kinds, and mutations that know their parts: PNG chunks, NPZ members, EXR attributes."""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Iterator
from random import Random
from typing import Any

import mutations
import numpy as np

CODES = (np.arange(72) * 37 % 256).astype(np.uint8).reshape(4, 6, 3)
SIGNATURE = b"\x89PNG\r\n\x1a\n"
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
DTYPES = ("<f2", ">f4", "<f8", "<f16", "<i4", "|u1", "<c8", "<c16", "|b1", "<U3", "|S4", "|V12", "|O", "<M8[s]", "<m8")
DTYPES += ("[('a','<f4')]", "[('a','<f4',(3,))]", "[('a','|O')]", "<f400", "<U0", "|V0", "f", "", "<f4,<f4", "\\x00")
SHAPES = ("()", "(4,)", "(4, 6)", "(4, 6, 3)", "(6, 4, 3)", "(4, 6, 4)", "(0, 6, 3)", "(-4, 6, 3)", "(4, 6, 3, 1)")
SHAPES += (
    "(2147483648, 6, 3)",
    "(4.0, 6, 3)",
    "(True, 6, 3)",
    "(1" + "0" * 30 + ", 0, 3)",
    "4",
    "None",
    "(4L, 6L, 3L)",
)
VALUES = (
    "1",
    "-1.5",
    "1e400",
    "-1e999",
    "NaN",
    "Infinity",
    "101",
    "true",
    "null",
    '"1"',
    '"',
    "[]",
    "[1]",
    "{}",
    "",
    " ",
)
VALUES += ("9" * 5000, "[" * 5000, "1" * 400, '"\\ud800"', "abc", "\xff", "0x10", "1_0", '{"a": 1}', "-100", "100")
KEYS = ("exposure", "exposure", "seed", "version", "pictures", "a" * 60, "")
COLOURS = {
    b"gAMA": [struct.pack(">I", k) for k in (0, 1, 45455, 45000, 100_000, 2**32 - 1)],
    b"cHRM": [bytes(32), bytes(5), struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)],
    b"cICP": [bytes([1, 13, 0, 1]), bytes([9, 16, 0, 1]), b""],
    b"iCCP": [b"a\0\0" + zlib.compress(b"x" * 200), b"a\0\0", b"a", b"\0" * 40],
    b"sRGB": [b"\0", b"", b"\xff" * 9],
    b"tRNS": [b"\0\0", b"\0\x05", bytes(6), b"\xff\x80", b"", bytes(300)],
    b"acTL": [struct.pack(">II", n, 0) for n in (0, 1, 3, 2**32 - 1)] + [b"", b"\0"],
    b"fcTL": [bytes(26), b""],
    b"fdAT": [bytes(20), b""],
    b"PLTE": [bytes(range(9)), bytes(5), bytes(768), bytes(771), b""],
    b"IDAT": [b"", zlib.compress(b""), zlib.compress(bytes(10_000)), b"\0" * 9],
    b"eXIf": [b"", b"MM\0*\0\0\0\x08", b"II*\0" + b"\xff" * 40],
}
WINDOWS = [(0, 0, 5, 3), (1, 0, 6, 3), (-3, -3, 2, 0), (5, 5, 0, 0), (0, 0, 2**31 - 1, 0), (-(2**31), 0, 2**31 - 1, 3)]


def chunk(kind: bytes, data: bytes) -> bytes:
    """One chunk of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(rows: list[bytes], depth: int, kind: int, *extra: tuple[bytes, bytes], interlaced: int = 0) -> bytes:
    """A PNG of 6 x 4 pixels from rows of bytes."""
    head = struct.pack(">IIBBBBB", 6, 4, depth, kind, 0, 0, interlaced)
    body = zlib.compress(b"".join(b"\0" + row for row in rows))
    parts = [(b"IHDR", head), *extra, (b"IDAT", body), (b"IEND", b"")]
    return SIGNATURE + b"".join(chunk(*part) for part in parts)


def pngs() -> dict[str, bytes]:
    """PNG files that are right."""
    passes = [(0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1)]
    parts = [CODES[top::down, left::across] for top, left, down, across in passes]
    woven = [row.tobytes() for part in parts if part.size for row in part]
    solid = np.dstack([CODES, np.full((4, 6), 255, np.uint8)])
    return {
        "palette.png": png([bytes([0, 1, 2, 0, 1, 2])] * 4, 8, 3, (b"PLTE", bytes(range(9))), (b"tRNS", b"\xff\xff")),
        "interlaced.png": png(woven, 8, 2, interlaced=1),
        "grey4.png": png([b"\x12\x34\x56"] * 4, 4, 0, (b"tRNS", b"\0\x0f")),
        "alpha.png": png([row.tobytes() for row in solid], 8, 6, (b"gAMA", struct.pack(">I", 45455))),
    }


def odd_pngs() -> dict[str, bytes]:
    """PNG files that are refused as they are."""
    rows, wide = [row.tobytes() for row in CODES], [row.astype(">u2").tobytes() for row in CODES]
    return {
        "wide.png": png(wide, 16, 2),
        "animated.png": png(rows, 8, 2, (b"acTL", struct.pack(">II", 2, 0)), (b"fcTL", bytes(26))),
        "keyed.png": png(rows, 8, 2, (b"tRNS", struct.pack(">3H", *CODES[1, 1].tolist()))),
        "clear.png": png([bytes([0, 1, 2, 0, 1, 2])] * 4, 8, 3, (b"PLTE", bytes(range(9))), (b"tRNS", b"\xff\x80")),
        "exposed.png": png(rows, 8, 2, (b"tEXt", b'raytrace:exposure\0"1"')),
    }


def exr(names: str = "RGB", dtype: str = "f4", **header: Any) -> bytes:
    """An EXR of 6 x 4 pixels."""
    import OpenEXR

    plane = (CODES[:, :, 0] / 255).astype(dtype)
    channels = {name: np.ones_like(plane) if name == "A" else plane.copy() for name in names}
    stream = io.BytesIO()
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels) as file:
        file.write(stream)
    return stream.getvalue()


def window(left: int, top: int) -> tuple[Any, Any]:
    """A window of 6 x 4 pixels."""
    return np.array([left, top], np.int32), np.array([left + 5, top + 3], np.int32)


def exrs() -> dict[str, bytes]:
    """EXR files that are right."""
    import OpenEXR

    methods = ("NO", "RLE", "ZIPS", "PIZ", "PXR24", "B44", "DWAA", "HTJ2K32", "ZSTD")
    files = {
        f"{name.lower()}.exr": exr(compression=getattr(OpenEXR, f"{name}_COMPRESSION"))
        for name in methods
        if hasattr(OpenEXR, f"{name}_COMPRESSION")
    }
    files["half.exr"] = exr("RGBA", "f2", dataWindow=window(-3, 7), displayWindow=window(-3, 7))
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 4
    return files | {"tiled.exr": exr(type=OpenEXR.tiledimage, tiles=tiles)}


def odd_exrs() -> dict[str, bytes]:
    """EXR files that are refused as they are."""
    import OpenEXR

    stream = io.BytesIO()
    parts = [OpenEXR.Part({"name": f"p{k}"}, {c: np.ones((4, 6), np.float32) for c in "RGB"}) for k in range(2)]
    with OpenEXR.File(parts) as file:
        file.write(stream)
    return {
        "shifted.exr": exr(dataWindow=window(1, 0), displayWindow=window(0, 0)),
        "whole.exr": exr(dtype="u4"),
        "parts.exr": stream.getvalue(),
    }


def archive(members: dict[str, bytes], method: int) -> bytes:
    """A ZIP file."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        for name, data in members.items():
            file.writestr(zipfile.ZipInfo(name), data, method)  # with a date of its own: the same bytes each time
    return stream.getvalue()


def npy(array: Any) -> bytes:
    """An array file."""
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def npzs() -> dict[str, bytes]:
    """NPZ files that are right."""
    rgb, text = CODES / 255, npy(np.array(json.dumps({"spp": 4})))
    more = {"prim_id.npy": npy(np.arange(24).reshape(4, 6)), "depth.npy": npy(rgb[:, :, 0]), "provenance.npy": text}
    files = {f"{k}.npz": archive({"rgb.npy": npy(rgb), **more}, method) for k, method in enumerate(METHODS)}
    return files | {"turned.npz": archive({"rgb.npy": npy(np.asfortranarray(rgb.astype(">f4")))}, METHODS[1])}


def odd_npzs() -> dict[str, bytes]:
    """NPZ files that are refused as they are."""
    rgb = CODES / 255
    arrays = {
        "structured": rgb.astype([("a", "f4")]),
        "complex": rgb + 1j,
        "number": np.float32(1),
        "object": np.array([{}] * 3, object),
        "huge": rgb * 1e300,
        "codes": CODES,
        "truth": rgb > 0.5,
    }
    return {f"{name}.npz": archive({"rgb.npy": npy(array)}, METHODS[1]) for name, array in arrays.items()}


def right() -> dict[str, bytes]:
    """Files that are right."""
    return pngs() | exrs() | npzs()


def odd() -> dict[str, bytes]:
    """Files that are refused as they are."""
    return odd_pngs() | odd_exrs() | odd_npzs()


def mutate(name: str, data: bytes, rng: Random) -> bytes:
    """A file with its parts mutated, its bytes, or both."""
    how = rng.random()
    if how < 0.7:
        for _ in range(rng.choice([1, 1, 2, 3])):
            data = {".png": mutate_png, ".npz": mutate_npz, ".exr": mutate_exr}[name[-4:]](data, rng)
    return mutations.mutate(name, data, rng) if how > 0.6 else data


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 8
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        at += 12 + length


def mutate_png(data: bytes, rng: Random) -> bytes:
    """Mutate the chunks of a PNG; checksums stay right."""
    parts = list(_chunks(data)) or [(b"IHDR", bytes(13))]
    k = rng.randrange(len(parts))
    match rng.randrange(7):
        case 0:
            kind = rng.choice(list(COLOURS))
            parts.insert(k + 1, (kind, rng.choice(COLOURS[kind])))
        case 1 | 2:
            key, value = rng.choice(KEYS).encode(), rng.choice(VALUES).encode("utf-8")
            text = rng.choice(
                [
                    (b"tEXt", b"raytrace:" + key + b"\0" + value),
                    (b"zTXt", b"raytrace:" + key + b"\0\0" + zlib.compress(value)),
                    (b"iTXt", b"raytrace:" + key + b"\0\0\0\0\0" + value),
                    (b"iTXt", b"raytrace:" + key + b"\0\1\0\0\0" + zlib.compress(value)),
                ]
            )
            parts.insert(rng.randrange(1, len(parts) + 1), text)
        case 3:
            head = bytearray(parts[0][1].ljust(13, b"\0"))
            head[rng.randrange(8, 13)] = rng.choice([0, 1, 2, 3, 4, 6, 8, 16, 255])
            parts[0] = parts[0][0], bytes(head)
        case 4:
            parts.insert(rng.randrange(len(parts) + 1), parts.pop(k))
        case 5:
            parts.insert(k, parts[rng.randrange(len(parts))])
        case _:
            parts[k] = parts[k][0], mutations.mutate("", parts[k][1], rng)
    return SIGNATURE + b"".join(chunk(*part) for part in parts)


def mutate_npz(data: bytes, rng: Random) -> bytes:
    """Mutate the members of an NPZ; the archive stays right."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            members = {name: file.read(name) for name in file.namelist()}
    except Exception:  # noqa: BLE001  (it was mutated before)
        return mutations.mutate("", data, rng)
    name = rng.choice(list(members))
    match rng.randrange(5):
        case 0:
            members[name] = mutations.mutate("", members[name], rng)
        case 1 | 2:
            length = int.from_bytes(members[name][8:10], "little")
            text = members[name][10 : 10 + length].decode("latin-1")
            dtype, shape = rng.choice(DTYPES), rng.choice(SHAPES)
            descr = dtype if dtype.startswith("[") else repr(dtype)
            fresh = f"{{'descr': {descr}, 'fortran_order': {rng.choice(['False', 'True', '2'])}, 'shape': {shape}, }}\n"
            both = rng.choice([fresh, text.replace("(4, 6", shape[:-1]), text.replace("<f", rng.choice("<>|") + "i")])
            head = both.encode("latin-1")
            members[name] = members[name][:8] + struct.pack("<H", len(head)) + head + members[name][10 + length :]
        case 3:
            members["provenance.npy"] = npy(np.array(rng.choice(VALUES)))
        case _:
            members[rng.choice(["stderr.npy", "samples.npy", "normal.npy", "rgb", "../rgb.npy"])] = members[name]
    return archive(members, rng.choice(METHODS))


def mutate_exr(data: bytes, rng: Random) -> bytes:
    """Mutate the attributes of an EXR."""
    names = (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0")
    match rng.randrange(4):
        case 0:
            name = rng.choice(names)
            at = data.find(name)
            if at >= 0:
                at += len(name) + 4
                data = data[:at] + struct.pack("<4i", *rng.choice(WINDOWS)) + data[at + 16 :]
        case 1 | 2:
            value = rng.choice(VALUES).encode("latin-1", "replace")
            kind = rng.choice([b"string", b"int", b"float", b"stringvector", b"chromaticities", b"box2i", b"opaque"])
            key = b"raytrace:" + rng.choice(KEYS).encode() if rng.random() < 0.6 else b"chromaticities"
            fresh = key + b"\0" + kind + b"\0" + struct.pack("<I", len(value)) + value
            data = data[:8] + fresh + data[8:]
        case _:
            found = [k for k in range(len(data) - 4) if data[k : k + 2] in (b"R\0", b"G\0", b"B\0", b"A\0")]
            if found:
                at = rng.choice(found)
                data = data[:at] + rng.choice([b"A", b"R", b"Y", b"\xff"]) + data[at + 1 :]
                at += 2 + rng.choice([0, 8, 12])
                data = data[:at] + struct.pack("<I", rng.choice([0, 1, 2, 3, 2**31])) + data[at + 4 :]
    return data
