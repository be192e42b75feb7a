"""The site's style: pages fit windows of any width."""

import re
from pathlib import Path

CSS = (Path(__file__).parents[1] / "docs" / "_static" / "site.css").read_text("utf-8")
SIDES = 2 * 15.0  # em: the theme's least widths of its two side bars
BLOCK = re.compile(r"@media \(min-width: (\d+)em\) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
WIDTH = re.compile(r"\.content \{[^}]*?width: (\d+)em")


def test_a_page_is_only_wider_than_the_theme_has_it_where_the_window_has_room():
    assert not WIDTH.search(BLOCK.sub("", CSS))
    wider = [(float(window), float(width)) for window, block in BLOCK.findall(CSS) for width in WIDTH.findall(block)]
    assert wider
    assert all(width + SIDES < window for window, width in wider)


def test_wide_equations_scroll_instead_of_being_cut_off():
    (rule,) = re.findall(r"^[^\n{]*div\.math\b[^{]*\{([^}]*)\}", CSS, re.MULTILINE)
    assert "overflow-x: auto" in rule
    assert "max-width: 100%" in rule
