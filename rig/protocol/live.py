"""The verbs carried out: each is handed to the engine."""

from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.plan import checked_target
from rig.run import Engine, Indentation, indent


class LiveRig(Rig):
    """A script's rig, on hardware or on the virtual bench."""

    def __init__(self, engine: Engine, parameters: ProtocolParameters) -> None:
        self._engine, self._parameters = engine, parameters

    @property
    def parameters(self) -> ProtocolParameters:
        return self._parameters

    def mount(self, indentor: str) -> None:
        self._engine.mount(indentor)

    def home(self) -> None:
        self._engine.home()

    def zero(self) -> None:
        self._engine.zero()

    def move_to(self, *, x_mm: float) -> None:
        self._engine.move_to(x_mm)

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
        return indent(self._engine, target, increments=increments, speed_mm_s=speed_mm_s, hold_s=hold_s)

    def retract(self) -> None:
        self._engine.retract()

    def note(self, text: str) -> None:
        self._engine.note(text)
