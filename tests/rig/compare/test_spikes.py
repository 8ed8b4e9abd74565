"""Spike times and a run: rates in a window from the start of the holds."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.spike_times import SpikeTimes
from rig.compare.recordings.spikes import rates_in_run, read_spike_times
from rig.data import Run
from tests.error_codes import raises


def spikes_at(run: Run, index: int, hold: int, offsets_s: list[float]) -> list[float]:
    start = next(e["t_s"] for e in run.stream("hold_start") if (e["index"], e["hold"]) == (index, hold))
    return [start + offset for offset in offsets_s]


def test_rates_are_counted_in_the_window_of_the_last_holds(bar_run: Run) -> None:
    # Presses 0 … 5 at x = 0.8, 0.4, 0.1, −0.2, −0.6 and 0.1 again, two holds each; a window of 0.1 … 0.5 s.
    times = [
        *spikes_at(bar_run, 0, 2, [0.05, 0.1, 0.2, 0.49, 0.51]),  # three of them inside
        *spikes_at(bar_run, 0, 1, [0.2, 0.3]),  # the first increment does not count
        *spikes_at(bar_run, 2, 2, [0.3]),
        *spikes_at(bar_run, 5, 2, [0.2, 0.3, 0.4]),
    ]
    found = rates_in_run(bar_run, "bar:3", SpikeTimes(np.sort(times)), "unit7.csv", (0.1, 0.5), centre_mm=0.1)
    np.testing.assert_allclose(found.position_mm, [-0.7, -0.3, 0.0, 0.3, 0.7], atol=1e-12)
    np.testing.assert_allclose(found.rate, [0, 0, 0.5 * (1 + 3) / 0.4, 0, 3 / 0.4])
    assert found.sd[2] == pytest.approx(np.std([1 / 0.4, 3 / 0.4], ddof=1))
    assert np.isnan(found.sd[0])  # once only
    assert found.window_s == pytest.approx(0.4)


def test_a_window_longer_than_the_holds_is_refused(bar_run: Run) -> None:
    with raises(RecordingError, "window_beyond_hold", begin_s=0.0, end_s=2.0, x_mm=0.8) as caught:
        rates_in_run(bar_run, "bar:3.0", SpikeTimes(np.array([])), "unit7.csv", (0.0, 2.0))
    lasts_s = float(str(caught.value).split()[-2])
    assert 0 < lasts_s < 1
    with raises(RecordingError, "no_window", begin_s=0.5, end_s=0.5):
        rates_in_run(bar_run, "bar:3.0", SpikeTimes(np.array([])), "unit7.csv", (0.5, 0.5))
    with raises(RecordingError, "never_pressed", file="unit7.csv", run=bar_run.folder.path.name, shape="step:1"):
        rates_in_run(bar_run, "step:1", SpikeTimes(np.array([])), "unit7.csv", (0.0, 0.4))


def with_pulses(run: Run, rise_s: list[float]) -> Run:
    return replace(run, events={**run.events, "sync": [{"t_s": t, "rise_s": t} for t in rise_s]})


def test_milliseconds_that_are_called_seconds_are_refused(tmp_path: Path, bar_run: Run) -> None:
    """The first spikes lie in the run even so; the rates would be zeros."""
    run = replace(bar_run, end_s=700.0)
    path = tmp_path / "ms.csv"
    times_ms = np.r_[350.0, np.linspace(5e3, 695e3, 60)]
    path.write_text("time_s\n" + "".join(f"{t}\n" for t in times_ms), encoding="utf-8")
    with raises(RecordingError, "outside_run", inside=1, spikes=61, end_s=700.0):
        read_spike_times(path, run)
    path.write_text(path.read_text(encoding="utf-8").replace("time_s", "t"), encoding="utf-8")
    found = read_spike_times(path, run, columns=column_map(["time=t:ms"]))
    np.testing.assert_allclose(found.spike_s, times_ms / 1e3)


@pytest.mark.parametrize("times_s", [[743.2, 760.5], [-5.0, -1.0]])
def test_spikes_outside_the_run_are_on_another_clock(tmp_path: Path, bar_run: Run, times_s: list[float]) -> None:
    """As those that were aligned to a journal whose times count from the boot of the computer."""
    path = tmp_path / "spikes.csv"
    path.write_text("time_s\n" + "".join(f"{t}\n" for t in times_s), encoding="utf-8")
    first_s, last_s = times_s
    run = replace(bar_run, end_s=700.0)
    with raises(RecordingError, "outside_run", path=str(path), first_s=first_s, last_s=last_s, end_s=700.0):
        read_spike_times(path, run)


def test_sync_pulses_align_the_clocks(tmp_path: Path, bar_run: Run) -> None:
    """The amplifier's clock started 100 s earlier and runs 50 ppm fast."""
    path = tmp_path / "unit7.csv"
    rises = [10.0, 20.0, 40.0]
    seen = [100 + 1.00005 * t for t in rises]
    rows = [f"{t:.9f},sync" for t in seen] + [f"{100 + 1.00005 * 25.0:.9f},spike"]
    path.write_text("time_s,kind\n" + "\n".join(rows), encoding="utf-8")
    np.testing.assert_allclose(read_spike_times(path, with_pulses(bar_run, rises)).spike_s, [25.0], atol=1e-7)
    with raises(RecordingError, "number_of_pulses", path=str(path), pulses=3, journalled=2):
        read_spike_times(path, with_pulses(bar_run, rises[:2]))
    with raises(RecordingError, "pulses_apart", path=str(path), most_ms=5.0) as caught:
        read_spike_times(path, with_pulses(bar_run, [10.0, 20.1, 40.0]))
    worst_ms = re.search(r"by up to ([\d.]+) ms", str(caught.value))
    assert worst_ms is not None
    assert 5 < float(worst_ms[1]) < 100


def test_one_pulse_gives_the_offset(tmp_path: Path, bar_run: Run) -> None:
    path = tmp_path / "unit7.csv"
    path.write_text("time_s,kind\n110.0,sync\n112.5,spike\n", encoding="utf-8")
    np.testing.assert_allclose(read_spike_times(path, with_pulses(bar_run, [10.0])).spike_s, [12.5])


def pressed_to(run: Run, values: dict[int, float]) -> Run:
    """The same run, some of its indentations commanded to other depths."""
    starts = [{**e, "value": values.get(e["index"], e["value"])} for e in run.stream("indentation_start")]
    return replace(run, events={**run.events, "indentation_start": starts})


def test_a_shape_that_was_pressed_to_two_depths_needs_one(bar_run: Run) -> None:
    both = pressed_to(bar_run, {0: 0.2, 3: 0.2, 4: 0.2})
    with raises(
        RecordingError, "several_conditions", file="u.csv", shape="bar:3.0", conditions="0.2 mm and 0.4 mm",
        first="0.2 mm",
    ):  # fmt: skip
        rates_in_run(both, "bar:3.0", SpikeTimes(np.array([])), "u.csv", (0.0, 0.4))
    low = rates_in_run(both, "bar:3.0@0.2mm", SpikeTimes(np.array([])), "u.csv", (0.0, 0.4))
    np.testing.assert_allclose(low.position_mm, [-0.6, -0.2, 0.8])
    high = rates_in_run(both, "bar:3@0.4 mm", SpikeTimes(np.array([])), "u.csv", (0.0, 0.4))
    np.testing.assert_allclose(high.position_mm, [0.1, 0.4])
    with raises(RecordingError, "never_pressed", shape="bar:3@8gwt"):
        rates_in_run(both, "bar:3@8gwt", SpikeTimes(np.array([])), "u.csv", (0.0, 0.4))
