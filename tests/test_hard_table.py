import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

import raytrace as rt
from raytrace.hardcases.rays import cases
from raytrace.hardcases.shadows import shadow_cases
from raytrace.hardcases.suite import Outcome, Score
from raytrace.hardcases.table import (
    EXTREME,
    KINDS,
    as_json,
    failures_table,
    kinds_table,
    markdown,
    moderate,
    text,
    text_table,
    totals_table,
    write,
)
from raytrace.output_folder import check_folder

NAN = float("nan")


@pytest.fixture
def outcome():
    """Two cases and two tracers, one of which was not asked for the first."""
    ours, other = (
        SimpleNamespace(name=name, version=version, dtype=np.dtype("f4"), exact=name == "ours")
        for name, version in (("ours", "1.0"), ("other", "2.0"))
    )
    first, second = next(cases()), next(shadow_cases())
    scores = {
        (first.name, "ours"): Score(100, 0, 0, 0, 0, 1.25e-7, 2.5e-7),
        (second.name, "ours"): Score(50, 0, 0, 0, 0, NAN, NAN),
        (second.name, "other"): Score(50, 0, 0, 7, 2, NAN, NAN),
    }
    return Outcome((first, second), (ours, other), scores, {"a third": "No module named 'third'"})


def test_failures_stand_by_case_and_tracer(outcome):
    assert failures_table(outcome) == [
        ["", "rays", "ours", "other"],
        ["cube, from inside", "100", "0", "-"],
        ["lit floor, scale 1e-12", "50", "0", "7s 2t"],
    ]


def test_kinds_add_up_their_cases(outcome):
    assert kinds_table(outcome) == [
        ["", "rays", "ours", "other"],
        ["closed meshes from inside, at edges and vertices", "100", "0", "-"],
        ["shadow rays from lit floors and spheres", "50", "0", "7s 2t"],
    ]


def test_every_case_is_of_one_kind():
    for case in (*cases(), *shadow_cases()):
        assert sum(bool(re.search(pattern, case.name)) for pattern in KINDS.values()) == 1, case.name


def test_totals_leave_out_what_only_extreme_input_explains(outcome):
    assert [case.name for case in moderate(outcome).cases] == ["cube, from inside"]
    (ours, other) = totals_table(moderate(outcome))[1:]
    assert (ours[1], other[1]) == ("100", "0")
    suite = [case.name for case in (*cases(), *shadow_cases())]
    left_out = {name for name in suite if re.search(EXTREME, name)}
    assert {
        "scale 1e-06",
        "translation 1e+07, size 1e+03",
        "origins 1e+09 away",
        "lit floor, moved by 1e+06",
    } <= left_out
    assert not left_out & {
        "scale 1e+03",
        "slivers 1e+09, flat",
        "grazing 1e-7, flat",
        "translation 1e+05",
        "huge beside tiny",
    }
    assert len(left_out) < len(suite) / 2


def test_terminals_get_failures_totals_and_who_is_missing(outcome):
    shown = text(outcome)
    lines = shown.splitlines()
    assert lines[1].split() == ["cube,", "from", "inside", "100", "0", "-"]
    assert any(line.split() == ["ours", "(1.0)", "150", "0", "0", "0", "0", "1.2e-07", "2.5e-07"] for line in lines)
    assert any(line.split() == ["other", "(2.0)", "50", "0", "0", "7", "2", "-", "-"] for line in lines)
    assert "32 eps x distance" in shown
    assert "Not run: a third: No module named 'third'" in shown
    assert max(map(len, lines)) <= 120


def test_columns_line_up():
    rows = [["", "n"], ["a long name", "1"], ["b", "1000"]]
    assert text_table(rows) == "                n\na long name     1\nb            1000"
    assert text_table(rows, markdown=True).splitlines() == [
        "|             |    n |",
        "| ----------- | ---: |",
        "| a long name |    1 |",
        "| b           | 1000 |",
    ]


def test_the_page_holds_every_number(outcome):
    page = markdown(outcome)
    assert page.count("\n## ") == 4
    assert "| lit floor, scale 1e-12 |" in page
    assert "1.2e-07 / 2.5e-07" in page
    assert page.endswith("|\n")


def test_json_is_strict_versioned_and_complete(outcome):
    told = json.loads(json.dumps(as_json(outcome), allow_nan=False))
    assert told["schema"] == "raytrace.hard-cases/1"
    assert told["raytrace"] == rt.__version__
    assert told["missing"] == {"a third": "No module named 'third'"}
    assert [tracer["name"] for tracer in told["tracers"]] == ["ours", "other"]
    first, second = told["cases"]
    assert first["seed"] == 10
    assert first["must"]
    assert list(first["scores"]) == ["ours"]
    assert first["scores"]["ours"]["t_error"] == 1.25e-7
    assert second["scores"]["other"] == {
        "rays": 50, "wrong": 0, "leaks": 0, "self_shadows": 7, "light_leaks": 2, "t_error": None, "uv_error": None,
    }  # fmt: skip


def test_both_files_are_written_whole(outcome, tmp_path):
    paths = write(outcome, tmp_path)
    assert [path.name for path in paths] == ["hard-cases.json", "hard-cases.md"]
    assert sorted(tmp_path.iterdir()) == list(paths)
    assert json.loads(paths[0].read_text("utf-8")) == json.loads(json.dumps(as_json(outcome)))
    assert paths[1].read_text("utf-8") == markdown(outcome)
    write(outcome, tmp_path)  # again, over the first
    assert sorted(tmp_path.iterdir()) == list(paths)


def test_a_folder_is_made_or_refused_in_a_line(tmp_path):
    check_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(rt.FileError, match="can't be made") as error:
            check_folder(path)
        assert "\n" not in str(error.value)
