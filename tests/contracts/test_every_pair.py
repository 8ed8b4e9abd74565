"""Every kind of stage beside every kind of force sensor: the force of a press is that of the finger."""

from itertools import product
from pathlib import Path

import pytest

from rig.devices.registry import BUILT_IN
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.contracts.force import ForceBytes
from tests.contracts.tables import tables
from tests.program import press_script

SENSORS = {one.kind: one for one in tables(ForceBytes)}
RESOLUTION_GWT = 0.01


@pytest.mark.quick(rows=lambda stage, force: (stage, force) in zip(*BUILT_IN.values(), strict=False))
@pytest.mark.parametrize(("stage", "force"), [*product(BUILT_IN["stage"], BUILT_IN["force"])])
@pytest.mark.usefixtures("empty_figures")
def test_a_press_reads_the_force_of_the_finger(stage: str, force: str, finger: Fingertip, tmp_path: Path) -> None:
    path = tmp_path / "one.py"
    path.write_text(press_script("doi_mm=0.4, hold_s=0.3"), encoding="utf-8")
    script = load_script(str(path))
    config = Config.model_validate({"stage": {"kind": stage}, "force": {"kind": force, **SENSORS[force].table}})
    done = dry_run(Session(script, config, finger, make_plan(script, config, finger), NewRun(tmp_path)))
    assert done.problem is None
    (hold,) = done.run.stream("hold_end")
    found = finger.indent("bar:3.0", hold["true_x_mm"], doi_mm=hold["true_doi_mm"])
    assert hold["force_gwt"] == pytest.approx(found.force_gwt, abs=0.51 * RESOLUTION_GWT)
