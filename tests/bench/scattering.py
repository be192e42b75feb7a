"""Rough materials and plastic at full size: chi-square tests, and the light that one scattering loses.

python tests/bench/scattering.py            # both, 10 minutes
python tests/bench/scattering.py --loss     # the table of docs/light-transport.md alone
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from scattering_oracles import MATERIALS, at_angle, chi_square, energy

ALPHAS = (0.001, 0.01, 0.1, 0.4, 1.0)
ANGLES = {"conductor": (0, 30, 60, 80, 89), "dielectric": (0, 30, 60, 80, 89), "plastic": (0, 30, 60, 80, 89)}
INSIDE = (91, 100, 120, 150, 180)  # degrees from the normal: views from inside of a dielectric
SAMPLES, FINEST = 200_000, 256
LOSS_ALPHAS, LOSS_ANGLES = (0.001, 0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0), (0, 30, 60, 80)


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def chi_squares() -> bool:
    """Print the p-value of every material, alpha and angle; whether the least is likely among so many."""
    found = []
    for name, material in MATERIALS.items():
        angles = ANGLES[name] + (INSIDE if name == "dielectric" else ())
        say(f"\n{name}: p-values, {SAMPLES:,} samples; alpha, then angles {', '.join(map(str, angles))}")
        for alpha in ALPHAS if name != "plastic" else (0.0,):
            rough = {**material, "alpha": alpha} if alpha else material
            row = [chi_square(rough, at_angle(degrees), SAMPLES, FINEST) for degrees in angles]
            found += row
            say(f"{alpha:6g}  " + "  ".join(f"{p:.4f}" for p in row))
    limit = 1 - (1 - 0.01) ** (1 / len(found))  # [Sidak1967]
    say(f"\nleast p-value of {len(found)} tests: {min(found):.2g}; rejected at 1 % below {limit:.2g}")
    return min(found) >= limit


def losses() -> None:
    """Print the table of the documents: the share of even light that is reflected, or reflected and transmitted."""
    white = {"type": "conductor", "reflectance": [1, 1, 1]}
    for title, material, correlated in (
        ("conductor of reflectance 1", white, False),
        ("the same, height-correlated", white, True),
        ("dielectric, ior 1.5, from outside", {"type": "dielectric", "ior": 1.5}, False),
    ):
        say(f"\n| {title}, alpha | " + " | ".join(f"{degrees}°" for degrees in LOSS_ANGLES) + " |")
        say("|---" * (1 + len(LOSS_ANGLES)) + "|")
        for alpha in LOSS_ALPHAS:
            views = map(at_angle, LOSS_ANGLES)
            row = [energy({**material, "alpha": alpha}, wo, 32, correlated)[0] for wo in views]
            say(f"| {alpha:g} | " + " | ".join(f"{share:.3f}" for share in row) + " |")


def main() -> int:
    """Run what is asked for; 1 if a chi-square test fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--loss", action="store_true", help="print the table of losses only")
    good = parser.parse_args().loss or chi_squares()
    losses()
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
