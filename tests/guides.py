"""The code of the guides docs/add-a-*.md: files, and edits of files that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
GUIDES = "add-a-material", "add-a-pass"
BLOCK = re.compile(r"^<!-- (file|edit): (\S+) -->\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def changed_files(guide: str, root: Path = ROOT) -> dict[str, str]:
    """Path -> text of each file that a guide writes or edits. An edit that does not fit is a ValueError."""
    found: dict[str, str] = {}
    for what, path, code in BLOCK.findall((root / "docs" / f"{guide}.md").read_text("utf-8")):
        if what == "file":
            found[path] = code
            continue
        text = found.get(path) or (root / path).read_text("utf-8")
        for hunk in re.split(r"^@@\n", code, flags=re.MULTILINE):
            lines = hunk.splitlines()
            old = "\n".join(line[1:] for line in lines if line[:1] != "+")
            new = "\n".join(line[1:] for line in lines if line[:1] != "-")
            if text.count(old) != 1:
                raise ValueError(f"{guide}.md: {path} has {text.count(old)} places that look like:\n{old}")
            text = text.replace(old, new)
        found[path] = text
    return found
