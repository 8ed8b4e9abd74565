"""Where a GRBL board's work coordinates lie: G54 to G59, G92, the tool's length, and the stored G28 and G30.

Source: GRBL 1.1 interface wiki; the 1.1h firmware, gcode.c. All in machine millimetres.
"""

from dataclasses import dataclass, replace

from sim.devices.grbl.motion import Vec

ZERO: Vec = (0.0, 0.0, 0.0)
SYSTEMS = 6


@dataclass(frozen=True)
class Offsets:
    """What is stored, and what a reset forgets: G92 and the tool's length."""

    systems: tuple[Vec, ...] = (ZERO,) * SYSTEMS
    g28: Vec = ZERO
    g30: Vec = ZERO
    g92: Vec = ZERO
    length_mm: float = 0.0

    def of(self, system: int) -> Vec:
        """From machine zero to the zero of a work coordinate system, counted from 0 for G54."""
        x, y, z = (a + b for a, b in zip(self.systems[system], self.g92, strict=True))
        return (x, y, z + self.length_mm)

    def with_system(self, system: int, zero: Vec) -> "Offsets":
        systems = (*self.systems[:system], zero, *self.systems[system + 1 :])
        return replace(self, systems=systems)

    def after_reset(self) -> "Offsets":
        return replace(self, g92=ZERO, length_mm=0.0)
