"""The entry of a GRBL board in the catalogue of devices."""

from rig.devices.bench_settings import BenchSettings
from rig.devices.kinds import Opener, StageKind
from rig.devices.stage.base import Stage
from rig.devices.stage.grbl.grbl_settings import expected_settings
from rig.devices.stage.grbl.grbl_stage import GrblStage
from rig.transport.clock import Clock


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    x, y, z = (settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in "xyz")
    return GrblStage(
        opener(settings.stage.port),
        clock,
        expected=expected_settings(settings),
        bounds=settings.bounds,
        output="off" if settings.sync.output == "drive" else settings.sync.output,
        backlash_mm=(x, y, z),
    )


DEVICE = StageKind(
    name="grbl",
    device="GRBL 1.1 board, or one with grblHAL",
    driver=_driver,
    outputs=("off", "coolant", "spindle"),
    inputs=("door", "hold"),
    twin="sim.devices.grbl.board:grbl_twin",
    tests=("tests/rig/test_grbl_driver.py", "tests/rig/test_grbl_conformance.py"),
)
