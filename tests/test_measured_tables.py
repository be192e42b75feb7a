"""Tables and plots of measurements in docs/benchmarks.md: both come from the same file."""

import copy
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WAYS = {"sobol, float32": (1, 16, 64, 256), "Mitsuba orthogonal, float32": (1, 25, 121, 289)}


@pytest.fixture
def plots(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "pictures")
    monkeypatch.delitem(sys.modules, "plots", raising=False)
    import plots

    return plots


def test_the_page_has_the_tables_of_the_measured_files(plots):
    text = plots.PAGE.read_text("utf-8")
    assert text == plots.filled(text), "out of date: run python docs/pictures/plots.py"
    assert set(re.findall(r"<!-- measured: (\w+) -->", text)) == set(plots.BLOCKS)
    assert "](pictures/growth.png)" in text


def test_a_table_follows_its_file(plots, tmp_path):
    content = json.loads((plots.MEASURED / "growth.json").read_text("utf-8"))
    changed = copy.deepcopy(content)
    changed["results"][1]["ns_per_ray"]["raytrace"] = 1234.5
    (tmp_path / "growth.json").write_text(json.dumps(changed))
    text = plots.filled(plots.PAGE.read_text("utf-8"), tmp_path)
    assert re.search(rf"\| {changed['results'][1]['triangles']:,} \| [^|]* \| 1234 \|", text)
    with pytest.raises(ValueError, match="no block 'growth'"):
        plots.filled("", tmp_path)


def test_tables_of_errors_have_counts_slopes_and_ratios(plots):
    points = [
        {"way": {"name": name, "adaptive": False}, "spp": spp, "rmse_srgb": 0.1 / spp, "seconds": spp}
        for name, counts in WAYS.items()
        for spp in counts
    ]
    row = {"error": 4e-4, "peer": "Mitsuba multijitter", "peer s": 0.0891, "uniform s": 0.0511, "adaptive s": 0.0252}
    row |= {"peer spp": 62.0, "uniform spp": 54.2, "adaptive spp": float("nan")}
    row |= {"peer / adaptive": 3.54, "peer / uniform": 1.74, "uniform / adaptive": float("nan")}
    results = {"cornell-box": {"points": points, "ratios": [row]}}
    errors = plots.errors_table(results).splitlines()
    assert errors[2] == "| `sobol` | 6.25e-3 | 1.56e-3 | 3.91e-4 | -1.00 | -1.00 |"
    assert errors[3] == "| Mitsuba `orthogonal` (25, 121, 289 spp) | 4.00e-3 | 8.26e-4 | 3.46e-4 | -1.00 | -1.00 |"
    times = plots.times_table(results).splitlines()
    assert times[0].startswith("| error | Mitsuba, its best sampler | `sobol` | adaptive |")
    assert times[2] == "| 4e-4 | `multijitter`, 0.089 s, 62 spp | 0.051 s, 54.2 spp | - | 3.5 | 1.7 | - |"
