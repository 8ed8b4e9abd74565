"""Figures of decoding: each line in them is one of the arrays that were given, where it was meant to be."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from rig.report.coding_figures import (
    DecodingPlot,
    ErrorSurface,
    decoded_figure,
    extents,
    search_figure,
)
from rig.report.style import Plot

Array = NDArray[np.float64]

PATH = np.array([[10.0, 10.0], [24.0, 10.0], [24.0, 11.0], [20.0, 14.0]])
TRUE = np.array([20.0, 14.0])


def drawn(plot: Plot) -> Figure:
    figure = Figure(plot.size)
    plot.draw(figure)
    return figure


def lines(axes: object) -> dict[str, Array]:
    """(2, n) what each line with a name shows."""
    return {line.get_label(): np.array(line.get_data(), dtype=float) for line in axes.get_lines()}  # type: ignore[attr-defined]


@pytest.fixture
def surface() -> ErrorSurface:
    values = np.linspace(0.0, 30.0, 7)
    return ErrorSurface(values, values[:5], (values[:, None] - 20) ** 2 + (values[:5] - 15) ** 2)


@pytest.mark.parametrize(("true", "away"), [(TRUE, [10.77, 5.657, 5.0, np.nan]), (None, [10.77, 5.657, 5.0, np.nan])])
def test_ways_over_the_error_surface(surface: ErrorSurface, true: Array | None, away: list[float]) -> None:
    figure = drawn(search_figure({"far": surface, "near": surface}, {"exact": PATH, "grid": PATH[:2]}, true))
    far, near, left = figure.axes
    for axes in (far, near):
        assert_allclose(lines(axes)["exact"], PATH.T)
        assert_allclose(lines(axes)["grid"], PATH[:2].T)
        assert axes.get_xlim() == (0, 30)
        assert axes.get_ylim() == (0, 20)
        stars = [line.get_xydata().tolist() for line in axes.get_lines() if line.get_marker() == "*"]
        assert stars == ([] if true is None else [[TRUE.tolist()]])
        ends = [line.get_xydata()[0].tolist() for line in axes.get_lines() if line.get_marker() == "s"]
        assert ends == [PATH[-1].tolist(), PATH[1].tolist()]
    assert (far.get_title(), near.get_title()) == ("far", "near")
    assert_allclose(lines(left)["exact"], [[1, 2, 3, 4], away], rtol=1e-3)
    assert lines(left)["grid"][1, 1] == pytest.approx(np.hypot(4, 4) if true is not None else np.nan, nan_ok=True)
    assert left.get_ylabel().endswith(
        " the end (pseudo-units)" if true is None else " the true pressures (pseudo-units)"
    )


def test_where_it_is_looked_at_closely() -> None:
    path = np.concatenate([PATH[:2], [[24.0 - 0.1 * k, 10.0 + 0.1 * k] for k in range(1, 41)]])
    valley, first = extents(path).values()
    # 15 % of the larger extent about each way; neither begins before the first move
    assert_allclose(valley, ([20 - 0.6, 10 - 0.6], [24 + 0.6, 14 + 0.6]))
    assert_allclose(first, ([22.8 - 0.18, 10 - 0.18], [24.18, 11.2 + 0.18]))
    still = np.array([[10.0, 10.0], [20.0, 5.0]])
    assert_allclose(extents(still)["valley"], ([20 - 0.003, 5 - 0.003], [20.003, 5.003]))


@pytest.mark.parametrize("known", [True, False])
def test_pressures_over_readings(known: bool) -> None:
    place, receptor = np.array([-1.0, 0.0, 1.0]), np.array([2.0, -2.0, 0.0])
    band = (np.zeros(3), np.full(3, 9.0)) if known else None
    true = np.full(3, 4.0) if known else None
    given = DecodingPlot(
        place, np.array([3.0, 5.0, 4.0]), band, true, receptor, np.array([1.0, 2.0, 3.0]), receptor**2
    )
    skin, energy = drawn(decoded_figure(given)).axes
    assert_allclose(lines(skin)["found"], [place, [3, 5, 4]])
    assert ("true" in lines(skin)) is known
    assert len(skin.collections) == known
    assert_allclose(lines(energy)["readings"], [[-2, 0, 2], [2, 3, 1]])
    assert_allclose(lines(energy)["explained"], [[-2, 0, 2], [4, 0, 4]])
