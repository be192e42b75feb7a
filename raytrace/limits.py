"""Limits of the scene format and of ``render``. This module imports nothing."""

LAYERS = "depth", "normal", "albedo", "prim_id", "position", "samples", "uv"  # AOVs
LIGHT_LAYERS = "emission", "direct", "indirect"  # AOVs of the samples themselves, with integrator path

MIN_ALPHA = 1e-3  # GGX width: below it a surface is smooth

MAX_SIDE = 65_536  # pixels along a side of the film
MAX_PIXELS = 2**28  # pixels of a film: 3 GiB of float32 RGB, 16384 x 16384
MAX_SPP = 65_536  # samples per pixel; halves the noise of 16384, and sample numbers stay within 16 bits
MAX_DEPTH = 65_536  # surfaces a path may meet
MAX_SEED = 2**32 - 1  # random numbers are functions of a 32-bit seed
MAX_TRIANGLES = 2**28  # of a scene: 60 GB of trees and tables
MAX_SCENE = 2**24  # bytes of a scene file: JSON takes 30 times as much memory
MAX_MESH = 2**30  # bytes of a mesh file, decompressed: about 10 million triangles of OBJ, 50 million of binary PLY
MAX_TEXELS = 2**28  # of all textures of a scene: their values are numbered by int32
MAX_RADIANCE = 1e36  # of an environment image, W / (sr m2): sums and products with it stay within float32
