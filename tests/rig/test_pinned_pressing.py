"""What is beside a press, each worked out by hand: pulse, reference, compliance, the fit of the touch."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.devices.stage.base import StageError
from rig.devices.units import GWT_N
from rig.engine import Hold, Indentation, LimitError, PressId, RunAborted, Target, TripError, indent
from rig.engine.engine import State
from rig.engine.pressing.compliance import measure_compliance
from rig.engine.pressing.pulse import pulse
from rig.engine.pressing.reference import Reference
from rig.engine.pressing.touch_fit import fit_contact
from rig.engine.records import Purpose
from tests.rig.plain_bench import PlainBench

Floats = NDArray[np.float64]


def _bench(felt: Callable[[PlainBench], float] | None = None, settings: dict[str, Any] | None = None) -> PlainBench:
    return PlainBench(felt or (lambda bench: bench.hertz(6.0, -0.3)), settings or {})


# --- the pulse ---


def test_a_pulse_is_journalled_with_when_it_rose_and_how_well_that_is_known() -> None:
    """The stage takes 2 ms to switch: known to so much, and so much is added to the width of 10 ms."""
    bench = _bench(settings={"sync": {"output": "coolant"}})
    indent(bench.ready(), Target("doi_mm", 0.5), hold_s=0.1)
    pulses = bench.of("sync")
    assert [(p["index"], p["at"]) for p in pulses] == [(0, "touch"), (0, "hold_start"), (0, "hold_end")]
    assert [on for _, on in bench.stage.outputs] == [True, False] * 3
    assert [p["rise_s"] for p in pulses] == pytest.approx([t_s for t_s, on in bench.stage.outputs if on], abs=1e-6)
    assert [p["uncertainty_s"] for p in pulses] == pytest.approx([0.002] * 3, abs=1e-6)
    assert [p["width_s"] for p in pulses] == pytest.approx([0.012] * 3, abs=1e-6)


@pytest.mark.parametrize("broken", [True, False])
def test_an_output_that_fails_stops_the_stage(broken: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it is to rise or to fall."""

    def fails(on: bool) -> None:
        if on is broken:
            raise StageError("no output")

    bench = _bench(settings={"sync": {"output": "coolant"}})
    engine = bench.ready()
    monkeypatch.setattr(bench.stage, "set_output", fails)
    with pytest.raises(StageError, match="no output"):
        indent(engine, Target("doi_mm", 0.5), hold_s=0.1)
    assert engine.state is State.UNHOMED
    assert isinstance(engine.problem, StageError)


@pytest.mark.parametrize("purpose", ["data", "precondition", "reference", "find"])
@pytest.mark.parametrize("output", ["off", "coolant"])
def test_a_pulse_is_of_data_only_and_only_where_there_is_an_output(purpose: Purpose, output: str) -> None:
    bench = _bench(settings={"sync": {"output": output}})
    pulse(bench.ready(), PressId(0, purpose), "touch")
    assert bool(bench.of("sync")) == bool(bench.stage.outputs) == ((purpose, output) == ("data", "coolant"))


# --- the reference ---


def _found(*gwt: float) -> Indentation:
    return Indentation(7, 0.0, tuple(Hold(Target("doi_mm", 0.5), 0.5, force, 0.0) for force in gwt))


@pytest.mark.parametrize(
    ("now_gwt", "deviation", "alarm"),
    [
        ((2.0, 4.0), 0.0, None),
        ((2.28, 4.0), 0.14, None),
        ((2.0, 3.44), -0.14, None),
        ((2.32, 3.9), 0.16, "+16.0%"),
        ((2.1, 3.36), -0.16, "-16.0%"),
    ],
)
@pytest.mark.parametrize("resumed", [False, True])
def test_a_reference_is_compared_with_the_first_one(
    now_gwt: tuple[float, ...], deviation: float, alarm: str | None, resumed: bool
) -> None:
    """The hold that is farthest off counts, limits.reference_band = 0.15 is what it may be off by."""
    bench = _bench()
    reference = Reference([2.0, 4.0] if resumed else None)
    if not resumed:
        reference.compare(bench.engine, _found(2.0, 4.0))
        reference.compare(bench.engine, _found(2.2, 4.0))
    reference.compare(bench.engine, _found(*now_gwt))
    assert bench.of("reference")[-1] == {"index": 7, "deviation": pytest.approx(deviation, abs=1e-6)}
    said = [event["reason"] for event in bench.of("alarm")]
    assert said == ([f"reference 7 is off by {alarm}, limits.reference_band = 0.15"] if alarm else [])


