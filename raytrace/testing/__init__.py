"""Statistical tests of samplers, estimators and scattering functions, for anyone's pytest.

Each test returns a record of numbers, and raises ``StatisticalError``, an AssertionError, where a hypothesis is
rejected. Random numbers are functions of ``seed``: a test gives the same answer every time.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from raytrace.testing.charts import Chart
    from raytrace.testing.distributions import sidak
    from raytrace.testing.estimators import TTest, t_test
    from raytrace.testing.furnaces import Furnace, furnace
    from raytrace.testing.outcome import StatisticalError
    from raytrace.testing.samplers import ChiSquare, chi_square

_HOME = {
    "Chart": "charts",
    "ChiSquare": "samplers",
    "Furnace": "furnaces",
    "StatisticalError": "outcome",
    "TTest": "estimators",
    "chi_square": "samplers",
    "furnace": "furnaces",
    "sidak": "distributions",
    "t_test": "estimators",
}

__all__ = ["Chart", "ChiSquare", "Furnace", "StatisticalError", "TTest", "chi_square", "furnace", "sidak", "t_test"]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
