"""LDR-FLIP and HDR-FLIP in plain NumPy, from the formulas of [Andersson2020] and [Andersson2021]."""

import numpy as np

TO_XYZ = np.array([[10135552, 8788810, 4435075], [2613072, 8788810, 887015], [1425312, 8788810, 70074185]]) / [
    [24577794, 24577794, 24577794],
    [12288897, 12288897, 12288897],
    [73733382, 73733382, 73733382],
]  # linear sRGB, D65
WHITE = TO_XYZ.sum(axis=1)
CONTRAST = {"A": ((1.0, 0.0047), (0.0, 1e-5)), "RG": ((1.0, 0.0053), (0.0, 1e-5)), "BY": ((34.1, 0.04), (13.5, 0.025))}
QC, PC, PT, WIDTH, QF = 0.7, 0.4, 0.95, 0.082, 0.5
ACES = (0.6**2 * 2.51, 0.6 * 0.03, 0.0, 0.6**2 * 2.43, 0.6 * 0.59, 0.14)


def convolved(field, kernel):
    """Field (h, w) with a kernel (k, k); beyond the border is the nearest pixel."""
    radius = len(kernel) // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(field, radius, mode="edge"), kernel.shape)
    return np.einsum("hwij,ij->hw", windows, kernel)


def grid(radius):
    steps = np.arange(-radius, radius + 1)
    return np.meshgrid(steps, steps)


def lab(linear):
    q = linear @ TO_XYZ.T / WHITE
    f = np.where(q > (6 / 29) ** 3, np.cbrt(q), q / (3 * (6 / 29) ** 2) + 4 / 29)
    lightness = 116 * f[..., 1] - 16
    hunt = 0.01 * lightness
    return lightness, hunt * 500 * (f[..., 0] - f[..., 1]), hunt * 200 * (f[..., 1] - f[..., 2])


def distance(one, other):
    (a, b, c), (d, e, f) = one, other
    return np.abs(a - d) + np.hypot(b - e, c - f)


def opponent(linear):
    x, y, z = np.moveaxis(linear @ TO_XYZ.T / WHITE, -1, 0)
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def filtered(linear, ppd):
    radius = int(np.ceil(3 * np.sqrt(0.04 / (2 * np.pi**2)) * ppd))
    x, y = grid(radius)
    square = (x**2 + y**2) / ppd**2
    channels = []
    for field, parts in zip(opponent(linear), CONTRAST.values(), strict=True):
        kernel = sum(a * np.sqrt(np.pi / b) * np.exp(-(np.pi**2) * square / b) for a, b in parts)
        channels.append(convolved(field, kernel / kernel.sum()))
    y = (channels[0] + 16) / 116
    xyz = np.stack([channels[1] / 500 + y, y, y - channels[2] / 200], axis=-1) * WHITE
    return np.clip(xyz @ np.linalg.inv(TO_XYZ).T, 0, 1)


def features(linear, ppd):
    """Sizes of edges and of points."""
    grey = (opponent(linear)[0] + 16) / 116
    deviation = 0.5 * WIDTH * ppd
    x, y = grid(int(np.ceil(3 * deviation)))
    bell = np.exp(-(x**2 + y**2) / (2 * deviation**2))
    found = []
    for kernel in (-x * bell, (x**2 / deviation**2 - 1) * bell):
        up, down = kernel[kernel > 0].sum(), -kernel[kernel < 0].sum()
        kernel = np.where(kernel > 0, kernel / up, kernel / down)
        found.append(np.hypot(convolved(grey, kernel), convolved(grey, kernel.T)))
    return found


def ldr_flip(image, reference, ppd):
    """LDR-FLIP of linear light in 0..1, (h, w)."""
    power = distance(lab(filtered(reference, ppd)), lab(filtered(image, ppd))) ** QC
    most = distance(lab(np.array([0.0, 1.0, 0.0])), lab(np.array([0.0, 0.0, 1.0]))) ** QC
    knee = PC * most
    colour = np.where(power < knee, PT / knee * power, PT + (power - knee) / (most - knee) * (1 - PT))
    pairs = zip(features(reference, ppd), features(image, ppd), strict=True)
    feature = np.max([np.abs(a - b) for a, b in pairs], axis=0)
    return colour ** (1 - (feature / np.sqrt(2)) ** QF)


def exposures(reference):
    """Stops at which the reference's brightest pixel, and its median, reach 0.85 after tone mapping."""
    a, b, c = (ACES[k] - 0.85 * ACES[k + 3] for k in range(3))
    top = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    luminance = np.sort((reference @ [0.2126, 0.7152, 0.0722]).ravel())
    first, last = np.log2(top / luminance[-1]), np.log2(top / luminance[len(luminance) // 2])
    return np.linspace(first, last, max(2, int(np.ceil(last - first))))


def mapped(linear, stops):
    x = linear * 2.0**stops
    p, q, r, s, t, u = ACES
    return np.clip((p * x * x + q * x + r) / (s * x * x + t * x + u), 0, 1)


def hdr_flip(image, reference, ppd):
    """HDR-FLIP of linear light from 0 on, (h, w)."""
    return np.max([ldr_flip(mapped(image, e), mapped(reference, e), ppd) for e in exposures(reference)], axis=0)
