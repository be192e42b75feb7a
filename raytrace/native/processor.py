"""The processor that kernels are compiled for: its name, its features, and how wide its vector registers are.

It is the processor of this machine, unless environment variables say otherwise. ``NUMBA_CPU_NAME`` and
``NUMBA_CPU_FEATURES`` mean what they mean for Numba. ``RAYTRACE_LANES`` (128, 256 or 512) is the number of bits of a
vector register. It may be less than the processor has. Features that need wider registers are then switched off, so
the machine code is that of a processor without them. The results are bit-identical.
"""

import os
import re

import llvmlite.binding as llvm

from raytrace.errors import OptionError, printable, shortened

VARIABLE = "RAYTRACE_LANES"
NARROWEST = 128  # bits: SSE, NEON
WIDER = ((512, "avx512f"), (256, "avx2"))  # bits, and the feature of LLVM that stands for registers of so many
# Feature that LLVM must switch off for registers of so many bits, with all that need it: AVX2 and FMA need AVX.
LEFT_OUT = {256: "-avx512f", 128: "-avx"}


def cpu_name() -> str:
    """LLVM's name of the processor."""
    return os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()


def _without_avx() -> bool:
    """Whether Numba keeps LLVM from using AVX, as it does on some virtual machines."""
    return os.environ.get("NUMBA_ENABLE_AVX", "0" if cpu_name() == "nocona" else "1") == "0"


def _given_features() -> str:
    """Features that Numba would use, before any is switched off."""
    given = os.environ.get("NUMBA_CPU_FEATURES")
    if given is not None:
        return given
    if cpu_name().lower() == "generic":
        return ""
    try:
        features = llvm.get_host_cpu_features().flatten()
    except RuntimeError:  # LLVM cannot detect them on this system
        return ""
    return features.replace("+avx", "-avx") if _without_avx() else features


def width_of(features: str) -> int:
    """Bits of a vector register of a processor with these features; a feature that is not named counts as missing.

    Examples
    --------
    >>> width_of("+sse2,+avx2,-avx512f"), width_of("+neon"), width_of("+avx2,+avx512f,-avx2")
    (256, 128, 128)
    """
    known: dict[str, bool] = {}
    for sign, name in re.findall(r"([+-])([^,\s]+)", features):
        known[name] = sign == "+"
        if sign == "-" and name in ("avx", "avx2"):  # the wider registers are built on these
            known |= dict.fromkeys(("avx2", "avx512f"), False)
    return next((bits for bits, name in WIDER if known.get(name)), NARROWEST)


def register_bits() -> int:
    """Bits of one vector register that kernels use.

    Raises
    ------
    OptionError
        ``RAYTRACE_LANES`` is not 128, 256 or 512, or is more than the processor has.
    """
    most, wanted = width_of(_given_features()), os.environ.get(VARIABLE, "").strip()
    if not wanted:
        return most
    possible = [str(bits) for bits in (128, 256, 512) if bits <= most]
    if wanted not in possible:
        raise OptionError(
            f"{VARIABLE}={shortened(printable(wanted))}: not a width of vector registers in bits that this processor "
            f"has; set it to {' or '.join(possible)}, or unset it ({most} bits are then used)"
        )
    return int(wanted)


def narrowed() -> bool:
    """Whether kernels use narrower registers than the processor has."""
    return register_bits() < width_of(_given_features())


def cpu_features() -> str:
    """Features in LLVM's notation, without those that need wider registers than kernels use."""
    features = _given_features()
    return f"{features},{LEFT_OUT[register_bits()]}" if narrowed() else features
