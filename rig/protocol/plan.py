"""The check before anything moves: a script is walked through against the limits and the finger model."""

import inspect
import math
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Literal

from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.config import Config
from rig.protocol.errors import BadInputError
from rig.protocol.script import Script, where_in_script
from rig.run.records import Hold, Indentation, Target
from rig.settings import SLOWEST_MM_S
from rig.units import GWT_N
from sim.contact.shapes import ShapeError, parse_shape
from sim.fingertip import Fingertip, ModelRangeError

_MAX_INCREMENTS = 100
_MAX_HOLD_S = 3600.0
_SOFT_TRIP_OVER_PREDICTED = 2.0
_SMALLEST_SOFT_TRIP_N = 0.02


@dataclass(frozen=True)
class PlannedIndentation:
    """One indentation of the script and what the model expects of it."""

    indentor: str
    x_mm: float
    target: Target
    increments: int
    hold_s: float
    expected_contact_mm: float  # height of the indentor at first touch, from the nominal apex
    predicted_force_gwt: float
    predicted_doi_mm: float
    contact_area_mm2: float
    peak_pressure_mpa: float

    @property
    def mean_pressure_n_cm2(self) -> float:
        """Force over contact area."""
        return self.predicted_force_gwt * GWT_N / self.contact_area_mm2 * 100


@dataclass
class Plan:
    """What the script will do."""

    indentations: list[PlannedIndentation] = field(default_factory=list)

    @property
    def peak_force_gwt(self) -> float:
        """Highest force the model predicts."""
        return max((step.predicted_force_gwt for step in self.indentations), default=0.0)

    @property
    def soft_trip_n(self) -> float:
        """Twice the highest force predicted, and never so little that noise would trip."""
        return max(_SOFT_TRIP_OVER_PREDICTED * self.peak_force_gwt * GWT_N, _SMALLEST_SOFT_TRIP_N)


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


def checked_target(doi_mm: float | None, force_gwt: float | None) -> Target:
    """The one target that was given; raises BadInputError."""
    if (doi_mm is None) == (force_gwt is None):
        raise BadInputError("indent: expected either doi_mm or force_gwt")
    kind: Literal["doi_mm", "force_gwt"] = "force_gwt" if doi_mm is None else "doi_mm"
    value = force_gwt if doi_mm is None else doi_mm
    _number("indent", kind, value)
    target = Target(kind, float(value))  # type: ignore[arg-type]
    if not (math.isfinite(target.value) and target.value > 0):
        raise BadInputError(f"indent: {target.kind} = {target.value}: expected a positive number")
    return target


