"""PNG files of every kind: the colours that they show, or one line that says why not."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image, ImageCms, PngImagePlugin

from raytrace.errors import FileError
from raytrace.image import files
from raytrace.image.metrics import compare

CODES = np.random.default_rng(0).integers(0, 256, (5, 6, 3), np.uint8)
SRGB_CHRM = (31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(rows, depth, kind, *chunks, interlaced=0, size=(6, 5)):
    """A PNG of packed rows, bytes each."""
    head = struct.pack(">IIBBBBB", *size, depth, kind, 0, 0, interlaced)
    body = zlib.compress(b"".join(b"\0" + row for row in rows))
    parts = [chunk(b"IHDR", head), *(chunk(*each) for each in chunks), chunk(b"IDAT", body), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


RGB = [row.tobytes() for row in CODES]
GREY = [row.tobytes() for row in CODES[:, :, 0]]


@pytest.fixture
def load(tmp_path):
    def read(data):
        (tmp_path / "a.png").write_bytes(data)
        return files.load(tmp_path / "a.png")

    return read


@pytest.fixture
def refused(tmp_path, load):
    def why(data):
        with pytest.raises(FileError) as failure:
            load(data)
        line = str(failure.value)
        assert "\n" not in line
        assert line.isprintable()
        return line.removeprefix(f"{tmp_path / 'a.png'}: ")

    return why


def light(codes):
    return files.srgb_decode(codes / 255.0).astype(np.float32)


def test_depths_and_colour_types_are_the_colours_that_they_show(load):
    assert (load(png(RGB, 8, 2)).rgb == light(CODES)).all()
    grey = np.repeat(CODES[:, :, :1], 3, axis=2)
    assert (load(png(GREY, 8, 0)).rgb == light(grey)).all()
    for depth in (1, 2, 4):
        values = CODES[:, :, 0] >> (8 - depth)
        bits = (values[:, :, None] >> np.arange(depth)[::-1]) & 1
        rows = [np.packbits(row.reshape(-1)).tobytes() for row in bits]
        shown = np.repeat((values.astype(int) * 255 // (2**depth - 1))[:, :, None], 3, axis=2)
        assert (load(png(rows, depth, 0)).rgb == light(shown)).all()
        palette = np.random.default_rng(depth).integers(0, 256, (2**depth, 3), np.uint8)
        assert (load(png(rows, depth, 3, (b"PLTE", palette.tobytes()))).rgb == light(palette[values])).all()


def test_palettes_tell_images_apart(load):
    rows = [bytes([0, 1, 1, 1, 1, 0])] * 5
    red, green = (
        load(png(rows, 8, 3, (b"PLTE", bytes([0, 0, 0, *colour])))).rgb for colour in ((255, 0, 0), (0, 255, 0))
    )
    assert red.mean(axis=(0, 1)) == pytest.approx([2 / 3, 0, 0])
    assert green.mean(axis=(0, 1)) == pytest.approx([0, 2 / 3, 0])


def test_an_interlaced_one_is_the_same(load):
    # Adam7: pixels of the seven passes, one after the other
    passes = [(0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1)]
    parts = [CODES[top::down, left::across] for top, left, down, across in passes]
    rows = [row.tobytes() for part in parts if part.size for row in part]
    assert (load(png(rows, 8, 2, interlaced=1)).rgb == light(CODES)).all()


@pytest.mark.parametrize("kind", [0, 2, 4, 6])
def test_16_bits_are_refused_in_every_colour_type(refused, kind):
    channels = {0: 1, 2: 3, 4: 2, 6: 4}[kind]
    assert refused(png([bytes(12 * channels)] * 5, 16, kind)) == "16 bits per channel; use 8 bits, .exr or .npz"


def alpha_rows(alpha):
    return [np.dstack([CODES, np.full((5, 6), alpha, np.uint8)])[k].tobytes() for k in range(5)]


def grey_alpha_rows(alpha):
    return [np.dstack([CODES[:, :, :1], np.full((5, 6), alpha, np.uint8)])[k].tobytes() for k in range(5)]


TRANSPARENT = {
    "rgba": png(alpha_rows(254), 8, 6),
    "grey and alpha": png(grey_alpha_rows(0), 8, 4),
    "palette": png([bytes([0, 1, 2, 0, 1, 2])] * 5, 8, 3, (b"PLTE", bytes(range(9))), (b"tRNS", b"\xff\x80")),
    "a colour": png(RGB, 8, 2, (b"tRNS", struct.pack(">3H", *CODES[2, 3].tolist()))),
    "a grey": png(GREY, 8, 0, (b"tRNS", struct.pack(">H", CODES[2, 3, 0]))),
    "a grey of 4 bits": png([bytes([0x12, 0x34, 0x56])] * 5, 4, 0, (b"tRNS", b"\0\x05")),
    "a grey of 2 bits": png([bytes([0b00011011, 0])] * 5, 2, 0, (b"tRNS", b"\0\x02")),
    "black of 1 bit": png([b"\xfc", b"\x00"] * 2 + [b"\xfc"], 1, 0, (b"tRNS", b"\0\0")),
}


@pytest.mark.parametrize("name", TRANSPARENT)
def test_what_is_transparent_is_refused(refused, name):
    assert refused(TRANSPARENT[name]).startswith("has an alpha below 1: put ")


def test_what_is_opaque_in_spite_of_an_alpha_is_read(load):
    assert (load(png(alpha_rows(255), 8, 6)).rgb == light(CODES)).all()
    unused = (b"tRNS", b"\xff\xff\xff\0")  # of a colour that no pixel has
    colours = bytes(range(12))
    assert load(png([bytes([0, 1, 2, 0, 1, 2])] * 5, 8, 3, (b"PLTE", colours), unused)).rgb.shape == (5, 6, 3)
    assert load(png([bytes([0x12, 0x34, 0x56])] * 5, 4, 0, (b"tRNS", b"\0\x0f"))).rgb.max() < 1


def test_an_animation_is_refused(refused, load):
    assert refused(png(RGB, 8, 2, (b"acTL", struct.pack(">II", 3, 0)))) == "an animation of 3 images; save one of them"
    assert (load(png(RGB, 8, 2, (b"acTL", struct.pack(">II", 1, 0)))).rgb == light(CODES)).all()


def profile(name):
    return b"icc\0\0" + zlib.compress(ImageCms.ImageCmsProfile(ImageCms.createProfile(name)).tobytes())


def wide_gamut():
    """An RGB profile of other primaries: red and blue of sRGB's exchanged."""
    data = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    data[data.index(b"rXYZ") : data.index(b"rXYZ") + 4] = b"tmp1"
    data[data.index(b"bXYZ") : data.index(b"bXYZ") + 4] = b"rXYZ"
    data[data.index(b"tmp1") : data.index(b"tmp1") + 4] = b"bXYZ"
    return b"icc\0\0" + zlib.compress(bytes(data))


