"""A press that is far from its prediction, as with another indentor than was asked for, is named in every place."""

from pathlib import Path

import pytest

from rig.data import read_run
from rig.data.deviation import PressDeviation, deviations, warning_of
from rig.data.run_state import RunState
from rig.panel.run_view import RunView
from tests.program import Program

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (0.0, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent({target}, increments=2, hold_s=0.1)
"""


def _pressed(program: Program, folder: Path, target: str, stiffness: float, *words: object) -> tuple[Path, str]:
    (folder / "two.py").write_text(SCRIPT.format(target=target), encoding="utf-8")
    (folder / "rig.toml").write_text(f"[virtual]\nstiffness = {stiffness}\n", encoding="utf-8")
    ended = program("dry-run", folder / "two.py", "--config", folder / "rig.toml", "--out", folder / "runs", *words)
    assert ended.code == 0, ended.err
    (run,) = (folder / "runs").iterdir()
    return run, ended.err


@pytest.mark.parametrize(
    ("target", "stiffness", "name", "large"),
    [
        ("doi_mm=0.3", 1.0, "force", False),
        ("doi_mm=0.3", 0.5, "force", True),
        ("force_gwt=1.0", 0.5, "DOI", True),
    ],
)
def test_a_press_far_from_its_prediction_is_named_in_warning_report_and_panel(
    program: Program, tmp_path: Path, target: str, stiffness: float, name: str, large: bool
) -> None:
    folder, err = _pressed(program, tmp_path, target, stiffness)
    run = read_run(folder)
    found = deviations(run)
    assert [one.index for one in found] == [0, 1]
    assert [one.is_large for one in found] == [large, large]
    warning = warning_of(found)
    view = RunView(folder)
    view.look(0.0)
    page = run.folder.report.read_text(encoding="utf-8")
    assert err.count(", predicted ") >= 2, "measured beside predicted, for each press"
    if not large:
        assert warning is None
        assert view.as_json(going=False)["deviation"] is None
        assert 'id="deviating"' not in page
        return
    assert warning is not None
    assert warning.startswith("2 of 2 presses are more than 30% off the prediction: ")
    assert f"{name} " in warning
    assert "check that bar:3.0 is mounted" in warning
    assert warning in err
    assert view.as_json(going=False)["deviation"] == warning
    assert warning in page


def test_a_press_on_an_identified_finger_is_judged_by_its_band() -> None:
    """Half the force is inside a wide band, and a tenth off outside a narrow one."""
    wide = PressDeviation(0, "bar:3.0", "force_gwt", 4.0, 2.0, (1.5, 6.0))
    narrow = PressDeviation(1, "bar:3.0", "force_gwt", 4.0, 4.4, (3.8, 4.2))
    assert (wide.is_large, narrow.is_large) == (False, True)
    warning = warning_of([wide, narrow])
    assert warning is not None
    assert warning.startswith("1 of 2 presses is outside their predicted band: force 1.10 times")


def test_the_live_run_state_judges_a_press_by_the_band_of_an_identified_finger() -> None:
    """Half the predicted force lies in the band that the first document promises."""
    band = {"purpose": "data", "index": 0, "key": "force_gwt", "low": 1.5, "middle": 4.0, "high": 6.0}
    state = RunState()
    state.apply({"doc": "start", "t_s": 0.0, "promised": [band]})
    press = {"index": 0, "indentor": "bar:3.0", "x_mm": 0.0, "target": "doi_mm", "increments": 1}
    state.event("indentation_start", {**press, "predicted_force_gwt": 4.0, "predicted_doi_mm": 0.3})
    state.event("hold_end", {"index": 0, "hold": 1, "force_gwt": 2.0, "doi_mm": 0.3})
    state.event("indentation_end", {"index": 0})
    (found,) = state.deviations.values()
    assert (found.band, found.is_large) == ((1.5, 6.0), False)
