"""An identified finger in check, dry-run and compare: bands before, measurements after, and the updated finger."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rig.compare.plausible_fingers import read_plausible
from rig.data import Run, read_run
from rig.plan.finger_file import read_finger_file
from rig.plan.plan import found
from rig.units import GWT_N
from tests.program import Program
from tests.rig.identify.finger_file import SERIES, identified_file

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
def run(rig):
    rig.mount("cylinder:3")
    rig.home()
    rig.zero()
    rig.reference(x_mm=0.0, doi_mm=0.3)
    for x_mm in (-0.3, 0.3):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.4, hold_s=0.5)
        rig.indent(force_gwt=2.0, hold_s=0.5)
    rig.reference(x_mm=0.0, doi_mm=0.3)
"""


Files = Callable[..., tuple[Path, Path]]


@pytest.fixture
def files(tmp_path: Path) -> Files:
    def make(**how: object) -> tuple[Path, Path]:
        script, finger = tmp_path / "mine.py", tmp_path / "finger.toml"
        script.write_text(SCRIPT, encoding="utf-8")
        finger.write_text(identified_file(**how).as_toml(), encoding="utf-8")  # type: ignore[arg-type]
        return script, finger

    return make


def _run(out: Path) -> Run:
    (folder,) = out.iterdir()
    return read_run(folder)


def test_check_shows_bands_and_trips_above_them(program: Program, files: Files) -> None:
    script, finger = files(relaxation=SERIES)
    found = program("check", script, "--finger", finger, "--json").json
    steps = found["steps"]
    for step in steps:
        low, high = step["force_band_gwt"]
        shallow, deep = step["doi_band_mm"]
        assert low <= step["force_gwt"] <= high < 1.5 * low
        assert shallow <= step["doi_mm"] <= deep < 1.5 * shallow
        assert (low < high) is (step["target"] == "doi_mm") is not (shallow < deep)
    assert steps[0]["highest_gwt"] > steps[0]["force_band_gwt"][1]  # it relaxes until the hold is over
    highest = max(step["highest_gwt"] for step in steps)
    assert found["peak_force_gwt"] == pytest.approx(highest)
    assert found["soft_trip_n"] == pytest.approx(max(1.25 * highest * GWT_N, 0.02))


@pytest.mark.quick(rows=lambda relaxation: relaxation == SERIES)
@pytest.mark.parametrize("relaxation", [(), SERIES], ids=["elastic", "relaxing"])
def test_what_a_run_finds_lies_in_the_band(
    program: Program,
    files: Files,
    tmp_path: Path,
    relaxation: tuple[tuple[float, float], ...],
) -> None:
    """The virtual bench's finger is the most likely one and relaxes as it does."""
    script, finger = files(relaxation=relaxation)
    ended = program("dry-run", script, "--finger", finger, "--out", tmp_path / "runs")
    assert ended.code == 0, ended.err
    run = _run(tmp_path / "runs")
    promised = {(one["purpose"], one["index"]): one for one in run.start["promised"]}
    assert len(promised) == 6
    for purpose, prefix in (("data", ""), ("reference", "reference_")):
        for hold in run.stream(f"{prefix}hold_end"):
            one = promised[purpose, hold["index"]]
            if hold["hold"] == (2 if prefix else 1):
                assert one["low"] <= hold[one["key"]] <= one["high"]
    assert not run.stream("alarm")
    report = run.folder.report.read_text(encoding="utf-8")
    assert 'id="identified"' in report
    assert [one.kept for one in found(run)] == [True] * 6
    places = {(one.predicted.purpose, one.predicted.index): one.x_mm for one in found(run)}
    assert places == {
        **{("data", 0): -0.3, ("data", 1): -0.3, ("data", 2): 0.3, ("data", 3): 0.3},
        **{("reference", 0): 0.0, ("reference", 1): 0.0},
    }
    assert {one.indentor for one in found(run)} == {"cylinder:3"}
    assert all(number in " ".join(report.split()) for number in ("6 of 6 presses", "90 %"))
    after = read_finger_file(run.folder.path / "finger_after.toml")
    assert after.identified.runs == ("one", run.folder.path.name)
    assert after.identified.draw[0].stiffness != identified_file().identified.draw[0].stiffness
    sums = run.folder.path.joinpath("SHA256SUMS").read_text(encoding="utf-8")
    assert "finger_after.toml" in sums


def test_a_finger_that_is_another_by_now_is_an_alarm_and_is_learned(
    program: Program, files: Files, tmp_path: Path
) -> None:
    """Truly 1.3 times as stiff: references say so, and the file after the run has most of it."""
    script, finger = files(spread=0.15)
    config = tmp_path / "bench.toml"
    config.write_text("[virtual]\nstiffness = 1.3\n", encoding="utf-8")
    out = tmp_path / "runs"
    program("dry-run", script, "--finger", finger, "--config", config, "--out", out)
    run = _run(out)
    alarms = [event["reason"] for event in run.stream("alarm")]
    assert len(alarms) == 2
    assert all("identified finger" in reason for reason in alarms)
    after = read_finger_file(run.folder.path / "finger_after.toml")
    promised = {(one["purpose"], one["index"]): one for one in run.start["promised"]}
    again = program("check", script, "--finger", run.folder.path / "finger_after.toml", "--json").json
    assert 1.2 < again["steps"][0]["force_gwt"] / promised["data", 0]["middle"] < 1.4
    assert len(after.identified.runs) == 2


def test_a_comparison_takes_it_as_ranges(program: Program, files: Files, tmp_path: Path) -> None:
    _, finger = files(spread=0.1)
    found = read_plausible(finger)
    assert set(found.ranges) == {"tissue.stiffness", "tissue.e_fat"}
    low, high = found.ranges["tissue.e_fat"]
    assert low < 0.1 < high
