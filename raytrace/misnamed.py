"""Files whose content does not match their name: Git LFS pointers, HTML pages, UTF-16 text."""

import re

POINTER = b"version https://git-lfs.github.com/spec/"
UTF16 = b"\xff\xfe", b"\xfe\xff"  # byte order marks
PAGE = re.compile(rb"\s*<(?:!doctype html|html)\b", re.IGNORECASE)
BEGIN = 8  # bytes
ENCODED = "UTF-16 text; save it as UTF-8"


def mistaken(data: bytes) -> str:
    r"""Say what a file with a wrong name contains, and what to do; "" if nothing wrong is found.

    Parameters
    ----------
    data : bytes
        The content of the file, or at least its first 100 bytes.

    Examples
    --------
    >>> mistaken(b"version https://git-lfs.github.com/spec/v1\noid sha256:00")
    'a Git LFS pointer; fetch the file: git lfs pull'
    >>> mistaken(b"v 0 0 0")
    ''
    """
    if data.startswith(POINTER):
        return "a Git LFS pointer; fetch the file: git lfs pull"
    if PAGE.match(data[:100]):
        return "an HTML page; fetch the file itself"
    return ""


def is_utf16(data: bytes) -> bool:
    r"""Whether a text is in UTF-16 (or UTF-32): it has a byte order mark, or every other byte is zero.

    >>> is_utf16("ply\n".encode("utf-16")), is_utf16("ply\nform".encode("utf-16-le")), is_utf16(b"ply\n")
    (True, True, False)
    """
    if data[:2] in UTF16:
        return True
    for first in (0, 1):
        letters, zeros = data[first:BEGIN:2], data[1 - first : BEGIN : 2]
        if len(zeros) == BEGIN // 2 and not zeros.strip(b"\0") and 0 not in letters and letters.isascii():
            return True
    return False
