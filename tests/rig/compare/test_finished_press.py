"""A press is finished when its last hold has ended: every reader of a run counts the same presses."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.compare.recordings.spike_times import SpikeTimes
from rig.compare.recordings.spikes import rates_in_run
from rig.compare.stimuli import pressed
from rig.data import Run, read_run
from rig.data.deviation import deviations
from rig.data.export import _add_presses
from rig.data.presses import presses
from rig.report import nerve_figures
from rig.report.run_tables import phases


class Trials(list[Any]):
    """Trials of an NWB file."""

    def add_trial(self, **times: float) -> None:
        assert times["start_time"] < times["stop_time"]
        self.append(times)

    def add_trial_column(self, *_: Any, **__: Any) -> None:
        """Take a column of the trials."""


def trials(run: Run) -> int:
    file = Trials()
    _add_presses(run, file)
    return len(file)


def pressed_at(run: Run) -> int:
    places = [x for one in pressed(run, (0.0,)) for x in one.x_mm]
    return len(places) + 1  # two presses are at 0.1 mm


def divided_by(run: Run) -> int:
    return next(round(one.seconds / one.each_s) for one in phases(run))


def counted(run: Run) -> int:
    found = rates_in_run(run, "bar:3", SpikeTimes(np.array([1.0])), "unit7.csv", (0.1, 0.5))
    assert found.spikes is not None
    return found.spikes.presses


READERS: dict[str, Callable[[Run], int]] = {
    "show and resume": lambda run: len(run.done),
    "terminal, watch and panel": lambda run: len(run.state.finished),
    "presses.csv": lambda run: sum(one.complete for one in presses(run)),
    "measured beside predicted": lambda run: len(deviations(run)),
    "simulated responses": pressed_at,
    "spike times": counted,
    "responses of afferents": lambda run: len(nerve_figures.pressed(run)),
    "phases": divided_by,
    "NWB": trials,
}


@pytest.mark.parametrize("end", ["hold_end", "indentation_end"])
@pytest.mark.parametrize("reader", READERS)
def test_a_run_that_was_killed_after_its_last_hold_has_all_presses(
    reader: str, end: str, bar_run: Run, tmp_path: Path
) -> None:
    folder = tmp_path / bar_run.folder.path.name
    shutil.copytree(bar_run.folder.path, folder)
    lines = (folder / "events.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    last = max(n for n, line in enumerate(lines) if f'"stream": "{end}",' in line and '"event"' in line)
    (folder / "events.jsonl").write_text("".join(lines[: last + 1]), encoding="utf-8")
    assert READERS[reader](read_run(folder)) == 6
