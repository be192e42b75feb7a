"""Metals by name: their complex index of refraction eta - i k for red, green and blue."""

from typing import Literal

Metal = Literal["aluminum", "chromium", "copper", "gold", "iron", "nickel", "silver", "titanium"]

# Measured values, interpolated linearly at 611, 549 and 464 nm: the dominant wavelengths of the primaries of Rec. 709.
# Aluminum [Rakic1995]; chromium, iron, nickel, titanium [Johnson1974]; copper, gold, silver [Johnson1972].
INDEX: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {  # eta, k
    "aluminum": ((1.320, 1.011, 0.683), (7.307, 6.616, 5.623)),
    "chromium": ((3.179, 3.180, 2.447), (3.300, 3.330, 3.205)),
    "copper": ((0.367, 1.016, 1.246), (3.121, 2.579, 2.452)),
    "gold": ((0.223, 0.428, 1.335), (3.204, 2.460, 1.872)),
    "iron": ((2.890, 2.950, 2.642), (3.040, 2.930, 2.802)),
    "nickel": ((1.985, 1.920, 1.763), (3.982, 3.610, 3.041)),
    "silver": ((0.058, 0.060, 0.046), (4.103, 3.589, 2.792)),
    "titanium": ((2.658, 2.540, 2.302), (3.696, 3.430, 3.079)),
}
