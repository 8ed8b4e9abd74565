"""The verbs carried out: each is checked once more, then handed to the engine."""

from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.plan import CheckingRig, checked_target
from rig.run import Engine, Indentation, indent


class LiveRig(Rig):
    """A script's rig, on hardware or on the virtual bench.

    A script may decide as it goes, so what it asks now need not be what was checked before the run: `check` sees
    every verb first.
    """

    def __init__(self, engine: Engine, check: CheckingRig) -> None:
        self._engine, self._check = engine, check

    @property
    def parameters(self) -> ProtocolParameters:
        return self._check.parameters

    def mount(self, indentor: str) -> None:
        self._check.mount(indentor)
        self._engine.mount(indentor)

    def home(self) -> None:
        self._check.home()
        self._engine.home()

    def zero(self) -> None:
        self._check.zero()
        self._engine.zero()

    def move_to(self, *, x_mm: float) -> None:
        self._check.move_to(x_mm=x_mm)
        self._engine.move_to(float(x_mm))

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
        return indent(
            self._engine,
            checked_target(doi_mm, force_gwt),
            increments=int(increments),
            speed_mm_s=None if speed_mm_s is None else float(speed_mm_s),
            hold_s=float(hold_s),
            expected_contact_mm=self._check.plan.indentations[-1].expected_contact_mm,
        )

    def retract(self) -> None:
        self._engine.retract()

    def note(self, text: str) -> None:
        self._check.note(text)
        self._engine.note(text)
