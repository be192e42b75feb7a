"""Images of textures: what is decoded, to which numbers, and what is refused in one line."""

import io
import struct
import zlib
from decimal import Decimal, localcontext

import images
import numpy as np
import pytest
from PIL import Image

import raytrace as rt
import texture_twins as twins
from raytrace.image.files import srgb_decode
from raytrace.image.texels import IGNORED, decode_texels, srgb_table, suffix_of_content
from raytrace.limits import MAX_TEXELS
from raytrace.scene import textures as scene_textures

RNG = np.random.default_rng(3)


def decode(data: bytes, suffix: str, srgb: bool = True):
    return decode_texels(data, suffix, srgb, f"a{suffix}")


def filtered(codes: np.ndarray, filters: list[int]) -> bytes:
    """A PNG of 16 bits whose rows have these filters in turn [PNG, 9]."""
    height, _, channels = codes.shape
    rows, step = codes.astype(">u2").reshape(height, -1).view(np.uint8).astype(int), 2 * channels
    packed, before = b"", np.zeros(rows.shape[1], int)
    for k, row in enumerate(rows):
        a = np.concatenate([np.zeros(step, int), row[:-step]])
        b, c = before, np.concatenate([np.zeros(step, int), before[:-step]])
        far = abs(b - c), abs(a - c), abs(a + b - 2 * c)
        paeth = np.where((far[0] <= far[1]) & (far[0] <= far[2]), a, np.where(far[1] <= far[2], b, c))
        kind = filters[k % len(filters)]
        packed += bytes([kind]) + ((row - (0 * a, a, b, (a + b) // 2, paeth)[kind]) % 256).astype(np.uint8).tobytes()
        before = row
    plain = images.chunk(b"IDAT", zlib.compress(packed))
    parts = twins.png16(codes)
    head = parts[: parts.index(b"IDAT") - 4]
    return head + plain + images.chunk(b"IEND", b"")


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_all_16_bits_of_a_png_are_read(channels):
    codes = RNG.integers(0, 65536, (10, 7, channels), np.uint16)
    if channels in (2, 4):
        codes[..., -1] = 65535
    want = codes[..., :3] if channels > 2 else codes[..., :1].repeat(3, axis=2)
    for data in (twins.png16(codes), filtered(codes, [0, 1, 2, 3, 4]), filtered(codes, [4, 3])):
        found = decode(data, ".png")
        assert found.codes.dtype == np.uint16
        np.testing.assert_array_equal(found.codes, want)
        assert found.warning == ""


def test_pngs_of_few_bits_are_read_as_8():
    found = {name: decode(data, ".png") for name, data in images.pngs().items()}
    np.testing.assert_array_equal(found["interlaced.png"].codes, images.CODES)
    np.testing.assert_array_equal(found["grey4.png"].codes[0, :, 0], [17, 34, 51, 68, 85, 102])
    np.testing.assert_array_equal(found["palette.png"].codes[0, 1], [3, 4, 5])


def test_alpha_is_ignored_with_a_warning():
    codes = RNG.integers(0, 256, (3, 4, 4), np.uint8)
    stream = io.BytesIO()
    Image.fromarray(codes).save(stream, "PNG")
    assert decode(stream.getvalue(), ".png").warning == IGNORED
    np.testing.assert_array_equal(decode(stream.getvalue(), ".png").codes, codes[..., :3])
    odd = images.odd_pngs()
    assert decode(odd["keyed.png"], ".png").warning == IGNORED
    assert decode(odd["clear.png"], ".png").warning == IGNORED
    wide = RNG.integers(0, 65536, (3, 4, 3), np.uint16)
    plain = twins.png16(wide)
    at = plain.index(b"IDAT") - 4
    keyed = plain[:at] + images.chunk(b"tRNS", wide[1, 1].astype(">u2").tobytes()) + plain[at:]
    assert decode(keyed, ".png").warning == IGNORED
    assert decode(plain, ".png").warning == ""
    assert decode(images.exr("RGBA"), ".exr").warning == ""


def test_jpeg_and_exr():
    stream = io.BytesIO()
    Image.fromarray(images.CODES).save(stream, "JPEG", quality=100, subsampling=0)
    codes = decode(stream.getvalue(), ".jpg").codes
    with Image.open(stream) as image:
        np.testing.assert_array_equal(codes, np.asarray(image))
    rgb = RNG.uniform(0, 1, (4, 5, 3))
    for dtype in (np.float16, np.float32):
        found = decode(twins.exr(rgb, dtype), ".exr").codes
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, rgb.astype(dtype))


@pytest.mark.parametrize("bits", [8, 16])
def test_the_table_of_srgb_is_its_formula(bits):
    table = srgb_table(bits)
    assert table[0] == 0
    assert table[-1] == 1
    np.testing.assert_allclose(table, srgb_decode(np.arange(2**bits) / (2**bits - 1)), rtol=1e-15)
    with localcontext() as context:
        context.prec = 40
        for code in (0, 1, 2 ** (bits - 1), 2**bits - 2, 37):
            x = Decimal(code) / (2**bits - 1)
            low = x <= Decimal("0.04045")
            exact = x / Decimal("12.92") if low else ((x + Decimal("0.055")) / Decimal("1.055")) ** Decimal("2.4")
            assert abs(table[code] - float(exact)) <= 2e-16


@pytest.mark.parametrize("order", ["<", ">"])
def test_an_orientation_is_told_and_broken_exif_is_not(order):
    def warning(exif):
        stream = io.BytesIO()
        Image.fromarray(images.CODES).save(stream, "JPEG", exif=b"Exif\0\0" + exif)
        return decode(stream.getvalue(), ".jpg").warning

    head = {"<": b"II*\0", ">": b"MM\0*"}[order] + struct.pack(order + "IH", 8, 2)
    first, turned = struct.pack(order + "HHIHH", 0x0100, 3, 1, 7, 0), struct.pack(order + "HHIHH", 0x0112, 3, 1, 6, 0)
    assert warning(head + first + turned) == "its orientation (EXIF) is ignored"
    assert warning(head + first + turned.replace(b"\6", b"\1")) == ""
    for broken in (b"", b"II", head[:9], head + first, head + first + turned[:8], b"MM\0*\xff\xff\xff\xff"):
        assert warning(broken) == ""


def test_the_content_says_its_format():
    assert suffix_of_content(images.exr()) == ".exr"
    assert suffix_of_content(twins.png16(np.zeros((1, 1, 3)))) == ".png"
    assert suffix_of_content(b"GIF89a") == ""


def jpeg_of(width: int, height: int) -> bytes:
    """A JPEG whose header lies about its size."""
    stream = io.BytesIO()
    Image.fromarray(images.CODES).save(stream, "JPEG")
    data = bytearray(stream.getvalue())
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", height, width)
    return bytes(data)


def ink() -> bytes:
    stream = io.BytesIO()
    Image.new("CMYK", (4, 4)).save(stream, "JPEG")
    return stream.getvalue()


LINEAR_PNG = images.png([bytes(18)] * 4, 8, 2, (b"gAMA", struct.pack(">I", 100_000)))
SCANS = jpeg_of(6, 4)[:-2] + b"\xff\xda\0\0" * 101
HUGE = struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 8, 2, 0, 0, 0)
WRONG = [
    (".png", b"hello", "not a valid PNG image: it does not begin with the PNG signature"),
    (
        ".png",
        images.SIGNATURE + images.chunk(b"IHDR", HUGE) + images.chunk(b"IEND", b""),
        "pixels; at most 268,435,456",
    ),
    (".png", twins.png16(np.zeros((4, 4, 3)))[:-30], "not a valid PNG image: it is truncated"),
    (".png", images.odd_pngs()["animated.png"], "an animation of 2 images"),
    (".png", LINEAR_PNG, 'its gamma is 1, that of sRGB 0.45455; convert it to sRGB, or set "encoding": "linear"'),
    (".jpg", b"hello", "not a valid JPEG image: "),
    (".jpg", jpeg_of(65500, 65500), "it has 4,290,250,000 pixels; at most 268,435,456"),
    (".jpg", jpeg_of(2000, 2000), "not a valid JPEG image: it is truncated"),
    (".jpg", jpeg_of(6, 4)[:-20], "not a valid JPEG image: "),
    (".jpg", SCANS, "more than 100 scans"),
    (".jpg", ink(), "its colours are CMYK; convert it to RGB"),
    (".exr", b"hello", "not a valid EXR image: its header is broken or truncated"),
    (".exr", images.exr("Y"), "no colour: an EXR has channels R, G and B"),
    (".exr", images.odd_exrs()["shifted.exr"], "is not its display window"),
]


@pytest.mark.parametrize(("suffix", "data", "words"), WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_is_told_in_one_line(suffix, data, words):
    with pytest.raises(rt.SceneError) as caught:
        decode(data, suffix)
    assert words in str(caught.value)
    assert str(caught.value).startswith(f"a{suffix}: ")
    assert "\n" not in str(caught.value)


def test_linear_numbers_may_have_any_gamma():
    assert decode(LINEAR_PNG, ".png", srgb=False).codes.shape == (4, 6, 3)


# In scenes ------------------------------------------------------------------------------------------------------------


def load(folder, texture, key="albedo", **more):
    material = {"type": "diffuse", "albedo": [0, 0, 0]} | {key: texture}
    return rt.load(twins.head_on((4, 4), material) | more, root=folder)


def test_values_out_of_range_are_counted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rgb = np.full((4, 4, 3), 0.5)
    rgb[0, 1, 0], rgb[2, 2, 1] = 1.75, -1
    (tmp_path / "a.exr").write_bytes(twins.exr(rgb))
    with pytest.raises(
        rt.SceneError, match=r"materials\.a\.albedo\.image: a\.exr: 2 of 16 texels are outside 0 to 1; the"
    ):
        load(tmp_path, {"image": "a.exr"})
    with pytest.raises(rt.SceneError, match=r"1 of 16 texels are negative or not finite; the values are -1 to 1\.75"):
        load(tmp_path, {"image": "a.exr"}, "emission")
    rgb[0, 1, 0] = np.nan
    (tmp_path / "a.exr").write_bytes(twins.exr(rgb))
    with pytest.raises(rt.SceneError, match=r"2 of 16 texels .*; the values without NaN are -1 to 0\.5"):
        load(tmp_path, {"image": "a.exr"}, "emission")
    rgb[:] = np.nan
    (tmp_path / "a.exr").write_bytes(twins.exr(rgb))
    with pytest.raises(rt.SceneError, match="16 of 16 texels are negative or not finite, all NaN"):
        load(tmp_path, {"image": "a.exr"}, "emission")
    rgb[:] = np.inf
    (tmp_path / "a.exr").write_bytes(twins.exr(rgb))
    with pytest.raises(rt.SceneError, match="16 of 16 texels are negative or not finite"):
        load(tmp_path, {"image": "a.exr"}, "emission")


PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
PLY += "property float red\nproperty float green\nproperty float blue\nelement face 1\n"
PLY += "property list uchar int vertex_indices\nend_header\n0 0 0 0 2 0\n1 0 0 0.5 0.5 0.5\n0 1 0 1 1 1\n3 0 1 2\n"


def test_vertex_colours_out_of_range_are_counted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.ply").write_text(PLY)
    objects = [{"mesh": "a.ply", "material": "a"}]
    with pytest.raises(rt.SceneError, match=r"albedo: vertex colours: 1 of 3 corners of triangles are outside 0 to 1"):
        load(tmp_path, {"attribute": "color"}, objects=objects)
    lamp = load(tmp_path, {"attribute": "color"}, "emission", objects=objects)
    np.testing.assert_allclose(lamp.materials.emission, [[0.5, 3.5 / 3, 0.5]])


def test_all_problems_of_textures_are_reported_together(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.txt").write_text("hello")
    (tmp_path / "bad.png").write_text("hello")
    names = ["no.png", "../a.png", "a.txt", "bad.png", "http://a/b.png", "no.png"]
    scene = twins.head_on((4, 4), {"type": "diffuse", "albedo": {"image": "no.png"}})
    for k, name in enumerate(names):
        scene["materials"][f"m{k}"] = {"type": "diffuse", "albedo": {"image": name}}
        scene["objects"].append({"rectangle": {}, "material": f"m{k}"})
    with pytest.raises(rt.SceneError) as caught:
        rt.load(scene)
    text = str(caught.value)
    for words in (
        "materials.a.albedo.image: no.png: no such file",
        "../a.png: outside the scene's folder",
        "a.txt: not a known format of textures (known: .png, .jpg, .jpeg, .exr)",
        "bad.png: not a valid PNG image",
        "a URI; name a file",
    ):
        assert words in text


def test_keys_that_do_not_go_together():
    for texture, words in (
        ({"image": "a.exr", "encoding": "srgb"}, 'encoding: the values of an EXR are linear; remove "encoding"'),
        ({"checkerboard": [[0, 0, 0], [0, 1.5, 0]]}, r"checkerboard\[1\]\[1\]: expected a number <= 1, got 1\.5"),
        ({"checkerboard": [[0, 0, 0]] * 2, "filter": "nearest"}, '"checkerboard" and "filter" exclude each other'),
        ({"attribute": "color", "scale": [1, 1]}, '"attribute" and "scale" exclude each other'),
        ({}, 'missing key "image", or one of checkerboard, attribute instead'),
        ("wood.png", "expected a list of 3 numbers or an object"),
    ):
        with pytest.raises(rt.SceneError, match=words):
            load(None, texture)


def test_memory_and_the_number_of_texels_are_limited(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    twins.save_png(tmp_path / "a.png", np.zeros((100, 100, 3), np.uint8))
    scene = twins.head_on((4, 4), {"type": "diffuse", "albedo": {"image": "a.png"}})
    with pytest.raises(rt.FileError, match=r"memory: .*a\.png"):
        rt.load(scene, max_memory=1)
    monkeypatch.setattr(scene_textures, "MAX_TEXELS", 9999)
    with pytest.raises(rt.SceneError, match=r"with this image the textures have 10,000 texels; at most 9,999"):
        rt.load(scene)
    assert MAX_TEXELS * 3 < 2**31  # indices of kernels