OTHER_COLOURS = {
    "gamma": ((b"gAMA", struct.pack(">I", 100_000)), "its gamma is 1, that of sRGB 0.45455; convert it to sRGB"),
    "primaries": ((b"cHRM", struct.pack(">8I", *SRGB_CHRM[:2], 70800, 29200, *SRGB_CHRM[4:])), "its primaries are not"),
    "cut primaries": ((b"cHRM", b"\0" * 5), "not a valid PNG image: "),
    "code points": ((b"cICP", bytes([9, 16, 0, 1])), "its colours are not sRGB's (cICP)"),
    "profile": ((b"iCCP", wide_gamut()), "its colour profile is not that of sRGB"),
    "broken profile": ((b"iCCP", b"icc\0\0" + zlib.compress(b"hello")), "its colour profile can't be applied"),
    "profile of Lab": ((b"iCCP", profile("LAB")), "its colour profile can't be applied"),
}


@pytest.mark.parametrize("name", OTHER_COLOURS)
def test_other_colours_are_not_taken_for_srgb(refused, name):
    extra, words = OTHER_COLOURS[name]
    assert refused(png(RGB, 8, 2, extra)).startswith(words)


@pytest.mark.parametrize(
    "chunks",
    [
        [(b"gAMA", struct.pack(">I", 45455)), (b"cHRM", struct.pack(">8I", *SRGB_CHRM))],
        [(b"sRGB", b"\0"), (b"gAMA", struct.pack(">I", 100_000))],  # sRGB goes first
        [(b"iCCP", profile("sRGB")), (b"gAMA", struct.pack(">I", 100_000))],
        [(b"cICP", bytes([1, 13, 0, 1])), (b"iCCP", profile("LAB"))],
    ],
)
def test_srgb_by_other_words_is_read(load, chunks):
    assert (load(png(RGB, 8, 2, *chunks)).rgb == light(CODES)).all()


@pytest.mark.parametrize(
    "text",
    ["abc", '"1"', "[1]", "null", "true", "NaN", "Infinity", "1e999", "101", "-100.5", "9" * 4000, "[" * 9000, ""],
)
def test_an_exposure_that_is_none_is_refused(refused, text):
    line = refused(png(RGB, 8, 2, (b"tEXt", b"raytrace:exposure\0" + text.encode())))
    assert line.startswith("its text raytrace:exposure is not ")


def test_exposures_at_the_ends_are_read(load):
    for stops in (-100, 100, -0.5):
        text = b"raytrace:exposure\0" + str(stops).encode()
        assert (load(png(RGB, 8, 2, (b"tEXt", text))).rgb > 0).any()


