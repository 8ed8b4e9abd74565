"""What one press gave: where the indentor was when, and the forces read; and what relaxation makes of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.models.relaxing.moves import Moves

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Way:
    """An indentor on its way down, and when its force is asked for.

    It moves evenly in the first half of the time from one height to the next, and stays where it came to.
    """

    indentor: str
    x_mm: float  # as the stage has it
    t_s: Array  # (p,) until when it stays there
    height_mm: Array  # (p,) above where the apex is believed to be; of a way by depth, less the depth
    asked_s: Array  # (r,) when a force is asked for
    by_depth: bool = False  # heights are counted from first touch

    @property
    def lowest(self) -> NDArray[np.intp]:
        """(r,) which height it has then, or goes from."""
        return np.searchsorted(self.ended_s, self.asked_s + 1e-9, side="right") - 1

    @property
    def ended_s(self) -> Array:
        """(p,) when it came to the heights."""
        return np.asarray(self.t_s - 0.5 * np.diff(self.t_s, prepend=self.t_s[:1]))

    def fading(self, tau_s: float) -> Array:
        """(r, p) what a term of relaxation has left of elastic forces at the heights."""
        return Moves(self.ended_s, self.t_s - self.ended_s).fading(tau_s, self.asked_s, self.lowest)


@dataclass(frozen=True)
class Given:
    """A press as it was read: forces less the zero, gwt, and how well one reading is known."""

    way: Way
    force_gwt: Array  # (r,)
    noise_gwt: float  # sd of a reading
    zero_sd_gwt: float  # of what was taken off all of them
    zero_gwt: float = 0.0  # that
    contact_mm: float = 0.0  # height at which the touch found the skin

    @property
    def by_depth(self) -> Way:
        """The way from where the touch found the skin."""
        return replace(self.way, height_mm=self.way.height_mm - self.contact_mm, by_depth=True)


def nominal_way(indentor: str, x_mm: float, doi_mm: float, pace: "RampAndHold", shares: Sequence[float]) -> Way:
    """A press to a depth past first touch, asked for at shares of its ramp, and over its hold at the end."""
    steps = max(int(np.ceil(doi_mm / pace.increment_mm - 1e-9)), 1)
    heights = np.array([-doi_mm * k / steps for k in range(steps + 1)])
    t_s = np.array([pace.step_s * k for k in range(steps + 1)])
    at = np.unique([max(round(share * steps), 1) for share in shares])
    held = [float(t_s[-1]) + pace.hold_s * (k + 0.5) / pace.readings for k in range(pace.readings)]
    return Way(indentor, x_mm, t_s, heights, np.array([*t_s[at], *held]), by_depth=True)


@dataclass(frozen=True)
class RampAndHold:
    """How the bench presses: so far in so long, then held."""

    increment_mm: float = 0.05
    step_s: float = 0.15
    hold_s: float = 1.0
    readings: int = 6  # of a hold, that are foreseen
