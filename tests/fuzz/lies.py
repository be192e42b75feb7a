"""Files that announce what they do not hold, or unfold to what no machine holds; each is small."""

import gzip
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Iterator
from functools import cache
from typing import Any

import cases
import numpy as np
import seeds
from mill import DIFFERENT, DONE, FILE, Case

MANY = [2_000_000_000, 2**31 - 1, 2**32, 2**63, 10**30]
PLY = "ply\nformat {order} 1.0\nelement vertex {vertices}\n{vertex}element face {faces}\n{face}end_header\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"
CORNERS = "property list {} int vertex_indices\n"


@cache
def gigabytes(byte: bytes, begin: bytes = b"", many: int = 3) -> bytes:
    """So many GiB of one byte in a few MB of gzip: members may follow each other."""
    member = gzip.compress(byte * 2**28, 9, mtime=0)
    return gzip.compress(begin, mtime=0) + member * (4 * many)


def plys() -> Iterator[tuple[str, bytes]]:
    """PLY files."""
    for order in ("ascii", "binary_little_endian", "binary_big_endian"):

        def head(
            order: str = order, vertices: int = 3, faces: int = 1, length: str = "uint", vertex: str = XYZ
        ) -> bytes:
            face = CORNERS.format(length)
            return PLY.format(order=order, vertices=vertices, faces=faces, vertex=vertex, face=face).encode()

        end = ">" if "big" in order else "<"

        def numbers(kind: str, *values: float, order: str = order, end: str = end) -> bytes:
            if order == "ascii":
                return (" ".join(map(str, values)) + "\n").encode()
            return np.array(values, end + kind).tobytes()

        corners = numbers("f4", 0, 0, 0, 1, 0, 0, 0, 1, 0)
        triangle = numbers("u4", 3) + numbers("i4", 0, 1, 2)
        for many in MANY:
            yield "vertices", head(vertices=many) + corners + triangle
            yield "faces", head(faces=many) + corners + triangle
            yield "both", head(vertices=many, faces=many)
            yield "no properties", head(vertices=many, vertex="") + triangle
            yield (
                "another element",
                head().replace(b"element face", f"element other {many}\nelement face".encode()) + corners,
            )
        for many in (10**6, 2**31, 2**32 - 1):
            yield "sides", head() + corners + numbers("u4", many) + numbers("i4", 0, 1, 2)
        yield "negative sides", head(length="int") + corners + numbers("i4", -1) + numbers("i4", 0, 1, 2)
        yield "far corners", head() + corners + numbers("u4", 3) + numbers("i4", 0, 1, 2**31 - 1)
        yield "empty lists", head(faces=1000) + corners + numbers("u4", *[0] * 1000)
    yield "many elements", b"ply\nformat ascii 1.0\n" + b"element a 1\nproperty char b\n" * 30_000 + b"end_header\n"
    yield "a header without an end", b"ply\nformat ascii 1.0\n" + b"comment\n" * 10**6


def million_sides() -> dict[str, bytes]:
    """Faces of 10^6 sides, which are right: half of a disc each."""
    angle = np.linspace(0, np.pi, 10**6)
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    rows = "".join(f"v {x:.7f} {y:.7f} 0\n" for x, y, _ in points.tolist())
    head = PLY.format(order="binary_little_endian", vertices=10**6, faces=1, vertex=XYZ, face=CORNERS.format("uint"))
    body = points.astype("<f4").tobytes() + struct.pack("<I", 10**6) + np.arange(10**6, dtype="<i4").tobytes()
    return {
        "a.obj": (rows + "f " + " ".join(map(str, range(1, 10**6 + 1))) + "\n").encode(),
        "a.ply": head.encode() + body,
    }


