"""Files whose content does not match their name: Git LFS pointers, HTML pages, UTF-16 text, meshes and images."""

import re

POINTER = b"version https://git-lfs.github.com/spec/"
UTF16 = b"\xff\xfe", b"\xfe\xff"  # byte order marks
PAGE = re.compile(rb"\s*<(?:!doctype html|html)\b", re.IGNORECASE)
BEGIN = 8  # bytes
ENCODED = "UTF-16 text; save it as UTF-8"
EXPECTED = "expected a scene (JSON) or a mesh"
FORMS = {  # the first bytes of other files, and what these are
    b"ply": "a PLY mesh; rename it to .ply",
    b"glTF": "a GLB mesh; rename it to .glb",
    b"solid": "an STL mesh; rename it to .stl",
    b"OFF": "an OFF mesh; rename it to .off",
    b"\x89PNG": f"a PNG image; {EXPECTED}",
    b"\xff\xd8\xff": f"a JPEG image; {EXPECTED}",
    b"\x76\x2f\x31\x01": f"an EXR image; {EXPECTED}",
    b"PK\x03\x04": f"a ZIP archive; {EXPECTED}",
    b"\x1f\x8b": "compressed by gzip; unpack it",
    b"%PDF": f"a PDF document; {EXPECTED}",
    b"<": f"XML, such as a scene of Mitsuba; {EXPECTED}",
}
OBJ = re.compile(rb"(?:\s|#[^\n]*\n)*(?:(?:v|vn|vt|f)(?:\s+[-\d./]+){2,}|(?:o|g|mtllib|usemtl)\s\S)")
PBRT = re.compile(rb"(?:\s|#[^\n]*\n)*(?:LookAt|Camera|Film|Sampler|Integrator|WorldBegin|Scale|Include)\s")


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


def other_than_scene(data: bytes) -> str:
    r"""Say what stands in place of a scene; "" if it may be one.

    Parameters
    ----------
    data : bytes
        The content of a file that is no JSON.

    Examples
    --------
    >>> other_than_scene(b"# a cube\nv 0 0 0\nv 0 0 1\n")
    'an OBJ mesh; rename it to .obj'
    >>> other_than_scene(b"{]")
    ''
    """
    for begin, what in FORMS.items():
        if data.startswith(begin):
            return what
    if len(data) > 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return FORMS[b"solid"]
    if OBJ.match(data):
        return "an OBJ mesh; rename it to .obj"
    return f"a scene of pbrt; {EXPECTED}" if PBRT.match(data) else ""


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
