"""What may be handed to a golden, and what its numbers are taken to mean."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image, ImageCms

import raytrace as rt
from raytrace.golden.pixels import to_light
from raytrace.image import files
from small_scenes import studio

RGB = np.random.default_rng(1).uniform(size=(6, 5, 3))
CODES = np.random.default_rng(2).integers(0, 256, (6, 5, 3), np.uint8)


def test_a_render_is_its_light():
    picture = rt.render(studio(), spp=1)
    np.testing.assert_array_equal(to_light(picture), picture.rgb)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_floats_are_linear_light_unless_told_otherwise(dtype):
    np.testing.assert_array_equal(to_light(RGB.astype(dtype)), RGB.astype(dtype))
    np.testing.assert_array_equal(to_light(RGB.astype(dtype), "srgb"), files.srgb_decode(RGB.astype(dtype)))


def test_bytes_are_srgb_codes_unless_told_otherwise():
    np.testing.assert_array_equal(to_light(CODES), files.srgb_decode(CODES / 255))
    np.testing.assert_array_equal(to_light(CODES, "linear"), CODES / 255)


def test_a_picture_of_pillow_is_an_array():
    np.testing.assert_array_equal(to_light(Image.fromarray(CODES)), to_light(CODES))


@pytest.mark.parametrize("ending", ["png", "exr", "npz"])
def test_a_file_says_itself_what_it_holds(tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    files.save(path, RGB)
    np.testing.assert_array_equal(to_light(path), files.load(path).rgb)
    np.testing.assert_array_equal(to_light(str(path)), files.load(path).rgb)
    with pytest.raises(ValueError, match="omit the argument"):
        to_light(path, "srgb")


def test_grey_and_opaque_pictures_have_three_channels():
    for grey in (RGB[:, :, 0], RGB[:, :, :1]):
        np.testing.assert_array_equal(to_light(grey), np.repeat(RGB[:, :, :1], 3, axis=2))
    np.testing.assert_array_equal(to_light(np.dstack([RGB, np.ones((6, 5))])), RGB)
    np.testing.assert_array_equal(to_light(np.dstack([CODES, np.full((6, 5), 255, np.uint8)])), to_light(CODES))


def test_an_alpha_below_one_is_refused(tmp_path):
    with pytest.raises(ValueError, match="alpha below 1"):
        to_light(np.dstack([RGB, np.full((6, 5), 0.5)]))
    Image.fromarray(np.dstack([CODES, np.full((6, 5), 254, np.uint8)])).save(tmp_path / "a.png")
    with pytest.raises(rt.FileError, match=r"a\.png: has an alpha below 1"):
        to_light(tmp_path / "a.png")
    Image.fromarray(np.dstack([CODES, np.full((6, 5), 255, np.uint8)])).save(tmp_path / "b.png")
    np.testing.assert_allclose(to_light(tmp_path / "b.png"), to_light(CODES), rtol=1e-7)


@pytest.mark.parametrize(
    ("picture", "encoding", "words"),
    [
        (CODES.astype(np.int64), None, "expected floats or uint8, got int64"),
        (RGB[0, 0], None, r"expected shape \(height, width, 3\), got \(3,\)"),
        (RGB[:, :, :2], None, "expected shape"),
        (RGB[:0], None, "expected shape"),
        ("a picture", None, "unknown image format"),
        (RGB, "gamma", "expected 'linear' or 'srgb', got 'gamma'"),
        (None, None, "expected floats or uint8, got object"),
    ],
)
def test_what_is_no_picture_is_told(picture, encoding, words):
    with pytest.raises((ValueError, rt.FileError), match=words):
        to_light(picture, encoding)


PILLOW = Image.fromarray(CODES)
TOLERANCE = {"YCbCr": 3, "HSV": 6, "LAB": 20, "La": 1}  # codes that are lost on the way there and back


def made(mode):
    """A picture of Pillow in a mode, and the codes of its colours."""
    if mode in ("1", "L", "LA", "La"):
        grey = PILLOW.convert("1" if mode == "1" else "L")
        picture = grey.convert("LA").convert("La") if mode == "La" else grey.convert(mode)
        return picture, np.asarray(grey.convert("RGB"))
    if mode in ("P", "PA"):
        picture = PILLOW.quantize(5)
        return picture.convert(mode), np.asarray(picture.convert("RGB"))
    if mode == "LAB":
        srgb, lab = ImageCms.createProfile("sRGB"), ImageCms.createProfile("LAB")
        return ImageCms.profileToProfile(PILLOW, srgb, lab, outputMode="LAB"), CODES
    if mode == "RGBa":
        return PILLOW.convert("RGBA").convert("RGBa"), CODES
    return PILLOW.convert(mode), CODES


MODES = ["1", "L", "LA", "La", "P", "PA", "RGB", "RGBA", "RGBX", "RGBa", "CMYK", "YCbCr", "HSV", "LAB"]


@pytest.mark.parametrize("mode", MODES)
def test_a_picture_of_pillow_is_its_colours_in_any_mode(mode):
    picture, codes = made(mode)
    assert picture.mode == mode
    off = np.abs(files.srgb8(to_light(picture)).astype(int) - codes)
    assert off.max() <= TOLERANCE.get(mode, 0)
    assert off.mean() <= 3
    assert to_light(picture).shape == (6, 5, 3)


def test_pictures_of_other_palettes_are_other_pictures():
    def square(colour, fill=1):
        picture = Image.new("P", (32, 32))
        picture.putpalette([0, 0, 0, *colour])
        picture.paste(fill, (8, 8, 24, 24))
        return picture

    red, green = to_light(square((255, 0, 0))), to_light(square((0, 255, 0)))
    np.testing.assert_allclose(red.mean((0, 1)), [0.25, 0, 0])
    np.testing.assert_allclose(green.mean((0, 1)), [0, 0.25, 0])


@pytest.mark.parametrize("mode", ["LA", "PA", "RGBA", "La", "RGBa"])
def test_a_transparent_picture_of_pillow_is_refused(mode):
    straight = {"La": "LA", "RGBa": "RGBA"}.get(mode, mode)
    picture = PILLOW.quantize(5).convert("PA") if mode == "PA" else PILLOW.convert("L" if "L" in mode else "RGB")
    picture = picture if mode == "PA" else picture.convert(straight)
    picture.putalpha(200)
    with pytest.raises(ValueError, match="has an alpha below 1"):
        to_light(picture.convert(mode))


@pytest.mark.parametrize("mode", ["P", "L", "RGB"])
def test_a_picture_of_pillow_with_a_transparent_colour_is_refused(mode):
    picture = PILLOW.quantize(5) if mode == "P" else PILLOW.convert(mode)
    picture.info["transparency"] = picture.getpixel((2, 3))
    with pytest.raises(ValueError, match="has an alpha below 1"):
        to_light(picture)


@pytest.mark.parametrize("mode", ["I", "I;16", "I;16B"])
def test_a_picture_of_pillow_of_more_bits_is_refused(mode):
    picture = PILLOW.convert("L").convert("I").convert(mode)
    with pytest.raises(ValueError, match="16 or 32 bits per channel"):
        to_light(picture)


def test_a_file_of_16_bits_is_refused_before_pillow_cuts_it(tmp_path):
    rows = b"".join(b"\0" + np.full(15, 255 * 256 + 255, ">u2").tobytes() for _ in range(6))
    parts = (b"IHDR", struct.pack(">IIBBBBB", 5, 6, 16, 2, 0, 0, 0)), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")
    data = b"".join(struct.pack(">I", len(b)) + k + b + struct.pack(">I", zlib.crc32(k + b)) for k, b in parts)
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + data)
    with Image.open(tmp_path / "a.png") as picture, pytest.raises(ValueError, match="16 or 32 bits per channel"):
        to_light(picture)


def test_numbers_of_mode_f_need_an_encoding():
    picture = Image.fromarray(RGB[:, :, 0].astype(np.float32))
    assert picture.mode == "F"
    with pytest.raises(ValueError, match="mode F: pass encoding"):
        to_light(picture)
    np.testing.assert_array_equal(to_light(picture, "linear")[:, :, 1], RGB[:, :, 0].astype(np.float32))
    codes = RGB[:, :, 0].astype(np.float32)
    np.testing.assert_array_equal(to_light(picture, "srgb")[:, :, 1], files.srgb_decode(codes))


def test_a_profile_of_a_picture_of_pillow_is_looked_at():
    picture = PILLOW.copy()
    picture.info["icc_profile"] = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    np.testing.assert_array_equal(to_light(picture), to_light(CODES))
    picture.info["icc_profile"] = b"hello"
    with pytest.raises(ValueError, match="profile can't be applied"):
        to_light(picture)


def test_a_transparent_exr_is_refused_as_a_png_is(tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    plane = np.full((4, 5), 0.5, np.float32)
    for alpha in (0.5, 1.0):
        channels = {**{name: plane.copy() for name in "RGB"}, "A": np.full((4, 5), alpha, np.float32)}
        with OpenEXR.File({}, channels) as file:
            file.write(str(tmp_path / f"{alpha}.exr"))
    with pytest.raises(rt.FileError, match="has an alpha below 1"):
        to_light(tmp_path / "0.5.exr")
    assert (to_light(tmp_path / "1.0.exr") == 0.5).all()


def png_of(rows, channels, kind, path):
    """Write 16-bit rows, (h, w, channels) u2, as a PNG."""
    height, width, _ = rows.shape
    data = b"".join(b"\0" + row.astype(">u2").tobytes() for row in rows)
    head = struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)
    parts = (b"IHDR", head), (b"IDAT", zlib.compress(data)), (b"IEND", b"")
    chunks = (struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in parts)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))


def test_a_png_of_16_bits_has_all_its_bits(tmp_path):
    codes = np.random.default_rng(0).integers(0, 65536, (4, 5, 4)).astype(np.uint16)
    png_of(codes[..., :3], 3, 2, tmp_path / "rgb.png")
    expected = files.srgb_decode(codes[..., :3] / 65535)
    np.testing.assert_allclose(to_light(tmp_path / "rgb.png"), expected, rtol=1e-12)
    png_of(codes[..., :1], 1, 0, tmp_path / "grey.png")
    np.testing.assert_allclose(to_light(tmp_path / "grey.png"), expected[..., :1].repeat(3, 2), rtol=1e-12)
    png_of(codes, 4, 6, tmp_path / "clear.png")
    with pytest.raises(rt.FileError, match=r"clear\.png: has an alpha below 1: put it on a background first"):
        to_light(tmp_path / "clear.png")
    codes[..., 3] = 65535
    png_of(codes, 4, 6, tmp_path / "opaque.png")
    np.testing.assert_allclose(to_light(tmp_path / "opaque.png"), expected, rtol=1e-12)


@pytest.mark.parametrize("ending", ["jpg", "jpeg"])
def test_a_jpeg_is_the_light_of_its_codes(tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    Image.fromarray(np.kron(CODES, np.ones((8, 8, 1), np.uint8))).save(path, "JPEG", quality=90)
    with Image.open(path) as decoded:
        expected = files.srgb_decode(np.asarray(decoded) / 255)
    np.testing.assert_allclose(to_light(path), expected, rtol=1e-12)


def test_a_broken_jpeg_is_a_file_error(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff" + bytes(50))
    with pytest.raises(rt.FileError, match=r"a\.jpg: "):
        to_light(tmp_path / "a.jpg")
    with pytest.raises(rt.FileError, match=r"b\.jpg: "):
        to_light(tmp_path / "b.jpg")