def glbs() -> Iterator[tuple[str, bytes]]:
    """GLB files."""
    right = cases.MESHES["a.glb"]
    for at in (8, 12):  # length of the file, of the JSON
        for value in (0, 1, 2**31, 2**32 - 1):
            yield f"length at {at}", right[:at] + struct.pack("<I", value) + right[at + 4 :]
    for key, value in [("count", n) for n in (*MANY, 10**400, -1)] + [("byteOffset", 2**62), ("componentType", 5125)]:
        content = seeds.document()
        content["accessors"][0][key] = value
        yield f"accessor {key}", seeds.glb(content, bytes(132))
    for key in ("byteLength", "byteOffset", "byteStride"):
        for value in (0, 1, *MANY):
            content = seeds.document()
            content["bufferViews"][0][key] = value
            yield f"view {key}", seeds.glb(content, bytes(132))
    for uri in ("file:///etc/passwd", "http://localhost/a.bin", "data:;base64," + "A" * 10**6, "data:,%", "data:"):
        yield "uri", seeds.glb(seeds.document(uri), b"")
    content = seeds.document()
    content["nodes"][2]["children"] = [0]
    yield "a ring of nodes", seeds.glb(content, bytes(132))
    content["nodes"] = [{"mesh": 1, "children": [k + 1]} for k in range(10_000)] + [{}]
    yield "a long chain of nodes", seeds.glb(content, bytes(132))
    content["nodes"] = [{"children": [1] * 100_000}, {"mesh": 0}]
    yield "a node with many equal children", seeds.glb(content, bytes(132))
    content = seeds.document()
    content["meshes"] = [{"primitives": content["meshes"][0]["primitives"] * 10_000}]
    content["nodes"] = [{"children": list(range(1, 1001))}] + [{"mesh": 0}] * 1000
    yield "ten million parts of a mesh", seeds.glb(content, bytes(132))
    text = b"[" * 100_000
    yield "nested JSON", struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text


def stls() -> Iterator[tuple[str, bytes]]:
    """STL files."""
    for many in MANY[:3]:
        yield "triangles", bytes(80) + struct.pack("<I", many % 2**32) + bytes(50)
        yield "triangles after solid", b"solid".ljust(80) + struct.pack("<I", many % 2**32) + bytes(50)


def meshes() -> Iterator[Case]:
    """Scenes of meshes that lie."""
    files = [("a.ply", *each) for each in plys()] + [("a.glb", *each) for each in glbs()]
    files += [("a.stl", *each) for each in stls()]
    files += [(name, "a million sides", data) for name, data in million_sides().items()]
    files += [("a.obj", "a number of a million digits", b"v 0." + b"3" * 10**6 + b" 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")]
    files += [("a.obj", "an index of a million digits", b"v 0 0 0\n" * 3 + b"f 1 2 " + b"3" * 10**6 + b"\n")]
    files += [("a.obj", "a million slashes", b"v 0 0 0\n" * 3 + b"f 1 2 3" + b"/" * 10**6 + b"\n")]
    files += [("a.obj", "continued a million times", b"v 0 0 0\n" * 3 + b"f 1 2 3 \\\n" + b"\\\n" * 10**6)]
    files += [("a.obj.gz", "unfolds to gigabytes", gigabytes(b"#")), ("a.obj.gz", "of lines", gigabytes(b"\n"))]
    head = PLY.format(order="binary_little_endian", vertices=2**27, faces=1, vertex=XYZ, face=CORNERS.format("uint"))
    files += [("a.ply.gz", "unfolds to vertices", gigabytes(b"\0", head.encode()))]
    for name, about, data in files:
        yield scene(name, data, f"{name}: {about}")._replace(unfolds=name.endswith(".gz"))


def scene(name: str, data: bytes, about: str) -> Case:
    """A scene of one mesh."""
    content = {"scene.json": json.dumps(cases.scene_of(name)).encode(), name: data}
    return Case(content, ["scene.json", "-o", cases.PICTURE, *cases.SIZE], about, output=cases.PICTURE)


def scenes() -> Iterator[Case]:
    """Scenes that go on and on."""
    whole = json.dumps(cases.WHOLE)
    digits, keys = "3" * 10**6, "".join(f'"k{k}": 0, ' for k in range(10**5))
    texts = {
        "nested lists": "[" * 10**5,
        "nested objects": '{"a":' * 10**5,
        "nested and closed": "[" * 10**5 + "]" * 10**5,
        "nested in a key": whole.replace('"film": {', '"film": {"a": ' + "[" * 10**5 + "]" * 10**5 + ", "),
        "digits before the point": whole.replace("0.25", digits),
        "digits after the point": whole.replace("0.25", "0." + digits),
        "digits of an exponent": whole.replace("0.25", "1e" + digits),
        "digits of a whole number": whole.replace('"seed": 7', f'"seed": {digits}'),
        "a long name": whole.replace("a.obj", "a" * 10**6 + ".obj"),
        "a long key": whole.replace('"film"', f'"{"f" * 10**6}"'),
        "a hundred thousand keys": whole.replace('"film": {', '"film": {' + keys),
        "ten thousand objects": json.dumps(cases.WHOLE | {"objects": [cases.WHOLE["objects"][0]] * 10**4}),
        "a hundred thousand materials": json.dumps(
            cases.WHOLE | {"materials": {f"m{k}": cases.WHOLE["materials"]["white"] for k in range(10**5)}}
        ),
        "blanks": whole + " " * (2**24 - len(whole)),
        "too many blanks": whole + " " * 2**24,
        "a hundred thousand half characters": json.dumps(cases.WHOLE | {"about": "\ud800" * 10**5}),
    }
    for about, text in texts.items():
        yield cases.scene_text(text.encode(), about)._replace(judge=False)
    large = json.dumps(cases.WHOLE | {"film": {"size": [16384, 16384]}}).encode()
    words = ["scene.json", "-o", cases.PICTURE, "--spp", "1", "--quiet"]
    yield cases.scene_text(large, "a large film")._replace(words=words, judge=False, codes=(2,))