def test_a_deviation_is_journalled_to_a_millionth_and_may_be_as_wide_as_the_band() -> None:
    bench = _bench(settings={"limits": {"reference_band": 0.125}})
    reference = Reference([3.0])
    reference.compare(bench.engine, _found(3.1))
    reference.compare(bench.engine, _found(3.375))
    assert [event["deviation"] for event in bench.of("reference")] == [0.033333, 0.125]
    assert not bench.of("alarm")


# --- the compliance ---

PER_STEP_N = 0.05  # of a rig of 0.05 mm/N under a step of 0.0025 mm


def _block(
    off_n: Callable[[int], float] = lambda step: 0.0,
    top_mm: float = 0.1,
    settings: dict[str, Any] | None = None,
) -> PlainBench:
    def felt(bench: PlainBench) -> float:
        steps = round((top_mm - bench.height_mm) / 0.0025)
        return (steps * PER_STEP_N + off_n(steps)) / GWT_N if steps > 0 else 0.0

    bench = _bench(felt, settings)
    bench.ready()
    return bench


@pytest.mark.parametrize(("to_n", "readings"), [(0.94, 16), (0.44, 8), (0.69, 12)])
def test_the_compliance_is_a_line_through_what_is_at_least_a_fifth_of_the_force(to_n: float, readings: int) -> None:
    """19 steps of 0.05 N to 0.95 N, the first three below 0.19 N: n equal steps, the last where the force is reached.

    A step of the stage is known to 0.0025 mm / √12, and n of them with 0.05 N between them spread by
    0.05 N · √(n (n² - 1) / 12).
    """
    bench = _block()
    found = measure_compliance(bench.engine, to_n / GWT_N)
    n = readings
    assert found.readings == n
    assert found.mm_per_n == pytest.approx(0.05, rel=1e-5)
    assert found.sd_mm_per_n == pytest.approx(0.0025 / (0.05 * (n * (n * n - 1)) ** 0.5), rel=1e-4)
    assert bench.height_mm == pytest.approx(2.0)
    assert bench.engine.state is State.READY


def test_what_lies_off_the_line_makes_the_compliance_less_certain() -> None:
    """0.07, 0.08, 0.13 and 0.22 N after four steps.

    Σ (f - mean)² = 0.0141 N², Σ (f - mean) (h - mean) = -0.000625 N mm, Σ (h - mean)² =
    3.125e-5 mm², of which the line leaves 3.546e-6; √(3.546e-6 / 2) / √0.0141 mm/N.
    """
    bench = _block(lambda step: 0.02 * (1, 1, -1, -1)[step % 4])
    found = measure_compliance(bench.engine, 0.2 / GWT_N)
    assert found.mm_per_n == pytest.approx(0.000625 / 0.0141, rel=1e-4)
    assert found.sd_mm_per_n == pytest.approx(0.011214, rel=1e-3)


@pytest.mark.parametrize(("to_n", "readings"), [(0.19, 4), (0.14, 3)])
def test_the_compliance_takes_four_steps_within_the_force(to_n: float, readings: int) -> None:
    bench = _block()
    if readings >= 4:
        assert measure_compliance(bench.engine, to_n / GWT_N).readings == readings
    else:
        with pytest.raises(LimitError, match=r"^3 steps of 0\.0025 mm within the force, expected 4"):
            measure_compliance(bench.engine, to_n / GWT_N)
    assert bench.height_mm == pytest.approx(2.0)


def test_a_block_is_come_to_by_increments_and_looked_for_as_far_as_a_finger() -> None:
    """limits.search_mm above and below where it should be; single steps in between."""
    bench = _block(top_mm=-3.0, settings={"limits": {"search_mm": 0.481}})
    with pytest.raises(TripError, match=r"no block down to -0\.481 mm from the nominal apex"):
        measure_compliance(bench.engine, 5.0)
    heights = [height for height, _ in bench.readings("compliance")]
    assert heights[:31] == pytest.approx([2.0 - 0.05 * k for k in range(1, 32)])
    assert heights[31:] == pytest.approx([0.45 - 0.0025 * k for k in range(1, 373)])


