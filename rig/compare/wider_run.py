"""Range of positions that would cover the part of a recording that a run leaves out, as far as the planner accepts.

The planner refuses positions beyond the limits, the stage's travel and the edge of the model's largest patch. A range
is recommended only after the planner has accepted every press of it.
"""

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, Overlay, left_out, range_needed
from rig.compare.stimuli import StimulusRow, answers_key
from rig.data import Run
from rig.errors import RigError
from rig.plan.config import Config, load_config
from rig.plan.finger_model import FingerModel, Predictions, from_copy
from rig.plan.plan import Plan, Planner
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.check import ScriptState
from rig.protocol.handlers import Patience, SilentScriptError, impatient
from rig.protocol.script import Script, find_script, script_with, shipped_protocols
from rig.records import Pace, Prediction, Target
from rig_shared.accounts import only_ours
from rig_shared.user_files import read_bytes, read_text
from sim.errors import SimError
from sim.models.cache import cached_arrays, content_key
from sim.models.fingertip import Fingertip

_STEP_MM = 0.05
"""Ends of a recommended range are multiples of this."""

_MOST_SHRINKS = 8
_REFUSED = (RigError, SimError)


@dataclass(frozen=True)
class WiderRun:
    """Range of a run that measures as much of a recording as the planner accepts.

    `command` is empty if the protocol has no range of positions. `measured` counts the recorded positions that the
    range covers at every receptor. `complete` if it covers all of them, `wider` if it is wider than the run.
    """

    from_mm: float
    to_mm: float
    command: str
    measured: int
    complete: bool
    wider: bool = True


def with_wider_runs(comparison: Comparison, runs: Mapping[str, tuple[Run, Fingertip]]) -> Comparison:
    """Return the comparison with a wider run for each recording that is not covered; `runs` are by folder name."""
    found = {
        overlay.stimulus: wider_run(overlay, *runs[overlay.stimulus.run])
        for overlay in comparison.overlays
        if left_out(overlay).any() and overlay.stimulus.run in runs
    }
    return replace(comparison, wider=found)


def wider_run(overlay: Overlay, run: Run, finger: Fingertip) -> WiderRun:
    """Return the widest range towards the one that a recording needs; cached like responses."""
    stimulus = overlay.stimulus
    needed = _outwards(range_needed(overlay), stimulus)
    config = load_config(run.folder.path / "config.toml")
    script = _script(run)
    request = [stimulus.read_as, stimulus.kind, stimulus.commanded, *needed, config.model_dump(mode="json")]
    parameters = [] if script is None else [read_text(script.path), run.start["parameters"]]
    ends = [float(stimulus.x_mm.min()), float(stimulus.x_mm.max())]
    key = answers_key(finger, ["wider run", json.dumps([*request, *parameters, *ends])])
    arrays, _ = cached_arrays(
        content_key([key]),
        lambda: {"ends": np.array(_Planned(stimulus, run, finger, config, script).widest(*needed))},
        kind="answers",
    )
    low, high = (float(x) for x in arrays["ends"])
    position, receptor = overlay.recording.position_mm, stimulus.receptor_mm
    covered = (position + receptor.min() >= low - _STEP_MM / 50) & (position + receptor.max() <= high + _STEP_MM / 50)
    command = "" if script is None else _command(run, config, script, low, high)
    wider = low < ends[0] - _STEP_MM or high > ends[1] + _STEP_MM
    return WiderRun(high, low, command, int(covered.sum()), bool(covered.all()), wider or bool(covered.all()))


def _outwards(needed: tuple[float, float], stimulus: StimulusRow) -> tuple[float, float]:
    """Return a range that also contains the run's own, with ends rounded outwards."""
    low, high = min(needed[0], stimulus.x_mm.min()), max(needed[1], stimulus.x_mm.max())
    return (
        float(np.floor(low / _STEP_MM + 1e-6) * _STEP_MM),
        float(np.ceil(high / _STEP_MM - 1e-6) * _STEP_MM),
    )


def _script(run: Run) -> Script | None:
    """Return the run's protocol with its parameters, or None if it has no range of positions."""
    parameters = run.start.get("parameters", {})
    path = run.folder.path / "protocol.py"
    if not {"from_mm", "to_mm"} <= set(parameters) or not path.is_file():
        return None
    try:
        return script_with(_ours(path, run.start["protocol"]), run.start["protocol"], parameters)
    except (RigError, OSError):
        return None


def _ours(path: Path, name: str) -> Path:
    """Return the shipped protocol if a run has a copy of it, else the copy. Raises OSError if it may be others'.

    A comparison reads runs of other accounts, and must not run what they wrote.
    """
    shipped = shipped_protocols() / f"{Path(name).stem}.py"
    if shipped.is_file() and read_bytes(shipped) == read_bytes(path):
        return shipped
    real = path.resolve()
    code = real.parent.glob("*.py")  # the script, and what it imports
    if not all(map(only_ours, (real.parent, *code))):
        raise PermissionError(f"{real}: another account can change it")
    return real


_NO_PARAMETERS = ProtocolParameters()


