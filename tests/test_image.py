"""sRGB against its standard; files there and back, the same bytes each time, and one line for each mishap."""

import errno
import io
import json
import os
import struct
import sys
import zlib

import numpy as np
import pytest

from raytrace.errors import FileError
from raytrace.image import decoding, files

PROVENANCE = {"version": "0.1", "seed": 2**32 - 1, "seconds": 1.25, "cpu": "Zoë's \u2603"}


def picture(height=6, width=9, seed=0):
    rng = np.random.default_rng(seed)
    rgb = rng.random((height, width, 3)).astype(np.float32)
    layers = {
        "depth": rng.random((height, width)).astype(np.float32),
        "normal": rng.standard_normal((height, width, 3)).astype(np.float32),
        "albedo": rng.random((height, width, 3)).astype(np.float32),
        "position": rng.standard_normal((height, width, 3)).astype(np.float32),
        "prim_id": rng.integers(-1, 2**31 - 1, (height, width), np.int32),
        "samples": rng.integers(0, 64, (height, width), np.int32),
    }
    layers["depth"][0, 0] = np.inf  # a ray that missed
    layers["prim_id"][0, 0] = -1
    return rgb, {"stderr": rng.random((height, width)).astype(np.float32), "aov": layers, "provenance": PROVENANCE}


def png_chunks(data):
    chunks, at = [], 8
    while at < len(data):
        (size,) = struct.unpack(">I", data[at : at + 4])
        body = data[at + 4 : at + 8 + size]
        assert struct.unpack(">I", data[at + 8 + size : at + 12 + size]) == (zlib.crc32(body),)
        chunks.append((body[:4], body[4:]))
        at += 12 + size
    return chunks


# ---- sRGB


def test_srgb_has_the_values_of_the_standard():
    # IEC 61966-2-1: the straight part, the join (both parts agree to about 3e-8), white; 0.5 by hand
    assert files.srgb_encode([0.0, 0.001, 1.0]) == pytest.approx([0.0, 0.01292, 1.0], abs=1e-15)
    assert files.srgb_encode(0.5) == pytest.approx(1.055 * 0.5 ** (1 / 2.4) - 0.055, rel=1e-15)
    assert files.srgb_encode(np.nextafter(0.0031308, 1)) == pytest.approx(12.92 * 0.0031308, rel=1e-6)


def test_srgb_there_and_back_is_the_identity():
    x = np.linspace(-0.5, 4.0, 10_001)
    near_join = np.abs(x - 0.0031308) < 1e-5  # the standard's two thresholds don't meet exactly
    back = files.srgb_decode(files.srgb_encode(x))
    assert back[~near_join] == pytest.approx(x[~near_join], rel=1e-13)
    assert back[near_join] == pytest.approx(x[near_join], rel=1e-6)


def test_every_8_bit_code_survives_decoding_and_encoding():
    codes = np.arange(256)
    assert (files.srgb8(files.srgb_decode(codes / 255.0)) == codes).all()


def test_srgb8_rounds_half_up():
    edges = files.srgb_decode((np.arange(255) + 0.5) / 255.0)
    assert (files.srgb8(edges * (1 + 1e-9)) == np.arange(1, 256)).all()
    assert (files.srgb8(edges * (1 - 1e-9)) == np.arange(255)).all()


def test_srgb8_is_defined_for_what_is_no_light():
    assert files.srgb8([np.nan, np.inf, -np.inf, -1.0, -0.0, 1e30]).tolist() == [0, 255, 0, 0, 0, 255]
    assert files.srgb8([np.nan, np.inf, -np.inf], exposure=-3.5).tolist() == [0, 255, 0]


def test_exposure_is_in_stops():
    light = np.linspace(0.0, 2.0, 50)
    assert (files.srgb8(light, exposure=1.5) == files.srgb8(light * 2.0**1.5)).all()
    assert (files.srgb8(light, exposure=-2) == files.srgb8(light / 4.0)).all()
    for wrong in (np.nan, np.inf, 1000.0):
        with pytest.raises(ValueError, match="exposure: expected stops from -100 to 100"):
            files.srgb8(light, exposure=wrong)


# ---- files there and back


