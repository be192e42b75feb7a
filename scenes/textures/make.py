"""Write the images and the mesh of ``scenes/textures.json``: ``python scenes/textures/make.py [folder]``.

Row 0 of an image is its top. Images repeat: their left edge continues the right one, their bottom the top. Numbers are
rounded to codes before they are written, so that the last bits of ``sin``, which differ between machines, never count.
"""

import io
import struct
import sys
from pathlib import Path

import numpy as np
from PIL import Image

SPRITE = """
....####....
..##oooo##..
.#oooooooo#.
.#o##oo##o#.
#oo##oo##oo#
#oooooooooo#
#oo#oooo#oo#
#ooo####ooo#
.#oooooooo#.
.##oooooo##.
...######...
............
"""
COLOURS = {".": (196, 214, 208), "#": (38, 34, 52), "o": (242, 186, 62)}
PANES = (214, 62, 48), (246, 214, 120), (60, 118, 196), (250, 240, 220), (88, 164, 108), (236, 140, 52)
LAYOUT = "aabbbb", "aabbbb", "ccdddd", "ccddee", "ffffee", "ffaaee"  # one letter for each pane of the window
WINDOW = "\n".join(LAYOUT)


def grid(width, height):
    """Coordinates u and v of the centres of texels, v upwards."""
    u, v = (np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height
    return np.meshgrid(u, v)


def mixed(a, b, t):
    """Colours between two, by a weight for each texel."""
    return np.array(a) + np.clip(t, 0, 1)[..., None] * (np.array(b, float) - np.array(a))


def codes(colours):
    return np.clip(np.round(colours), 0, 255).astype(np.uint8)


def tiles():
    """A glazed tile: quarters of circles around the corners, and a flower in the middle."""
    u, v = grid(128, 128)
    x, y = np.abs(u - 0.5), np.abs(v - 0.5)
    corner, middle = np.hypot(0.5 - x, 0.5 - y), np.hypot(x, y)
    angle = np.arctan2(y, x)
    glaze = mixed((226, 219, 200), (232, 226, 212), 0.5 + 0.5 * np.sin(6 * np.pi * u) * np.sin(6 * np.pi * v))
    ring = mixed(glaze, (30, 78, 120), 60 * (0.035 - np.abs(corner - 0.33)))
    flower = mixed(ring, (190, 84, 40), 60 * (0.2 * np.abs(np.cos(2 * angle)) + 0.05 - middle))
    dots = mixed(flower, (30, 78, 120), 60 * (0.09 - corner))
    heart = mixed(dots, (240, 200, 96), 60 * (0.055 - middle))
    return codes(mixed(heart, (120, 116, 108), 90 * (np.maximum(x, y) - 0.487)))


def planet():
    """Bands of clouds that waver, with one storm; around the axis it repeats."""
    u, v = grid(256, 128)
    turn, height = 2 * np.pi * u, np.pi * (v - 0.5)
    waver = 0.05 * np.sin(3 * turn + 9 * height) + 0.03 * np.sin(7 * turn - 5 * height)
    waver += 0.02 * np.sin(13 * turn + 17 * v)
    band = np.sin(11 * (height + waver)) + 0.4 * np.sin(23 * height + 2 * waver)
    colours = mixed((176, 112, 70), (240, 222, 190), 0.5 + 0.45 * band)
    colours = mixed(colours, (120, 84, 76), 1.6 * np.abs(height) - 1.3)
    storm = np.hypot((np.abs(u - 0.62)) / 0.055, (v - 0.38) / 0.06)
    colours = mixed(colours, (200, 74, 44), 3 * (1.1 - storm))
    return codes(mixed(colours, (242, 226, 196), 4 * (0.18 - np.abs(storm - 1.2))))


def sprite():
    """A face of 12 x 12 texels."""
    return np.array([[COLOURS[letter] for letter in row] for row in SPRITE.split()], np.uint8)


def window():
    """Panes of coloured glass between bars."""
    size = 16
    letters = np.array([[ord(letter) - ord("a") for letter in row] for row in WINDOW.split()])
    fine = np.kron(letters, np.ones((size, size), int))
    image = np.array(PANES)[fine].astype(float)
    inner = np.pad(fine, 1, constant_values=-1)
    for dy, dx in ((0, 1), (2, 1), (1, 0), (1, 2)):
        other = inner[dy : dy + len(fine), dx : dx + len(fine)]
        image[other != fine] = 8
    return codes(image)


def shell():
    """A mesh with vertex colours: a spiral shell; vertices (v, 3), faces (m, 3) and codes (v, 3)."""
    turns, sides, rings = 2.75, 20, 110
    t, a = np.linspace(0, 1, rings)[:, None], np.linspace(0, 2 * np.pi, sides, endpoint=False)[None]
    grown, turn = np.exp(2.3 * (t - 1)), 2 * np.pi * turns * t
    tube = 0.46 * grown * (1 + 0.05 * np.sin(60 * t))
    radius = 0.56 * grown + tube * np.cos(a)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0.75 * (1 - grown) + tube * np.sin(a)], axis=2)
    k, j = np.meshgrid(np.arange(rings - 1) * sides, np.arange(sides), indexing="ij")
    near, far = k + j, k + (j + 1) % sides
    pair = np.stack([near, near + sides, far], -1), np.stack([far, near + sides, far + sides], -1)
    faces = np.concatenate([corners.reshape(-1, 3) for corners in pair])
    stripe = 0.5 + 1.2 * np.sin(3 * a + 38 * t)
    colours = mixed((250, 214, 170), (120, 26, 30), stripe * np.ones_like(t)) * (0.5 + 0.5 * t)[..., None]
    return points.reshape(-1, 3), faces, codes(colours.reshape(-1, 3))


def ply(points, faces, colours):
    """A binary PLY with vertex colours."""
    names = "".join(f"property float {axis}\n" for axis in "xyz")
    names += "".join(f"property uchar {channel}\n" for channel in ("red", "green", "blue"))
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{names}"
    head += f"element face {len(faces)}\nproperty list uchar ushort vertex_indices\nend_header\n"
    rounded = np.round(points, 4).astype("<f4")
    body = b"".join(row.tobytes() + colour.tobytes() for row, colour in zip(rounded, colours, strict=True))
    return head.encode() + body + b"".join(struct.pack("<B3H", 3, *face) for face in faces.tolist())


def png(image):
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for make in (tiles, planet, sprite, window):
        (folder / f"{make.__name__}.png").write_bytes(png(make()))
    (folder / "shell.ply").write_bytes(ply(*shell()))


if __name__ == "__main__":
    main()