def test_a_soft_thing_gives_a_compliance_below_one_gwt_too() -> None:
    """0.15 gwt a step of 0.0025 mm: six of them to 0.9 gwt."""
    bench = _bench(lambda bench: 0.15 * max(round((0.1 - bench.height_mm) / 0.0025), 0))
    found = measure_compliance(bench.ready(), 0.88)
    assert found.readings == 5
    assert found.mm_per_n == pytest.approx(0.0025 / (0.15 * GWT_N), rel=1e-4)


def test_an_operator_stops_it_between_two_steps() -> None:
    bench = _block()
    bench.goes_on = False
    bench.wants_pause = lambda: len(bench.readings("compliance")) >= 40
    with pytest.raises(RunAborted, match="the indentor is lifted"):
        measure_compliance(bench.engine, 50.0)
    assert len(bench.readings("compliance")) == 40
    assert bench.height_mm == pytest.approx(2.0)


# --- the touch ---


@pytest.mark.parametrize("step_mm", [0.01, 0.05])
@pytest.mark.parametrize("above", [1, 2, 3, 10, 100])
@pytest.mark.parametrize("inside", [0.3, 0.9])
@pytest.mark.parametrize("points", [2, 5])
def test_contact_on_the_law_is_found_however_long_the_descent(
    step_mm: float, above: int, inside: float, points: int
) -> None:
    """So many readings above contact, which lies so much of an increment above the next one."""
    heights = [1.0 - step_mm * k for k in range(above + points)]
    contact_mm = heights[above] + inside * step_mm
    readings = [(height, 6.0 * max(contact_mm - height, 0.0) ** 1.5) for height in heights]
    touch = fit_contact(readings, 0.05, 1e-9)
    assert touch.contact_height_mm == pytest.approx(contact_mm, abs=1e-6)
    assert touch.fit_points == points


@pytest.mark.parametrize(
    ("gwt", "points"), [((0.0, 0.004, 0.05), 1), ((0.0, 0.006, 0.05), 2), ((0.006, 0.007, 0.008, 0.05), 4)]
)
def test_a_reading_counts_from_half_a_step_of_the_sensor_on(gwt: tuple[float, ...], points: int) -> None:
    readings = [(-0.01 * k, force) for k, force in enumerate(gwt)]
    touch = fit_contact(readings, 0.05, 0.01)
    assert (touch.fit_points, touch.force_gwt) == (points, gwt[-1])
    assert (touch.contact_height_mm == readings[-1][0]) == (points < 2)
    assert np.isfinite(touch.contact_height_mm)


def test_a_lone_force_has_contact_in_the_last_increment() -> None:
    """Twenty readings of nothing, one of them lifted by noise."""
    readings = [(-0.01 * k, 0.02 * (k == 5) + 0.06 * (k == 20)) for k in range(21)]
    assert -0.2 < fit_contact(readings, 0.05, 0.01).contact_height_mm < -0.19


def test_a_descent_that_begins_in_contact_has_it_at_its_top() -> None:
    readings = [(-0.01 * k, 6.0 * (0.02 + 0.01 * k) ** 1.5) for k in range(5)]
    assert -1e-6 < fit_contact(readings, 0.05, 0.01).contact_height_mm <= 0.0


def test_no_other_contact_fits_a_noisy_descent_better() -> None:
    """Of a hundred and fifty heights, each with the stiffness that is best for it; 50 descents."""
    chance = np.random.default_rng(3)
    for _ in range(50):
        contact_mm, noise_gwt = chance.uniform(-0.02, 0.02), chance.choice([0.005, 0.02, 0.04])
        height = 0.1 - 0.01 * np.arange(100)
        force = 6.0 * np.maximum(contact_mm - height, 0.0) ** 1.5 + chance.normal(0.0, noise_gwt, 100)
        end = int(np.argmax(force >= max(0.05, 6 * noise_gwt))) + 1
        height, force = height[:end], np.round(force[:end], 2)
        found = fit_contact(list(zip(height, force, strict=True)), 0.05, 0.01)
        if found.fit_points > 1:
            others = np.linspace(height[-1], height[0], 150)[1:]
            assert _misfit(found.contact_height_mm, height, force) < 1.0001 * min(
                _misfit(other, height, force) for other in others
            )


def _misfit(contact_mm: float, height_mm: Floats, force_gwt: Floats) -> float:
    law = np.maximum(contact_mm - height_mm, 0.0)[:, None] ** 1.5
    (left,) = np.linalg.lstsq(law, force_gwt, rcond=None)[1]
    return float(left) + 1e-12