def npy(shape: tuple[int, ...], dtype: str = "<f4", data: bytes = b"") -> bytes:
    """An array file whose header may lie."""
    text = repr({"descr": dtype, "fortran_order": False, "shape": shape}).encode() + b"\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text + data


def archive(**members: bytes) -> bytes:
    """An NPZ file of these members."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(f"{name}.npy", data)
    return stream.getvalue()


def png(width: int, height: int, rows: bytes, *chunks: tuple[bytes, bytes]) -> bytes:
    """A PNG file that may lie."""
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = [(b"IHDR", head), *chunks, (b"IDAT", rows), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    )


@cache
def zeros() -> bytes:
    """256 MiB of zeros, as zlib writes them."""
    return zlib.compress(bytes(2**28), 9)


def exr(name: bytes, value: bytes) -> bytes:
    """An EXR file with another attribute of the same size."""
    right = seeds.pictures()["a.exr"]
    at = right.index(name) + len(name)
    at = right.index(b"\0", at + 1) + 5  # after the type, and the size
    return right[:at] + value + right[at + len(value) :]


def pictures() -> Iterator[Case]:
    """Pictures that lie, or unfold to gigabytes."""
    right = seeds.pictures()
    huge, one = 2**31 - 1, npy((1, 1, 3), "<f4", bytes(12))
    files: list[tuple[str, str, Any]] = [
        ("png", "huge", png(huge, huge, zlib.compress(b"\0"))),
        ("png", "as large as is allowed", png(16384, 16384, zeros())),
        ("png", "a hundred million pixels", png(10_000, 10_000, zeros()[:1000])),
        ("png", "more rows than it has", png(6, 4, zeros())),
        ("png", "a text that unfolds", png(6, 4, zlib.compress(bytes(76)), (b"zTXt", b"raytrace:a\0\0" + zeros()))),
        ("png", "a profile that unfolds", png(6, 4, zlib.compress(bytes(76)), (b"iCCP", b"a\0\0" + zeros()))),
        ("png", "many texts", png(6, 4, zlib.compress(bytes(76)), *[(b"tEXt", b"a%d\0b" % k) for k in range(10**5)])),
        ("npz", "announces much", archive(rgb=npy((10**6, 10**6, 3)))),
        ("npz", "announces more", archive(rgb=npy((2**62, 2**62, 3)))),
        ("npz", "announces less than nothing", archive(rgb=npy((-1, 4, 3)))),
        ("npz", "objects", archive(rgb=npy((4, 6, 3), "|O", b"cos\nsystem\n(S'true'\ntR." * 9))),
        ("npz", "nested header", archive(rgb=b"\x93NUMPY\1\0" + struct.pack("<H", 9000) + b"(" * 9000)),
        ("npz", "unfolds", archive(rgb=npy((2**13, 2**13, 3), "<f4", bytes(3 * 2**28)))),
        ("npz", "a text that unfolds", archive(rgb=one, provenance=npy((), f"<U{2**26}", bytes(2**28)))),
        ("exr", "huge", exr(b"dataWindow", struct.pack("<4i", 0, 0, huge - 1, huge - 1))),
        ("exr", "large", exr(b"dataWindow", struct.pack("<4i", 0, 0, 99_999, 99_999))),
        ("exr", "as large as is allowed", exr(b"dataWindow", struct.pack("<4i", 0, 0, 16383, 16383))),
        ("exr", "inside out", exr(b"dataWindow", struct.pack("<4i", 5, 5, 0, 0))),
        ("exr", "negative", exr(b"dataWindow", struct.pack("<4i", -huge, -huge, huge, huge))),
    ]  # fmt: skip
    for kind, about, data in files:
        names = {f"wrong.{kind}": data, f"right.{kind}": right[f"a.{kind}"]}
        yield Case(names, ["compare", *names], f"{kind}: {about}", codes=(DONE, FILE, DIFFERENT), unfolds=True)


def everything() -> list[Case]:
    """All of them."""
    return [*scenes(), *meshes(), *pictures()]
