"""The verbs carried out: each is checked once more, then handed to the engine."""

from collections.abc import Callable

from rig.engine import Engine, Indentation, PressId, indent
from rig.engine.indent import touch_place
from rig.engine.records import Purpose
from rig.engine.reference import Reference
from rig.plan.plan import CheckingRig
from rig.plan.planned import PlannedIndentation
from rig.protocol.api import ProtocolParameters, Rig


class LiveRig(Rig):
    """A script's rig, on hardware or on the virtual bench.

    A script may decide as it goes, so what it asks now need not be what was checked before the run: `check` sees
    every verb first.
    """

    def __init__(self, engine: Engine, check: CheckingRig) -> None:
        self._engine, self._check = engine, check
        self._reference = Reference()

    @property
    def parameters(self) -> ProtocolParameters:
        return self._check.parameters

    def mount(self, indentor: str) -> None:
        self._check.mount(indentor)
        self._do("mount", lambda: self._engine.mount(indentor))

    def home(self) -> None:
        self._check.home()
        self._do("home", self._engine.home)

    def zero(self) -> None:
        self._check.zero()
        self._do("zero", self._engine.zero)

    def move_to(self, *, x_mm: float, along_mm: float = 0.0) -> None:
        self._check.move_to(x_mm=x_mm, along_mm=along_mm)
        self._do("move_to", lambda: self._engine.move_to(float(x_mm), float(along_mm)))

    def touch(self) -> float:
        expected_mm, index = self._check.touch(), len(self._check.plan.touches) - 1
        return self._touch(index, lambda: touch_place(self._engine, index, expected_mm))

    def indent(
        self,
        *,
        doi_mm: float | None = None,
        force_gwt: float | None = None,
        increments: int = 1,
        speed_mm_s: float | None = None,
        hold_s: float = 1.0,
    ) -> Indentation:
        self._check.indent(
            doi_mm=doi_mm, force_gwt=force_gwt, increments=increments, speed_mm_s=speed_mm_s, hold_s=hold_s
        )
        ((press, planned),) = self._planned("data", 1)
        return self._indent(press.index, lambda: self._press(press, planned, speed_mm_s))

    def precondition(
        self, *, presses: int, doi_mm: float | None = None, force_gwt: float | None = None, hold_s: float = 1.0
    ) -> None:
        self._check.precondition(presses=presses, doi_mm=doi_mm, force_gwt=force_gwt, hold_s=hold_s)
        found = self._planned("precondition", presses)

        def deed() -> None:
            for press, planned in found:
                self._engine.be_over(planned.x_mm)
                self._press(press, planned)

        self._do("precondition", deed)

    def reference(self, *, x_mm: float, doi_mm: float, increments: int = 2, hold_s: float = 0.5) -> None:
        self._check.reference(x_mm=x_mm, doi_mm=doi_mm, increments=increments, hold_s=hold_s)
        ((press, planned),) = self._planned("reference", 1)

        def deed() -> None:
            self._engine.be_over(planned.x_mm)
            self._reference.compare(self._engine, self._press(press, planned))

        self._do("reference", deed)

    def retract(self) -> None:
        self._check.retract()
        self._do("retract", self._engine.retract)

    def rest(self, seconds: float) -> None:
        self._check.rest(seconds)
        self._do("rest", lambda: self._engine.rest(float(seconds)))

    def checkpoint(self, name: str) -> None:
        self._check.checkpoint(name)
        self._do("checkpoint", lambda: self._engine.checkpoint(name))

    def note(self, text: str) -> None:
        self._check.note(text)
        self._do("note", lambda: self._engine.note(text))

    def _planned(self, purpose: Purpose, last: int) -> list[tuple[PressId, PlannedIndentation]]:
        """The presses that were checked last, each with its number."""
        presses = self._check.plan.presses[purpose]
        return [(PressId(n, purpose), presses[n]) for n in range(len(presses) - last, len(presses))]

    def _press(self, press: PressId, planned: PlannedIndentation, speed_mm_s: float | None = None) -> Indentation:
        """Press as planned, now."""
        return indent(
            self._engine,
            planned.target,
            increments=int(planned.increments),
            speed_mm_s=None if speed_mm_s is None else float(speed_mm_s),
            hold_s=float(planned.hold_s),
            expected_contact_mm=planned.expected_contact_mm,
            contact_area_mm2=planned.contact_area_mm2,
            press_id=press,
        )

    def _touch(self, index: int, deed: Callable[[], float]) -> float:
        """Carry out the touch that has this number in the script."""
        return deed()

    def _do(self, verb: str, deed: Callable[[], None]) -> None:
        """Carry out a verb that has been checked."""
        deed()

    def _indent(self, index: int, deed: Callable[[], Indentation]) -> Indentation:
        """Carry out the indentation that has this number in the script."""
        return deed()