class _Beyond(FingerModel):
    """Finger model that solves only presses beyond the range of the run, whose own presses were accepted."""

    own: tuple[float, float] | None = None

    def press(self, indentor: str, x_mm: float, target: Target, pace: Pace | None = None) -> Prediction:
        """Predict a press; one inside the run's range is taken for the press at its end."""
        if self.own is None or not self.own[0] <= x_mm <= self.own[1]:
            return super().press(indentor, x_mm, target, pace)
        return replace(super().press(indentor, self.own[0], target, pace), x_mm=x_mm)


class _Planned:
    """Planner of single positions and of whole ranges, which solves every press once."""

    def __init__(
        self, stimulus: StimulusRow, run: Run, finger: Fingertip, config: Config, script: Script | None
    ) -> None:
        self._stimulus, self._run, self._finger, self._config, self._script = stimulus, run, finger, config, script
        self._known: Predictions = {}

    def widest(self, low: float, high: float) -> tuple[float, float]:
        """Return the widest accepted range inside one that contains the run's own."""
        own = _inwards(self._stimulus.x_mm)
        low, high = self._farthest(own[0], low), self._farthest(own[1], high)
        for _ in range(_MOST_SHRINKS):
            refused = self._refused_in(low, high)
            if refused is None:
                break
            low, high = _without(refused, low, high, own)
        return low, high

    def _farthest(self, accepted: float, needed: float) -> float:
        """Return the accepted end that is nearest to the needed one; acceptance ends once on either side."""
        if abs(needed - accepted) < _STEP_MM / 2 or self._accepts(needed):
            return needed
        steps = round(abs(needed - accepted) / _STEP_MM)
        sign, least, most = np.sign(needed - accepted), 0, steps
        while most - least > 1:
            middle = (least + most) // 2
            if self._accepts(accepted + sign * middle * _STEP_MM):
                least = middle
            else:
                most = middle
        return float(accepted + sign * least * _STEP_MM)

    def _accepts(self, x_mm: float) -> bool:
        rig, _ = self._rig(_NO_PARAMETERS)
        try:
            rig.mount(self._stimulus.indentor)
            rig.home()
            rig.zero()
            rig.move_to(x_mm=round(x_mm, 3))
            target = {self._stimulus.kind: self._stimulus.commanded}
            rig.indent(doi_mm=target.get("doi_mm"), force_gwt=target.get("force_gwt"))
        except _REFUSED:
            return False
        return True

    def _refused_in(self, low: float, high: float) -> float | None:
        """Return the first x of the protocol's range that the planner refuses, or None."""
        if self._script is None:
            return None
        script = self._script.fresh()
        rig, state = self._rig(_ranged(script.parameters, low, high))
        try:
            with impatient():
                script.run(rig)
        except (*_REFUSED, SilentScriptError):
            return state.x_mm
        return None

    def _rig(self, parameters: ProtocolParameters) -> tuple[Rig, ScriptState]:
        def where(indentor: str) -> str:
            return from_copy(self._run.folder.path, indentor)

        model = _Beyond(self._finger, self._known, where, self._config.identified)
        if self._script is not None and parameters is not _NO_PARAMETERS:
            model.own = _inwards(self._stimulus.x_mm)
        state = ScriptState(self._config, model)
        return Rig(parameters, state, Patience(Planner(state, Plan(predictions=self._known)))), state


def _inwards(x_mm: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of a run, rounded inwards."""
    low = float(np.ceil(x_mm.min() / _STEP_MM - 1e-6) * _STEP_MM)
    high = float(np.floor(x_mm.max() / _STEP_MM + 1e-6) * _STEP_MM)
    return min(low, high), max(low, high)


def _without(refused: float, low: float, high: float, own: tuple[float, float]) -> tuple[float, float]:
    """Return the range without a refused position; the range of the run itself if the position lies inside that."""
    if refused > own[1]:
        return low, max(own[1], refused - _STEP_MM)
    if refused < own[0]:
        return min(own[0], refused + _STEP_MM), high
    return own


def _ranged(parameters: ProtocolParameters, low: float, high: float) -> ProtocolParameters:
    return parameters.model_copy(update={"from_mm": round(high, 3), "to_mm": round(low, 3)})


def _command(run: Run, config: Config, script: Script, low: float, high: float) -> str:
    """Return the command that presses a range with the run's protocol, parameters and configuration."""
    path = run.folder.path
    name = str(path / "protocol.py")
    try:
        if read_bytes(find_script(script.name)) == read_bytes(script.path):
            name = script.name
    except RigError:
        pass
    words = ["rig", "dry-run" if run.start["virtual"] else "run", name]
    if config != Config():
        words += ["--config", str(path / "config.toml")]
    ends = {"from_mm": f"{round(high, 3):g}", "to_mm": f"{round(low, 3):g}"}
    changed: dict[str, Any] = script.parameters.model_dump(exclude_defaults=True) | ends
    settings = [f"{key}={value}" for key, value in changed.items() if value is not None]
    return shlex.join([*words, "--set", *settings])
