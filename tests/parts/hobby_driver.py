"""A stage that is not there: a hobby board that speaks GRBL under a name of its own. Source: this file."""

from rig.devices.base import StageError
from rig.devices.grbl import GrblStage


class HobbyStage(GrblStage):
    """Stage over the hobby board; no other board is taken for it."""

    def connect(self) -> str:
        """The board's identity. Raises StageError."""
        name = super().connect()
        if "hobby" not in name:
            raise StageError(f"expected a hobby board, found {name}")
        return name
