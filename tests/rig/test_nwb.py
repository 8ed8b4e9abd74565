"""A run as NWB, checked by pynwb's validator and nwbinspector, and spike times read from one."""

import sys
from dataclasses import replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.data import NwbMissingError, Run, export_nwb, read_run
from rig.engine import Target, indent, verbs
from rig.units import GWT_N
from tests.error_codes import raises

pytestmark = pytest.mark.skipif(find_spec("pynwb") is None, reason="needs pynwb: pip install 'indentation-rig[nwb]'")
pynwb: Any = None


@pytest.fixture(scope="module", autouse=True)
def _imported() -> None:
    """For the tests alone: it takes a second and more, in every process that collects them."""
    global pynwb
    import pynwb


@pytest.fixture
def run(spring: Any, tmp_path: Path) -> Run:
    """Two indentations on the spring bench."""
    bench = spring()
    bench.journal.start({"protocol": "two", "title": "Two presses", "source": "a notebook", "virtual": True,
                         "planned_indentations": 2, "parameters": {}})  # fmt: skip
    engine = bench.ready()

    for x_mm in (0.0, 0.4):
        verbs.move_to(engine, x_mm)
        indent(engine, Target("force_gwt", 2.0), hold_s=0.3)
    bench.journal.stop("done")
    return read_run(bench.journal_path.parent)


def test_an_nwb_file_holds_the_presses_and_times_of_the_journal(run: Run) -> None:
    path = export_nwb(run)
    assert path == run.folder.path / "run.nwb"
    assert not list(run.folder.path.glob("*.part*"))
    with pynwb.NWBHDF5IO(path, "r") as io:
        file = io.read()
        samples = run.stream("sample")
        force = file.acquisition["force"]
        np.testing.assert_array_equal(force.data[:], [sample["force_gwt"] for sample in samples])
        assert (force.unit, force.conversion) == ("newtons", GWT_N)
        np.testing.assert_array_equal(force.timestamps[:], [sample["t_s"] for sample in samples])
        position = file.acquisition["position"]
        np.testing.assert_array_equal(position.data[:, 1], [sample["height_mm"] for sample in samples])
        np.testing.assert_array_equal(position.data[:, 0], [sample["x_mm"] for sample in samples])
        assert (position.unit, position.conversion) == ("meters", 1e-3)
        trials = file.trials.to_dataframe()
        assert trials["x_mm"].tolist() == [0.0, 0.4]
        assert trials["indentor"].tolist() == ["bar:3.0", "bar:3.0"]
        holds = file.intervals["holds"].to_dataframe()
        ends = run.stream("hold_end")
        assert holds["stop_time"].tolist() == [end["t_s"] for end in ends]
        assert holds["force_gwt"].tolist() == [end["force_gwt"] for end in ends]
        assert file.session_start_time == datetime.fromtimestamp(run.start["unix_s"] - run.start["t_s"], UTC)


def test_an_nwb_file_holds_sync_pulses_as_intervals(run: Run) -> None:
    pulses = [{"t_s": t, "rise_s": t, "width_s": 0.25, "uncertainty_s": 0.001} for t in (1.5, 4.0)]
    path = export_nwb(replace(run, events={**run.events, "sync": pulses}))
    with pynwb.NWBHDF5IO(path, "r") as io:
        seen = io.read().intervals["sync_pulses"].to_dataframe()
        assert seen["start_time"].tolist() == [1.5, 4.0]
        assert seen["stop_time"].tolist() == [1.75, 4.25]
        assert seen["uncertainty_s"].tolist() == [0.001, 0.001]


@pytest.mark.quick(rows=lambda code: code != "")
@pytest.mark.parametrize("code", ["S07", "", None])
def test_an_nwb_file_names_the_subject_by_its_code(run: Run, code: str | None) -> None:
    path = export_nwb(replace(run, start={**run.start, "subject": code}))
    if code:
        assert pynwb.validate(path=str(path)) in ([], ([], 0))
    with pynwb.NWBHDF5IO(path, "r") as io:
        subject = io.read().subject
        assert (subject.subject_id if code else subject) == (code or None)


def test_the_nwb_validators_accept_an_exported_run(run: Run) -> None:
    inspector: Any = pytest.importorskip("nwbinspector", reason="needs nwbinspector: pip install nwbinspector")
    path = export_nwb(run)
    assert pynwb.validate(path=str(path)) in ([], ([], 0))
    found = [
        m
        for m in inspector.inspect_nwbfile(nwbfile_path=str(path))
        if m.importance.name != "BEST_PRACTICE_SUGGESTION"
    ]
    # what a rig cannot know is left to the one who shares the file
    assert {m.check_function_name for m in found} <= {"check_subject_exists"}, found


def test_export_to_nwb_without_pynwb_is_refused_and_writes_nothing(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pynwb", None)
    with raises(NwbMissingError, "pynwb_missing"):
        export_nwb(run)
    assert not (run.folder.path / "run.nwb").exists()
