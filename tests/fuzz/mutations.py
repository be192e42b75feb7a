"""Bytes that are nearly right: files cut, spliced, flipped, and with numbers that no header should hold."""

import gzip
import re
import zlib
from collections.abc import Callable
from random import Random

NUMBERS = [
    b"2000000000",
    b"-1",
    b"0",
    b"1e309",
    b"nan",
    b"inf",
    b"-0",
    b"18446744073709551616",
    b"1e-320",
    b"4294967295",
]
NUMBERS += [b"1" * 400, b"0." + b"3" * 5000, b"1e9999", b"0x10", b"1_0", b"", b"\xd9\xa1", b"1e6", b"2147483648"]
WORDS = [0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1_000_000, 0x7F800000]
WORDS += [0xFF800000, 0x7FC00000, 0x00000001, 0x7F7FFFFF]
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
TEXTS = [
    b"\0",
    b"\n",
    b"\r\n",
    b"#",
    b"\\\n",
    b"/",
    b"//",
    b"end_header\n",
    b"element vertex 3\n",
    b"property float x\n",
]
TEXTS += [
    b"f 1 2 3\n",
    b"v 1e308 -1e308 0\n",
    b"vertex 0 0 0\n",
    b"{",
    b"[" * 200,
    b'"',
    b"\xff\xfe",
    b"file:///etc/passwd",
]


def _place(data: bytes, rng: Random) -> tuple[int, int]:
    a = rng.randrange(len(data) + 1)
    return a, min(len(data), a + rng.choice([1, 2, 4, 16, 64, 1000]))


def flip(data: bytes, rng: Random) -> bytes:
    """Flip a bit."""
    if not data:
        return data
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def write(data: bytes, rng: Random) -> bytes:
    """Write random bytes over others."""
    a, b = _place(data, rng)
    return data[:a] + rng.randbytes(b - a) + data[b:]


def insert(data: bytes, rng: Random) -> bytes:
    """Put in random bytes, or a text that means something."""
    a, _ = _place(data, rng)
    return data[:a] + rng.choice([*TEXTS, rng.randbytes(rng.choice([1, 3, 40]))]) + data[a:]


def delete(data: bytes, rng: Random) -> bytes:
    """Take some bytes out."""
    a, b = _place(data, rng)
    return data[:a] + data[b:]


def cut(data: bytes, rng: Random) -> bytes:
    """End early."""
    return data[: rng.randrange(len(data) + 1)]


def repeat(data: bytes, rng: Random) -> bytes:
    """Write some bytes again."""
    a, b = _place(data, rng)
    return data[:b] + data[a:b] * rng.choice([1, 2, 50]) + data[b:]


def move(data: bytes, rng: Random) -> bytes:
    """Write some bytes over others."""
    (a, b), (c, _) = _place(data, rng), _place(data, rng)
    return data[:c] + data[a:b] + data[c + b - a :]


def number(data: bytes, rng: Random) -> bytes:
    """Replace a number in a text."""
    found = list(NUMBER.finditer(data))
    if not found:
        return flip(data, rng)
    match = rng.choice(found)
    return data[: match.start()] + rng.choice(NUMBERS) + data[match.end() :]


def word(data: bytes, rng: Random) -> bytes:
    """Replace a binary number."""
    size, order = rng.choice([1, 2, 4, 8]), rng.choice(["little", "big"])
    at = rng.randrange(max(len(data) - size, 1))
    value = rng.choice([*WORDS, 2**63, 2**64 - 1]) % (1 << 8 * size)
    return data[:at] + value.to_bytes(size, order) + data[at + size :]


def lines(data: bytes, rng: Random) -> bytes:
    """Swap two lines, drop one, or repeat one."""
    parts = data.split(b"\n")
    i, j = rng.randrange(len(parts)), rng.randrange(len(parts))
    match rng.randrange(3):
        case 0:
            parts[i], parts[j] = parts[j], parts[i]
        case 1:
            del parts[i]
        case _:
            parts.insert(i, parts[j])
    return b"\n".join(parts)


ALL: tuple[Callable[[bytes, Random], bytes], ...] = (
    flip, write, insert, delete, cut, repeat, move, number, number, number, word, word, lines,
)  # fmt: skip


def mutate(name: str, data: bytes, rng: Random) -> bytes:
    """A file mutated one to five times; a compressed one half of the time within."""
    inside = name.endswith(".gz") and rng.random() < 0.7
    if inside:
        data = gzip.decompress(data)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 5])):
        data = rng.choice(ALL)(data, rng)
    if name.endswith(".png") and rng.random() < 0.8:
        data = mend_png(data)
    return gzip.compress(data, mtime=0) if inside else data


def mend_png(data: bytes) -> bytes:
    """Make the checksums of a PNG right again, so that what they guard is looked at."""
    out, at = data[:8], 8
    while at + 8 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if end + 4 > len(data):
            return out + data[at:]
        out += data[at:end] + zlib.crc32(data[at + 4 : end]).to_bytes(4, "big")
        at = end + 4
    return out + data[at:]