def test_a_provenance_that_is_no_json_is_refused(refused):
    assert (
        refused(png(RGB, 8, 2, (b"tEXt", b"raytrace:seed\0four")))
        == "its text raytrace:seed is not valid JSON; remove it"
    )


def test_what_pillow_would_not_notice_is_refused(refused):
    whole = png(RGB, 8, 2)
    at = whole.index(b"IDAT")
    assert "checksum of its chunk IDAT" in refused(whole[: at + 9] + bytes([whole[at + 9] ^ 1]) + whole[at + 10 :])
    assert "truncated" in refused(whole[:-12])
    assert "does not begin" in refused(b"GIF89a" + whole)
    assert "does not begin with a header" in refused(b"\x89PNG\r\n\x1a\n" + chunk(b"IEND", b""))
    assert "no header" in refused(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", b"") + chunk(b"IEND", b""))


def test_a_pointer_of_git_lfs_says_what_to_do(refused):
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n"
    assert refused(pointer) == "a Git LFS pointer; fetch the file: git lfs pull"


def test_what_pillow_writes_is_read(tmp_path):
    pillow = Image.fromarray(CODES)
    texts = PngImagePlugin.PngInfo()
    texts.add_itxt("raytrace:about", '"\u2603"')
    pillow.save(
        tmp_path / "a.png",
        pnginfo=texts,
        icc_profile=ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(),
    )
    pillow.quantize(7).save(tmp_path / "b.png")
    assert (files.load(tmp_path / "a.png").rgb == light(CODES)).all()
    assert files.load(tmp_path / "a.png").provenance == {"about": "\u2603"}
    assert (files.load(tmp_path / "b.png").rgb == light(np.asarray(pillow.quantize(7).convert("RGB")))).all()
    assert compare(tmp_path / "b.png", tmp_path / "a.png").rmse > 0


def test_what_pillow_would_fill_in_is_refused(refused, load):
    two = (b"PLTE", bytes([9, 9, 9, 200, 200, 200]))
    assert "end after 76 of 95 bytes" in refused(png(RGB[:4], 8, 2))
    assert "end after" in refused(png(RGB[:4], 8, 2, interlaced=1))
    assert "palette does not have" in refused(png([bytes([0, 1, 2, 0, 1, 2])] * 5, 8, 3, two))
    assert "palette" in refused(png([bytes(6)] * 5, 8, 3))
    assert load(png([bytes([0, 1, 1, 0, 1, 1])] * 5, 8, 3, two)).rgb.shape == (5, 6, 3)
    assert (load(png([*RGB, b"more than there are rows"], 8, 2)).rgb == light(CODES)).all()


def pieces(*chunks, rows=RGB, head=b"\0\0\0\6\0\0\0\5\x08\2\0\0\0"):
    """A PNG with these chunks in place of the pixels; None: the pixels, or the next half of them."""
    body = zlib.compress(b"".join(b"\0" + row for row in rows))
    halves = iter([body[:30], body[30:]] if chunks.count(None) == 2 else [body])
    parts = [(b"IHDR", head), *((b"IDAT", next(halves)) if part is None else part for part in chunks), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def test_pixels_may_be_in_pieces_that_follow_each_other(load, refused):
    assert (load(pieces(None, None)).rgb == light(CODES)).all()
    assert (load(pieces((b"tIME", bytes(7)), None, (b"tEXt", b"a\0b"))).rgb == light(CODES)).all()
    assert "interrupted" in refused(pieces(None, (b"tIME", bytes(7)), None))
    assert "pixels end after 0 of 95 bytes" in refused(pieces((b"IDAT", b"")))


def test_chunks_out_of_place_are_refused(refused):
    key = (b"tRNS", bytes(6))
    assert "tRNS appears twice or too late" in refused(pieces(None, key))
    assert "tRNS appears twice or too late" in refused(pieces(key, key, None))
    assert "IHDR appears twice" in refused(pieces((b"IHDR", bytes(13)), None))
    assert "its chunk ABCD is not known" in refused(pieces((b"ABCD", b""), None))


@pytest.mark.parametrize(
    "end", ["\x08\2\1\0\0", "\x08\2\0\1\0", "\x08\2\0\0\2", "\4\2\0\0\0", "\x08\5\0\0\0", "\0\2\0\0\0"]
)
def test_headers_of_no_png_are_refused(refused, end):
    assert "its header is invalid" in refused(pieces(None, head=b"\0\0\0\6\0\0\0\5" + end.encode("latin-1")))
    assert "its header is invalid" in refused(pieces(None, head=bytes(8) + b"\x08\2\0\0\0"))
