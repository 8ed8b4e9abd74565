"""The check before anything moves: a script is walked through against the limits and the finger model."""

import inspect
import math

from rig.engine.records import Hold, Indentation, Purpose, Target
from rig.plan.config import Config
from rig.plan.planned import Plan, PlannedIndentation
from rig.plan.refusals import (
    checked_target,
    refuse_along,
    refuse_count,
    refuse_no_number,
    refuse_no_text,
    refuse_pressure,
    refuse_reach,
    refuse_seconds,
    refuse_speed,
    refuse_target,
    refuse_travel,
)
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.errors import BadInputError
from rig.protocol.script import Script, where_in_script
from sim.contact.shapes import ShapeError, parse_shape
from sim.models.errors import ModelRangeError
from sim.models.fingertip import Fingertip


def make_plan(script: Script, config: Config, finger: Fingertip) -> Plan:
    """Walk through the script; raises BadInputError at the first step that cannot be done."""
    rig = CheckingRig(script.parameters, config, finger)
    if inspect.iscoroutinefunction(script.run):
        raise BadInputError(f"protocol {script.path}: run(rig) is asynchronous, expected an ordinary function")
    try:
        script.run(rig)
    except (BadInputError, ShapeError, ModelRangeError) as error:
        raise BadInputError(f"{where_in_script(script.path, error)}: {error}") from None
    except (Exception, SystemExit) as error:
        place = where_in_script(script.path, error)
        raise BadInputError(f"{place}: {type(error).__name__}: {error}") from None
    if not rig.plan.indentations:
        raise BadInputError(f"protocol {script.path}: run(rig) indents nowhere")
    return rig.plan


