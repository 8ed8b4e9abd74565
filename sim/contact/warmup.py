"""Contact loops loaded with a finger: from disk in tenths of a second, or compiled with a message."""

import logging
from functools import cache

import numba.core.event as numba_events
import numpy as np

from sim.announce import taking_long
from sim.contact.indentor import Indentor, Revolved
from sim.contact.measured_profile import MeasuredProfile
from sim.contact.patch import Patch
from sim.contact.points import ContactPose
from sim.contact.profiles import Cylinder, SinusoidalStep
from sim.contact.solver import solve_contact

_log = logging.getLogger(__name__)

_SPACING_MM, _DEEP_MM = 0.2, 0.05


class _Compiling(numba_events.Listener):
    """Listener that logs the first compilation."""

    def __init__(self) -> None:
        self.reported = False

    def on_start(self, event: numba_events.Event) -> None:
        """Log before the first function is compiled."""
        if not self.reported:
            _log.info("compiling the contact loops for this machine, once …")
        self.reported = True

    def on_end(self, event: numba_events.Event) -> None:
        """Do nothing after it."""


@cache
def make_ready() -> None:
    """Load or compile all contact loops by pressing a patch of a few nodes. Does nothing a second time."""
    with taking_long("loading the contact loops …"), numba_events.install_listener("numba:compile", _Compiling()):
        for profile in (SinusoidalStep("1"), MeasuredProfile("two points", (-1.0, 1.0), (0.0, 0.0))):
            profile.evaluate(np.zeros(1))
            profile.tangent(np.zeros(1), np.zeros(1))  # a loop that another one called is not loaded with it
        Revolved("ball", Cylinder(1.0)).evaluate(np.zeros((2, 1)))
        pose = ContactPose(Indentor.along(Cylinder(1.0)), (0.0,), -_DEEP_MM, _DEEP_MM)
        solve_contact(_few_nodes(), pose, between_nodes=True)


def _few_nodes() -> Patch:
    """Return a level patch of three by five nodes whose compliance decays with distance."""
    z, x = (
        coordinate.ravel() for coordinate in np.meshgrid(np.arange(-1.0, 2.0), np.arange(-2.0, 3.0), indexing="ij")
    )
    position = _SPACING_MM * np.stack([x, np.zeros_like(x), z], axis=1)
    near = np.exp(-np.linalg.norm(position[:, None] - position[None], axis=2) / _SPACING_MM)
    return Patch(position, np.ones(len(x)), (3, 5), compliance=np.kron(np.eye(2), near))
