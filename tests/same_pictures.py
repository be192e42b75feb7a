"""Two pictures are the same: every bit of what they show and know."""


def assert_same(picture, other):
    assert picture.complete
    assert other.complete
    assert picture.rgb.tobytes() == other.rgb.tobytes()
    assert picture.stderr.tobytes() == other.stderr.tobytes()
    assert picture.var.tobytes() == other.var.tobytes()
    assert picture.aov["samples"].tobytes() == other.aov["samples"].tobytes()
    for name in ("estimated_error", "estimated_error_linear", "samples", "target_reached"):
        assert picture.stats[name] == other.stats[name]