@pytest.mark.parametrize("name", ["a.exr", "a.npz"])
def test_float_formats_keep_every_bit_and_layer(tmp_path, name):
    rgb, rest = picture()
    rgb[0, 0], rgb[0, 1] = (np.nan, np.inf, -1.0), (1e30, 1e-40, 0.0)
    assert files.save(tmp_path / name, rgb, **rest) == tmp_path / name
    back = files.load(tmp_path / name)
    assert back.rgb.dtype == np.float32
    assert back.rgb.tobytes() == rgb.tobytes()
    assert back.stderr.tobytes() == rest["stderr"].tobytes()
    assert back.aov.keys() == rest["aov"].keys()
    for key, layer in rest["aov"].items():
        assert (back.aov[key].dtype, back.aov[key].tobytes()) == (layer.dtype, layer.tobytes()), key
    assert back.provenance == PROVENANCE


@pytest.mark.parametrize("name", ["a.exr", "a.npz", "a.png"])
def test_a_picture_alone_comes_back_alone(tmp_path, name):
    rgb, _ = picture(1, 1)
    back = files.load(files.save(str(tmp_path / name), rgb.astype(np.float64).tolist()))
    assert back.rgb == pytest.approx(rgb, abs=0.005)  # half an 8-bit step in linear light is at most 0.0045
    assert (back.stderr, back.aov, back.provenance) == (None, {}, {})


@pytest.mark.parametrize("name", ["a.exr", "a.npz", "a.png"])
def test_what_is_read_may_be_written_to(tmp_path, name):
    rgb, rest = picture()
    back = files.load(files.save(tmp_path / name, rgb, **rest))
    for array in (back.rgb, *back.aov.values()):
        array *= 2
    assert (files.load(tmp_path / name).rgb * 2 == back.rgb).all()


@pytest.mark.parametrize("exposure", [0.0, -2.5])
def test_a_png_gives_the_light_of_its_codes_back(tmp_path, exposure):
    rgb, rest = picture()
    back = files.load(files.save(tmp_path / "A.PNG", rgb, **rest, exposure=exposure))
    codes = files.srgb8(rgb, exposure)
    assert back.rgb == pytest.approx(files.srgb_decode(codes / 255.0) * 2.0**-exposure, rel=1e-7)  # float32
    assert (files.srgb8(back.rgb, exposure) == codes).all()
    assert (back.stderr, back.aov, back.provenance) == (None, {}, PROVENANCE)


def test_a_png_is_8_bit_srgb_that_says_so():
    chunks = png_chunks(files.png_bytes(picture()[0], PROVENANCE))
    names = [name for name, _ in chunks]
    assert (names[0], names[-1]) == (b"IHDR", b"IEND")
    assert dict(chunks)[b"IHDR"] == struct.pack(">IIBBBBB", 9, 6, 8, 2, 0, 0, 0)
    assert (dict(chunks)[b"sRGB"], dict(chunks)[b"gAMA"]) == (b"\0", struct.pack(">I", 45455))
    assert names.index(b"sRGB") < names.index(b"IDAT")
    texts = dict(body.split(b"\0") for name, body in chunks if name == b"tEXt")
    assert json.loads(texts[b"raytrace:cpu"]) == PROVENANCE["cpu"]
    assert texts[b"raytrace:seed"] == b"4294967295"


def test_an_exr_has_named_layers_and_provenance_for_other_programs(tmp_path):
    import OpenEXR

    rgb, rest = picture()
    with OpenEXR.File(str(files.save(tmp_path / "a.exr", rgb, **rest)), separate_channels=True) as file:
        header = dict(file.header())  # the file takes its own with it
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert header["type"] == OpenEXR.scanlineimage
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert (channels["G"] == rgb[:, :, 1]).all()
    assert (channels["normal.Z"] == rest["aov"]["normal"][:, :, 2]).all()
    assert channels["prim_id.id"][0, 0] == 2**32 - 1
    assert header["raytrace:version"] == '"0.1"'


def test_an_exr_of_another_program_loads(tmp_path):
    import OpenEXR

    plane = np.arange(6, dtype=np.float16).reshape(2, 3)
    with OpenEXR.File({"owner": "me"}, {**dict.fromkeys("RGB", plane), "A": 0 * plane + 1, "depth.Z": plane}) as file:
        file.write(str(tmp_path / "half.exr"))
    back = files.load(tmp_path / "half.exr")
    assert (back.rgb == plane[:, :, None]).all()
    assert (back.aov["depth"].dtype, back.provenance) == (np.float32, {})


