"""Write the sky of the scenes sky-image and still-life: ``python scenes/textures/make_sky.py [folder]``.

A latitude-longitude image of 16 bits: an evening sky with clouds, land below the horizon, and a sun of some ten texels.
A scene multiplies it by its ``scale``; with 720, the sun is about 1,000 times brighter than the sky. Numbers are
rounded to codes before they are written, so that the last bits of functions, which differ between machines, never
count.
"""

import struct
import sys
import zlib
from pathlib import Path

import numpy as np

WIDTH, HEIGHT = 256, 128
SCALE = 720.0  # as the scenes have it
SUN = 0.78, 0.38  # u and v: 22 degrees above the horizon


def noise(u, v, seed):
    """Smooth noise in 0 .. 1 that repeats in u: sums of waves of rising frequency."""
    rng, total = np.random.default_rng(seed), np.zeros_like(u)
    for octave in range(1, 7):
        for _ in range(3):
            a, b = int(rng.integers(1, 3 * octave)), rng.uniform(2, 9) * octave
            total += np.sin(2 * np.pi * (a * u + rng.random()) + b * v * 4) / octave
    return np.clip(0.5 + total / 8, 0, 1)


def sky():
    """Radiance (h, w, 3), row 0 up."""
    u, v = np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH, (np.arange(HEIGHT) + 0.5) / HEIGHT)
    height = np.cos(np.pi * v)[..., None]
    away = np.abs((u - SUN[0] + 0.5) % 1 - 0.5)[..., None]
    zenith, horizon, glow = np.array([0.16, 0.30, 0.62]), np.array([0.62, 0.66, 0.72]), np.array([1.5, 0.85, 0.42])
    above = horizon + (zenith - horizon) * np.clip(height, 0, 1) ** 0.55
    above = above + glow * np.exp(-((away / 0.11) ** 2) - (height / 0.30) ** 2)
    clouds = np.clip(noise(u, v, 4)[..., None] * 2.6 - 1.2, 0, 1) * np.clip(6 * height, 0, 1)
    above = above + clouds * 0.5 * (np.array([0.95, 0.92, 0.9]) - above)
    land = np.array([0.16, 0.14, 0.11]) * (0.8 + 0.3 * noise(u, v, 9)[..., None])
    radiance = np.where(height > 0, above, land)
    x, y = ((u - SUN[0]) * 2 * np.sin(np.pi * v))[..., None], (v - SUN[1])[..., None]
    disc = np.exp(-(x * x + y * y) / (2 * 0.014**2))
    return radiance + disc * np.array([700.0, 520.0, 330.0])


def codes(radiance):
    """SRGB codes of 16 bits of radiance / SCALE."""
    x = np.clip(radiance / SCALE, 0, 1)
    return np.rint(65535 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)).astype(">u2")


def png(path, pixels):
    """Write an image of 16 bits per channel; each row as differences from the pixel before, which compress well."""
    h, w, _ = pixels.shape
    raw = pixels.view(np.uint8).reshape(h, w * 6)
    before = np.concatenate([np.zeros((h, 6), np.uint8), raw[:, :-6]], axis=1)
    rows = np.concatenate([np.ones((h, 1), np.uint8), raw - before], axis=1)
    chunks = (
        (b"IHDR", struct.pack(">2I5B", w, h, 16, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows.tobytes(), 9)),
        (b"IEND", b""),
    )
    parts = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    ]
    Path(path).write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent)
    png(folder / "sky.png", codes(sky()))
