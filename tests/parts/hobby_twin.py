"""The virtual twin of the hobby board."""

from sim.devices.clock import Scheduler
from sim.devices.grbl.board import VirtualGrbl
from sim.devices.line import SerialLine, VirtualStageSpec


class VirtualHobby(VirtualGrbl):
    """A GRBL board with a name of its own."""

    def _execute_at_rest(self, line: str, now_s: float) -> int | None:
        if line == "$I":
            return self._print("[VER:1.1h.hobby:]")
        return super()._execute_at_rest(line, now_s)


def hobby_twin(scheduler: Scheduler, line: SerialLine, told: VirtualStageSpec) -> VirtualHobby:
    """A board of the size that the bench has."""
    return VirtualHobby(scheduler, line, settings={130 + axis: mm for axis, mm in enumerate(told.travel_mm)})