@pytest.mark.parametrize("mode", ["RGBA", "L", "P", "1"])
def test_a_png_of_another_kind_loads_as_colour(tmp_path, mode):
    from PIL import Image

    Image.new("RGB", (3, 2), (255, 255, 255)).convert(mode).save(tmp_path / "a.png")
    assert (files.load(tmp_path / "a.png").rgb == np.ones((2, 3, 3))).all()


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.npz"])
def test_the_same_picture_gives_the_same_bytes(tmp_path, name, monkeypatch):
    rgb, rest = picture(40, 50)
    first = files.save(tmp_path / name, rgb, **rest).read_bytes()
    monkeypatch.setattr("time.time", lambda: 2e9)
    monkeypatch.setattr("time.localtime", lambda *_: (2033, 5, 18, 0, 0, 0, 0, 0, 0))
    assert files.save(tmp_path / name, rgb[:, :, ::-1][:, :, ::-1], **rest).read_bytes() == first


# ---- mishaps: one line, and no file half-written


def one_line(failure):
    assert "\n" not in str(failure.value)
    return str(failure.value)


@pytest.mark.parametrize("name", ["a.jpg", "a", "a.png.gz"])
def test_an_unknown_extension_names_the_known_ones(tmp_path, name):
    for act in (files.check_path, files.load, lambda path: files.save(path, picture()[0])):
        with pytest.raises(FileError) as failure:
            act(tmp_path / name)
        assert "use .png, .exr or .npz" in one_line(failure)


def test_a_path_that_cannot_be_written_is_told_before_a_render(tmp_path):
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").touch()
    for name, what in (("folder.png", "is a folder"), ("no/a.png", "no folder"), ("file/a.png", "no folder")):
        with pytest.raises(FileError) as failure:
            files.check_path(tmp_path / name)
        assert what in one_line(failure)
    assert files.check_path(str(tmp_path / "a.png")) == tmp_path / "a.png"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.png"]


