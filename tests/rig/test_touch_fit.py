"""Contact fitted to the readings of a touch-off."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.engine.contact_fit import fit_contact

THRESHOLD_GWT = 0.05
STEP_MM = 0.01


def _readings(contact_mm: float, k_gwt: float, start_mm: float, division_gwt: float) -> list[tuple[float, float]]:
    """Down from start in touch increments until the threshold is read, on a balance with this division."""
    readings = []
    for n in range(1, 2000):
        height = round(start_mm - n * STEP_MM, 9)
        force = k_gwt * max(contact_mm - height, 0.0) ** 1.5
        shown = round(force / division_gwt) * division_gwt if division_gwt else force
        readings.append((height, shown))
        if shown >= THRESHOLD_GWT:
            return readings
    raise AssertionError("never touched")


@pytest.mark.parametrize(("k_gwt", "contact_mm"), [(6.0, -0.3), (2.0, 0.0), (9.0, 0.1234), (3.0, -1.987)])
def test_contact_fitted_to_readings_of_the_force_law_is_exact(k_gwt: float, contact_mm: float) -> None:
    readings = _readings(contact_mm, k_gwt, contact_mm + 0.1, 0.0)
    touch = fit_contact(readings, THRESHOLD_GWT, 0.01)
    assert touch.contact_height_mm == pytest.approx(contact_mm, abs=1e-9)
    assert touch.height_at_threshold_mm == readings[-1][0]
    assert touch.doi_bias_mm == pytest.approx(contact_mm - readings[-1][0], abs=1e-9)
    assert touch.threshold_gwt == THRESHOLD_GWT
    assert touch.fit_points >= 2


@given(
    contact_mm=st.floats(-2.0, 1.0),
    k_gwt=st.floats(0.5, 40.0),
    above_mm=st.floats(0.03, 0.2),
)
@settings(max_examples=30, deadline=None)
def test_the_fitted_contact_errs_by_at_most_the_hidden_depth_and_one_increment(
    contact_mm: float, k_gwt: float, above_mm: float
) -> None:
    readings = _readings(contact_mm, k_gwt, contact_mm + above_mm, 0.01)
    touch = fit_contact(readings, THRESHOLD_GWT, 0.01)
    # Half a division hides the contact until k d^1.5 reaches it; then up to one increment passes unread.
    hidden_mm = (0.005 / k_gwt) ** (2 / 3)
    assert abs(touch.contact_height_mm - contact_mm) <= hidden_mm + STEP_MM + 1e-9


@pytest.mark.parametrize("above_mm", [0.05, 0.1, 0.2])
def test_one_noisy_reading_moves_the_fitted_contact_by_less_than_an_increment(above_mm: float) -> None:
    """4 hundredths of a gram, far above contact: it moves what is found by less than an increment."""
    readings = _readings(-0.3, 6.0, 0.0, 0.01)
    n = next(n for n, (height, _) in enumerate(readings) if height < -0.3 + above_mm)
    readings[n] = (readings[n][0], 0.04)
    assert fit_contact(readings, THRESHOLD_GWT, 0.01).contact_height_mm == pytest.approx(-0.3, abs=STEP_MM)


@pytest.mark.parametrize(
    "readings",
    [
        [(1.0, 0.3)],
        [(1.0, 0.0), (0.99, 0.0), (0.98, 0.3)],
    ],
)
def test_contact_fitted_to_a_single_reading_is_its_height(readings: list[tuple[float, float]]) -> None:
    touch = fit_contact(readings, THRESHOLD_GWT, 0.01)
    assert touch.contact_height_mm == readings[-1][0]
    assert touch.doi_bias_mm == 0.0
    assert touch.fit_points == 1


@pytest.mark.parametrize("step_mm", [0.01, 0.05])
@pytest.mark.parametrize("above", [1, 100])
@pytest.mark.parametrize(("inside", "points"), [(0.3, 2), (0.9, 5)])
def test_the_fitted_contact_does_not_depend_on_the_length_of_the_descent(
    step_mm: float, above: int, inside: float, points: int
) -> None:
    """So many readings above contact, which lies so much of an increment above the next one."""
    heights = [1.0 - step_mm * k for k in range(above + points)]
    contact_mm = heights[above] + inside * step_mm
    readings = [(height, 6.0 * max(contact_mm - height, 0.0) ** 1.5) for height in heights]
    touch = fit_contact(readings, 0.05, 1e-9)
    assert touch.contact_height_mm == pytest.approx(contact_mm, abs=1e-6)
    assert touch.fit_points == points


def test_contact_of_a_descent_that_begins_in_contact_is_at_its_top() -> None:
    readings = [(-0.01 * k, 6.0 * (0.02 + 0.01 * k) ** 1.5) for k in range(5)]
    assert -1e-6 < fit_contact(readings, 0.05, 0.01).contact_height_mm <= 0.0
