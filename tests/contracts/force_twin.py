"""A force sensor's virtual twin under a load, with its driver, configured as its byte table says."""

from collections.abc import Callable

from rig.bench.virtual import virtual_force, virtual_line
from rig.devices.base import ForceReading
from rig.devices.make_drivers import force_driver
from rig.plan.config import Config
from rig.transport import LoopbackTransport
from rig.units import GWT_N
from sim.devices import Load
from sim.devices.clock import VirtualClock
from tests.contracts.force import ForceBytes


class ForceTwin:
    """A twin under a load (g at a time in s) on its line, at a late hour of the clock; driver: not yet connected."""

    def __init__(self, device: ForceBytes, load_g: Callable[[float], float]) -> None:
        self.clock = VirtualClock(1.7e9, 1000.0)
        config = Config.model_validate({"force": {"kind": device.kind, **device.table}})
        self.line = virtual_line(self.clock, config.force)
        self.twin = virtual_force(self.clock, self.line, config, Load(lambda t_s: load_g(t_s) * GWT_N))
        self.driver = force_driver(lambda port: LoopbackTransport(self.line, self.clock, "wire"), self.clock, config)

    @staticmethod
    def grams(found: ForceReading) -> float:
        """What a reading weighs."""
        return found.force_n / GWT_N
