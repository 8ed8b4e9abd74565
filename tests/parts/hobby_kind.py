"""The entry of the hobby board."""

from rig.devices.stage.hobby.hobby_stage import HobbyStage

from rig.clock import Clock
from rig.devices.base import Stage
from rig.devices.bench_settings import BenchSettings
from rig.devices.grbl_link import expected_settings
from rig.devices.registry import Opener, StageKind


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    return HobbyStage(opener(settings.stage.port), clock, expected=expected_settings(settings))


DEVICE = StageKind(
    name="hobby",
    device="hobby board",
    driver=_driver,
    twin="sim.devices.hobby:hobby_twin",
    tests=("tests/test_hobby.py",),
)