def test_a_read_only_folder_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write anywhere: ask the check, not the system
    with pytest.raises(FileError, match="no permission to write in the folder"):
        files.save(tmp_path / "a.png", picture()[0])


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.npz"])
def test_a_full_disk_leaves_the_old_file_whole(tmp_path, name, monkeypatch):
    old = files.save(tmp_path / name, picture(seed=1)[0]).read_bytes()

    class Full(io.FileIO):
        def write(self, data):
            super().write(data[: len(data) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("builtins.open", Full)
    with pytest.raises(FileError) as failure:
        files.save(tmp_path / name, picture(seed=2)[0])
    monkeypatch.undo()
    assert one_line(failure) == f"{tmp_path / name}: can't be written: No space left on device"
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == old


def test_an_interrupt_while_writing_leaves_nothing(tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        files.save(tmp_path / "a.npz", picture()[0])
    assert list(tmp_path.iterdir()) == []


def test_a_name_too_long_for_the_file_system_is_one_line(tmp_path):
    with pytest.raises(FileError) as failure:
        files.save(tmp_path / ("x" * 300 + ".png"), picture()[0])
    assert "File name too long" in one_line(failure)


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.npz"])
def test_files_that_cannot_be_read_are_one_line(tmp_path, name, capfd):
    path = tmp_path / name
    rgb, rest = picture(16, 16)
    whole = files.save(path, rgb, **rest).read_bytes()
    for data in (b"", b"hello" * 50, whole[:20], whole[: len(whole) // 2], whole[:-200]):
        path.write_bytes(data)
        with pytest.raises(FileError) as failure:
            files.load(path)
        assert one_line(failure).startswith(f"{path}: ")
    path.unlink()
    with pytest.raises(FileError, match="No such file"):
        files.load(path)
    path.mkdir()
    with pytest.raises(FileError, match="a directory; name an image in it"):
        files.load(path)
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.npz"])
def test_flipped_bytes_never_raise_anything_but_a_file_error(tmp_path, name):
    rng = np.random.default_rng(3)
    rgb, rest = picture(4, 5)
    whole = np.frombuffer(files.save(tmp_path / name, rgb, **rest).read_bytes(), np.uint8)
    refused = 0
    for _ in range(60):
        broken = whole.copy()
        broken[rng.integers(0, len(whole), 3)] = rng.integers(0, 256, 3)
        (tmp_path / name).write_bytes(broken.tobytes())
        try:
            files.load(tmp_path / name)
        except FileError as error:
            refused += "\n" not in str(error)
    assert refused > 25  # the other bytes are names, padding, or light that is no worse than other light


def test_a_pickle_in_an_npz_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", rgb=np.array([{}], dtype=object))
    with pytest.raises(FileError, match="pickle"):
        files.load(tmp_path / "a.npz")


def test_a_file_without_colour_is_refused(tmp_path):
    import OpenEXR

    with OpenEXR.File({}, {"Y": np.ones((2, 2), np.float32)}) as file:
        file.write(str(tmp_path / "a.exr"))
    np.savez(tmp_path / "a.npz", picture=np.ones((2, 2, 3)))
    for name in ("a.exr", "a.npz"):
        with pytest.raises(FileError, match="no colour"):
            files.load(tmp_path / name)


def test_a_16_bit_png_is_refused(tmp_path):
    from PIL import Image

    Image.fromarray(np.ones((2, 2), np.uint16)).save(tmp_path / "a.png")
    with pytest.raises(FileError, match="16 bits"):
        files.load(tmp_path / "a.png")


def test_a_png_too_large_to_trust_is_refused(tmp_path, monkeypatch):
    files.save(tmp_path / "a.png", picture()[0])
    monkeypatch.setattr(decoding, "MAX_PIXELS", 10)
    with pytest.raises(FileError, match=r"a\.png: it has \d+ pixels; at most 10$"):
        files.load(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", ["png", "exr", "npz"])
def test_a_picture_that_takes_more_memory_than_there_is_is_refused(tmp_path, monkeypatch, suffix):
    path = files.save(tmp_path / f"a.{suffix}", np.zeros((100, 100, 3)))
    left = path.stat().st_size + 10_000  # enough for the file itself
    monkeypatch.setattr("raytrace.memory.free", lambda: float(left))
    with pytest.raises(FileError, match=r"takes about \d+ MiB of memory, 0 MiB are free; scale it down$"):
        files.load(path)
    monkeypatch.setattr("raytrace.memory.free", lambda: 10.0)
    with pytest.raises(FileError, match="takes about 0 MiB"):
        files.load(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes here")
def test_what_is_no_regular_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.png")
    (tmp_path / "b.npz").symlink_to("/dev/zero")
    for name in ("a.png", "b.npz"):
        with pytest.raises(FileError, match="no regular file"):
            files.load(tmp_path / name)


def test_without_openexr_the_message_names_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    for act in (files.check_path, files.load):
        with pytest.raises(FileError, match="pip install OpenEXR; or use"):
            act(tmp_path / "a.exr")


@pytest.mark.parametrize("shape", [(4,), (4, 4), (4, 4, 4), (0, 4, 3), (4, 0, 3), (1, 4, 4, 3)])
def test_what_is_no_picture_is_refused_before_a_file_exists(tmp_path, shape):
    for name in ("a.png", "a.exr", "a.npz"):
        with pytest.raises(ValueError, match=r"rgb: expected shape \(height, width, 3\)"):
            files.save(tmp_path / name, np.zeros(shape))
    assert list(tmp_path.iterdir()) == []


def test_layers_of_another_size_or_name_are_refused(tmp_path):
    rgb, _ = picture()
    for aov in ({"depth": rgb}, {"normal": rgb[:, :, 0]}, {"depth": rgb[1:, :, 0]}):
        with pytest.raises(ValueError, match="as rgb has it"):
            files.save(tmp_path / "a.npz", rgb, aov=aov)
    with pytest.raises(ValueError, match=r"unknown layers \['dept'\]; the known ones are rgb, stderr, var, depth"):
        files.save(tmp_path / "a.exr", rgb, aov={"dept": rgb[:, :, 0]})


def test_importing_the_module_loads_no_picture_library():
    import subprocess

    code = "import sys, raytrace.image.files; print({'PIL', 'OpenEXR', 'skimage', 'scipy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
