"""docs/rays.md: its programs run, in one space, and print what the comments say."""

import contextlib
import io
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^<!-- tested: rays -->\n```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PRINTED = re.compile(r"^print\(.*\) +# (.*)$", re.MULTILINE)


def test_the_programs_of_the_page_print_what_it_says(monkeypatch):
    monkeypatch.chdir(ROOT)
    text = (ROOT / "docs" / "rays.md").read_text("utf-8")
    programs = BLOCK.findall(text)
    assert len(programs) == text.count("```python") > 10
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec("\n".join(programs), {})
    expected = PRINTED.findall("\n".join(programs))
    assert len(expected) == sum(program.count("print(") for program in programs)
    assert out.getvalue().splitlines() == expected
