"""The virtual twin of the hobby board."""

from collections.abc import Callable
from functools import cached_property

from sim.devices.clock import Scheduler
from sim.devices.grbl.board import VirtualGrbl
from sim.devices.line import SerialLine, VirtualStageSpec


class VirtualHobby(VirtualGrbl):
    """A GRBL board with a name of its own."""

    @cached_property
    def _system_lines(self) -> dict[str, Callable[[], int | None]]:
        return {**super()._system_lines, "$I": lambda: self._print("[VER:1.1h.hobby:]")}


def hobby_twin(scheduler: Scheduler, line: SerialLine, told: VirtualStageSpec) -> VirtualHobby:
    """A board of the size that the bench has."""
    return VirtualHobby(scheduler, line, settings={130 + axis: mm for axis, mm in enumerate(told.travel_mm)})
