"""Every range that a comparison recommends is accepted by the planner, and a run of it can be compared.

The walk: shape × range of the run, up to the last position that the planner accepts × receptors × recorded positions
beyond the range.
"""

import json
import shlex
import shutil
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from rig.compare.comparison import Comparison, compare, left_out_rows
from rig.compare.make_verdict import answers
from rig.compare.recordings.recording import recording
from rig.compare.stimuli import StimulusRow, stimuli
from rig.compare.wider_run import with_wider_runs
from rig.data import Run, RunFolder
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.session.session import NewRun, Session, dry_run
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from tests.sim.coarse_mesh import as_toml, coarse_mesh

MESH = coarse_mesh(0.5, 0.5)
COARSE = Config(finger=FingertipConfig(mesh=MESH))
RECORDED = 15


class Pressed(NamedTuple):
    """Protocol of a shape, and what it commands."""

    protocol: str
    settings: tuple[str, ...]
    kind: str
    commanded: float


SHAPES = {
    "bar:3.0": Pressed("bars", ("increments=1",), "doi_mm", 1.0),
    "step:1": Pressed("steps", ("force_gwt=2.33",), "force_gwt", 2.33),
    "cylinder:9": Pressed("cylinders", ("diameter_mm=9", "force_gwt=2"), "force_gwt", 2.0),
}
FROM_TO_MM = {"narrow": (1.5, -1.5), "one side": (3.0, 0.5), "patches of two widths": (4.5, -4.5)}
RECORDED_AT = (((0.0,), 3.5), ((-2.0, 0.0, 2.0), 3.5), ((-2.0, 0.0, 2.0), 9.0))
"""Receptors (mm), and how far recorded positions reach to either side (mm)."""


def _script(shape: str, from_mm: float, to_mm: float) -> Script:
    one = SHAPES[shape]
    return load_script(one.protocol, [*one.settings, f"from_mm={from_mm}", f"to_mm={to_mm}", "spacing_mm=2.5"])


def _accepted(script: Script, finger: Fingertip, settings: Config) -> bool:
    try:
        make_plan(script, settings, finger)
    except BadInputError:
        return False
    return True


def _folder(shape: str, ends: tuple[float, float], path: Path) -> Run:
    """A run folder with what a recommendation reads: protocol, configuration and parameters."""
    script = _script(shape, *ends)
    shutil.copy(script.path, path / "protocol.py")
    (path / "config.toml").write_text(as_toml(MESH), encoding="utf-8")
    parameters = json.loads(script.parameters.model_dump_json())
    start = {"protocol": script.name, "parameters": parameters, "virtual": True}
    return Run(RunFolder(path), start, None, {}, {}, {}, 0.0, 0.0)


def _compared(found: list[StimulusRow], run: Run, finger: Fingertip, to_mm: float) -> Comparison:
    rows = [(float(x), 10.0 + 5 * np.cos(x), np.nan) for x in np.linspace(-to_mm, to_mm, RECORDED)]
    comparison = compare(found, {found[0].shape: recording("mine.csv", rows)})
    return with_wider_runs(comparison, {found[0].run: (run, finger)})


@pytest.mark.quick(rows=lambda shape, reach: list(SHAPES).index(shape) == list(FROM_TO_MM).index(reach))
@pytest.mark.parametrize(("shape", "reach"), list(product(SHAPES, FROM_TO_MM)))
def test_a_recommended_range_is_accepted(
    shape: str, reach: str, make_stimulus: Callable[..., StimulusRow], tmp_path: Path
) -> None:
    run, one = _folder(shape, FROM_TO_MM[reach], tmp_path), SHAPES[shape]
    accepted: dict[str, bool] = {}
    for receptors, to_mm in RECORDED_AT:
        finger = Fingertip.load(COARSE.finger, receptor_x_mm=receptors)
        x_mm = np.linspace(*FROM_TO_MM[reach][::-1], 9)
        profile = 1.0 + np.cos(x_mm[:, None] - np.array(receptors))
        stimulus = make_stimulus(
            shape, x_mm, np.array(receptors), {"sed": profile}, kind=one.kind, commanded=one.commanded
        )
        comparison = _compared([stimulus], run, finger, to_mm)
        (row,) = left_out_rows(comparison)
        missing = {x for r in row["left_out"] for x in r["positions_mm"]}
        if not missing:
            assert not comparison.wider
            continue
        words = shlex.split(row["command"])
        recommended = load_script(words[2], words[words.index("--set") + 1 :])
        low, high = row["range_needed_mm"]
        assert (recommended.parameters.to_mm, recommended.parameters.from_mm) == (low, high)  # type: ignore[attr-defined]
        if row["command"] not in accepted:
            accepted[row["command"]] = _accepted(recommended, finger, COARSE)
        assert accepted[row["command"]], words
        assert RECORDED - len(missing) <= row["covered_by_command"] <= RECORDED
        for answer in answers(comparison):
            assert len(answer.places.rate) + sum(len(one.position_mm) for one in answer.left_out) == RECORDED
            assert all(one.sentence for one in answer.left_out)
        last = make_stimulus(
            shape, np.array([low, high]), np.array(receptors), {}, kind=one.kind, commanded=one.commanded
        )
        (again,) = left_out_rows(_compared([last], run, finger, to_mm))
        assert again["range_needed_mm"] == ((low, high) if again["left_out"] else again["range_needed_mm"])
        covered = {x for r in again["left_out"] for x in r["positions_mm"]}
        assert RECORDED - len(covered) == row["covered_by_command"]


def test_presses_on_patches_of_two_widths_are_compared(finger: Fingertip, tmp_path: Path) -> None:
    script, config = load_script("bars", ["increments=1", "from_mm=4.5", "to_mm=-4.5", "spacing_mm=3"]), Config()
    session = Session(script, config, finger, make_plan(script, config, finger), NewRun(tmp_path))
    run = dry_run(session).run
    (row,) = left_out_rows(_compared(stimuli(run, finger), run, finger, 3.5))
    assert row["command"].startswith("rig dry-run bars --set ")
    low, high = row["range_needed_mm"]
    assert low < -4.5 < 4.5 < high < 5.5
