"""A stage that is not there: a hobby board that speaks GRBL under a name of its own. Source: this file."""

from rig.clock import Clock
from rig.devices.base import Stage, StageError
from rig.devices.grbl import GrblStage
from rig.devices.grbl_link import expected_settings
from rig.devices.registry import Opener, StageKind
from rig.settings import BenchSettings


class HobbyStage(GrblStage):
    """Stage over the hobby board; no other board is taken for it."""

    def connect(self) -> str:
        """The board's identity. Raises StageError."""
        name = super().connect()
        if "hobby" not in name:
            raise StageError(f"expected a hobby board, found {name}")
        return name


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    return HobbyStage(opener(settings.stage.port), clock, expected=expected_settings(settings))


DEVICE = StageKind(
    name="hobby",
    device="hobby board",
    driver=_driver,
    twin="sim.devices.hobby:hobby_twin",
    tests=("tests/test_hobby.py",),
)