def _number(verb: str, name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise BadInputError(f"{verb}: {name} = {value!r}: expected a number")


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


class CheckingRig(Rig):
    """Carries out nothing: refuses what cannot be done, and answers with the model's prediction."""

    def __init__(self, parameters: ProtocolParameters, config: Config, finger: Fingertip) -> None:
        self._parameters = parameters
        self._config, self._finger = config, finger
        self._indentor: str | None = None
        self._x_mm = math.nan
        self._homed = self._zeroed = False
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

    def move_to(self, *, x_mm: float) -> None:
        self._need(self._homed, "move_to", "home()")
        _number("move_to", "x_mm", x_mm)
        low, high = self._config.limits.x_mm
        if not low <= x_mm <= high:
            raise BadInputError(f"move_to: x_mm = {x_mm:g} is outside limits.x_mm = {low:g} … {high:g}")
        frame, travel = self._config.frame, self._config.stage.travel_mm
        self._within_travel("x", frame.pad_centre_x_mm + x_mm, travel[0])
        self._within_travel("y", frame.pad_y_mm, travel[1])
        self._within_travel("z", frame.apex_z_mm + self._config.habits.clearance_mm, travel[2])
        self._x_mm = x_mm

    def indent(
        self,
        *,
        doi_mm: float | None = None,
        force_gwt: float | None = None,
        increments: int = 1,
        speed_mm_s: float | None = None,
        hold_s: float = 1.0,
    ) -> Indentation:
        target = checked_target(doi_mm, force_gwt)
        self._need(self._indentor is not None, "indent", "mount()")
        self._need(self._zeroed, "indent", "zero()")
        self._need(math.isfinite(self._x_mm), "indent", "move_to()")
        self._check_manner(increments, speed_mm_s, hold_s)
        self._check_target(target)
        assert self._indentor is not None
        result = self._finger.indent(self._indentor, self._x_mm, **{target.kind: target.value})  # type: ignore[arg-type]
        if not result.state.converged:
            raise BadInputError(f"indent: the model does not converge here (residual {result.state.residual:.0e})")
        contact_mm = result.touch_height_mm - self._finger.apex_height_mm
        self._check_reach(target, contact_mm, result.doi_mm, result.force_gwt)
        planned = PlannedIndentation(
            self._indentor,
            self._x_mm,
            target,
            increments,
            hold_s,
            contact_mm,
            result.force_gwt,
            result.doi_mm,
            result.contact_area_mm2,
            result.peak_pressure_mpa,
        )
        self._check_pressure(planned)
        self.plan.indentations.append(planned)
        holds = tuple(
            Hold(target.part(k, increments), result.doi_mm * k / increments, result.force_gwt * k / increments, 0.0)
            for k in range(1, increments + 1)
        )
        return Indentation(len(self.plan.indentations) - 1, self._x_mm, holds)

    def retract(self) -> None:
        self._need(self._homed, "retract", "home()")

    def note(self, text: str) -> None:
        if not isinstance(text, str):
            raise BadInputError(f"note: expected text, got {text!r}")

    def _need(self, condition: bool, verb: str, before: str) -> None:
        if not condition:
            raise BadInputError(f"{verb}: {before} must come first")

    def _check_manner(self, increments: int, speed_mm_s: float | None, hold_s: float) -> None:
        if not (_is_whole(increments) and 1 <= increments <= _MAX_INCREMENTS):
            expected = f"expected a whole number, 1 … {_MAX_INCREMENTS}"
            raise BadInputError(f"indent: increments = {increments!r}: {expected}")
        _number("indent", "hold_s", hold_s)
        if not 0 <= hold_s <= _MAX_HOLD_S:
            raise BadInputError(f"indent: hold_s = {hold_s!r}: expected 0 … {_MAX_HOLD_S:g} s")
        if speed_mm_s is None:
            return
        _number("indent", "speed_mm_s", speed_mm_s)
        fastest = self._config.limits.max_press_speed_mm_s
        if not SLOWEST_MM_S <= speed_mm_s <= fastest:
            expected = f"{SLOWEST_MM_S:.2g} … {fastest:g} mm/s"
            raise BadInputError(f"indent: speed_mm_s = {speed_mm_s!r}: expected {expected}")

    def _check_target(self, target: Target) -> None:
        """What no model is needed to refuse."""
        limits = self._config.limits
        limit = {"doi_mm": "max_doi_mm", "force_gwt": "max_force_gwt"}[target.kind]
        if target.value > getattr(limits, limit):
            raise BadInputError(
                f"indent: {target.kind} = {target.value:g} is beyond limits.{limit} = {getattr(limits, limit):g}"
            )

    def _check_reach(self, target: Target, contact_mm: float, doi_mm: float, force_gwt: float) -> None:
        limits = self._config.limits
        if doi_mm > limits.max_doi_mm:
            raise BadInputError(
                f"indent: {target.kind} = {target.value:g} at x = {self._x_mm:g} mm means a DOI of {doi_mm:.3g} mm, "
                f"beyond limits.max_doi_mm = {limits.max_doi_mm:g}"
            )
        if force_gwt > limits.max_force_gwt:
            raise BadInputError(
                f"indent: {target.kind} = {target.value:g} at x = {self._x_mm:g} mm means a force of "
                f"{force_gwt:.3g} gwt, beyond limits.max_force_gwt = {limits.max_force_gwt:g}"
            )
        if force_gwt * GWT_N > limits.soft_trip_n:
            raise BadInputError(
                f"indent: {target.kind} = {target.value:g} at x = {self._x_mm:g} mm means {force_gwt * GWT_N:.3g} N, "
                f"beyond limits.soft_trip_n = {limits.soft_trip_n:g}"
            )
        lowest = self._config.frame.apex_z_mm + contact_mm - max(doi_mm, limits.search_mm)
        self._within_travel("z", lowest, self._config.stage.travel_mm[2])

    def _check_pressure(self, planned: PlannedIndentation) -> None:
        limit = self._config.limits.max_pressure_n_cm2
        if planned.mean_pressure_n_cm2 > limit:
            raise BadInputError(
                f"indent: {planned.target.kind} = {planned.target.value:g} at x = {self._x_mm:g} mm means "
                f"{planned.mean_pressure_n_cm2:.3g} N/cm² over a contact of {planned.contact_area_mm2:.2g} mm², "
                f"beyond limits.max_pressure_n_cm2 = {limit:g}"
            )

    def _within_travel(self, axis: str, machine_mm: float, travel_mm: float) -> None:
        if not -travel_mm <= machine_mm <= 0:
            raise BadInputError(
                f"machine {axis} = {machine_mm:.3f} mm is outside the stage's travel, {-travel_mm:g} … 0 mm"
            )