class CheckingRig(Rig):
    """Carries out nothing: refuses what cannot be done, and answers with the model's prediction."""

    def __init__(self, parameters: ProtocolParameters, config: Config, finger: Fingertip) -> None:
        self._parameters = parameters
        self._config, self._finger = config, finger
        self._indentor: str | None = None
        self._x_mm, self._along_mm = math.nan, 0.0
        self._homed = self._zeroed = False
        self._checkpoints: set[str] = set()
        self.plan = Plan()

    @property
    def parameters(self) -> ProtocolParameters:
        return self._parameters

    def mount(self, indentor: str) -> None:
        if not isinstance(indentor, str):
            raise BadInputError(f"mount: expected the name of an indentor, got {indentor!r}")
        parse_shape(indentor)
        self._indentor = indentor

    def home(self) -> None:
        self._homed, self._x_mm = True, math.nan

    def zero(self) -> None:
        self._need(self._homed, "zero", "home()")
        self._zeroed = True

    def move_to(self, *, x_mm: float, along_mm: float = 0.0) -> None:
        self._need(self._homed, "move_to", "home()")
        refuse_no_number("move_to", "x_mm", x_mm)
        refuse_along(along_mm, self._config)
        low, high = self._config.limits.x_mm
        if not low <= x_mm <= high:
            raise BadInputError(f"move_to: x_mm = {x_mm:g} is outside limits.x_mm = {low:g} … {high:g}")
        frame, travel = self._config.frame, self._config.stage.travel_mm
        refuse_travel("x", frame.pad_centre_x_mm + x_mm, travel[0])
        refuse_travel("y", frame.pad_y_mm + along_mm, travel[1])
        refuse_travel("z", frame.apex_z_mm + self._config.habits.clearance_mm, travel[2])
        self._x_mm, self._along_mm = x_mm, along_mm

    def touch(self) -> float:
        self._ready("touch")
        assert self._indentor is not None
        z_mm = self._config.finger.receptor_plane_mm + self._along_mm
        height_mm = self._finger.touch_height_mm(self._indentor, self._x_mm, z_mm=z_mm)
        self.plan.touches.append(height_mm - self._finger.apex_height_mm)
        return self.plan.touches[-1]

    def indent(
        self,
        *,
        doi_mm: float | None = None,
        force_gwt: float | None = None,
        increments: int = 1,
        speed_mm_s: float | None = None,
        hold_s: float = 1.0,
    ) -> Indentation:
        target = checked_target("indent", doi_mm, force_gwt)
        if speed_mm_s is not None:
            refuse_speed("indent", speed_mm_s, self._config.limits)
        planned = self._planned("indent", target, increments, hold_s)
        self._plan("indent", "data", [planned])
        force_gwt, doi_mm = planned.predicted_force_gwt, planned.predicted_doi_mm
        holds = tuple(
            Hold(target.part(k, increments), doi_mm * k / increments, force_gwt * k / increments, 0.0)
            for k in range(1, increments + 1)
        )
        return Indentation(len(self.plan.indentations) - 1, self._x_mm, holds)

    def precondition(
        self, *, presses: int, doi_mm: float | None = None, force_gwt: float | None = None, hold_s: float = 1.0
    ) -> None:
        refuse_count("precondition", "presses", presses)
        target = checked_target("precondition", doi_mm, force_gwt)
        planned = self._planned("precondition", target, 1, hold_s)
        self._plan("precondition", "precondition", [planned] * presses)

    def reference(self, *, x_mm: float, doi_mm: float, increments: int = 2, hold_s: float = 0.5) -> None:
        self.move_to(x_mm=x_mm)
        target = checked_target("reference", doi_mm, None)
        planned = self._planned("reference", target, increments, hold_s)
        first = next(iter(self.plan.presses["reference"]), planned)
        if planned != first:
            raise BadInputError(
                f"reference: expected the same press each time, {first.indentor} at x = {first.x_mm:g} mm to "
                f"{first.target.value:g} mm in {first.increments}"
            )
        self._plan("reference", "reference", [planned])

    def retract(self) -> None:
        self._need(self._homed, "retract", "home()")

    def rest(self, seconds: float) -> None:
        self._need(self._homed, "rest", "home()")
        refuse_seconds("rest", "seconds", seconds)

    def checkpoint(self, name: str) -> None:
        refuse_no_text("checkpoint", name)
        if name in self._checkpoints:
            raise BadInputError(f"checkpoint: {name!r} has been passed already, expected another name")
        self._checkpoints.add(name)

    def note(self, text: str) -> None:
        refuse_no_text("note", text)

    def _need(self, condition: bool, verb: str, before: str) -> None:
        if not condition:
            raise BadInputError(f"{verb}: {before} must come first")

    def _ready(self, verb: str) -> None:
        self._need(self._indentor is not None, verb, "mount()")
        self._need(self._zeroed, verb, "zero()")
        self._need(math.isfinite(self._x_mm), verb, "move_to()")

    def _planned(self, verb: str, target: Target, increments: int, hold_s: float) -> PlannedIndentation:
        """What the model expects of a press at the present place, within the limits."""
        self._ready(verb)
        if self._along_mm:
            raise BadInputError(f"{verb}: along_mm = {self._along_mm:g}: expected 0, elsewhere only touch()")
        refuse_count(verb, "increments", increments)
        refuse_seconds(verb, "hold_s", hold_s)
        refuse_target(verb, target, self._config.limits)
        assert self._indentor is not None
        result = self._finger.indent(self._indentor, self._x_mm, **{target.kind: target.value})  # type: ignore[arg-type]
        if not result.state.converged:
            raise BadInputError(f"{verb}: the model does not converge here (residual {result.state.residual:.0e})")
        planned = PlannedIndentation(
            self._indentor,
            self._x_mm,
            target,
            increments,
            hold_s,
            result.touch_height_mm - self._finger.apex_height_mm,
            result.force_gwt,
            result.doi_mm,
            result.contact_area_mm2,
            result.peak_pressure_mpa,
        )
        refuse_reach(verb, planned, self._config)
        refuse_pressure(verb, planned, self._config.limits)
        return planned

    def _plan(self, verb: str, purpose: Purpose, presses: list[PlannedIndentation]) -> None:
        self.plan.presses[purpose].extend(presses)
        longest_s = self._config.limits.max_contact_s
        if self.plan.held_s > longest_s:
            raise BadInputError(
                f"{verb}: the finger would be held for {self.plan.held_s:g} s in all, "
                f"beyond limits.max_contact_s = {longest_s:g}"
            )
