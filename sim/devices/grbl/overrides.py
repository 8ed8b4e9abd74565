"""Feed, rapid and spindle overrides: percentages that a pendant or another program may set at any time.

Source: GRBL 1.1 interface wiki; the 1.1h firmware: protocol.c, config.h (steps of 10 and 1, from 10 to 200).
"""

from dataclasses import dataclass, replace

from sim.devices.grbl.blocks import Share

FULL, LEAST, MOST = 100, 10, 200
_STEPS = {0x91: ("feed", 10), 0x92: ("feed", -10), 0x93: ("feed", 1), 0x94: ("feed", -1),
          0x9A: ("spindle", 10), 0x9B: ("spindle", -10), 0x9C: ("spindle", 1), 0x9D: ("spindle", -1)}  # fmt: skip
_VALUES = {
    0x90: ("feed", FULL),
    0x95: ("rapid", FULL),
    0x96: ("rapid", 50),
    0x97: ("rapid", 25),
    0x99: ("spindle", FULL),
}
OVERRIDE_BYTES = (*_STEPS, *_VALUES)


@dataclass(frozen=True)
class Overrides:
    """Per cent."""

    feed: int = FULL
    rapid: int = FULL
    spindle: int = FULL

    def after(self, byte: int) -> "Overrides":
        """What one real-time byte makes of them."""
        if byte in _VALUES:
            name, value = _VALUES[byte]
        else:
            name, step = _STEPS[byte]
            value = min(max(getattr(self, name) + step, LEAST), MOST)
        return replace(self, **{name: value})

    @property
    def share(self) -> Share:
        return Share(self.feed / FULL, self.rapid / FULL)

    def __str__(self) -> str:
        return f"{self.feed},{self.rapid},{self.spindle}"
