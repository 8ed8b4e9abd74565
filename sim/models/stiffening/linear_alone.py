"""What is only known of linear tissue."""

from sim.config.fingertip_config import Tissue
from sim.models.errors import ModelRangeError


def refuse_stiffening(tissue: Tissue, what: str) -> None:
    """Raises ModelRangeError where tissue stiffens."""
    if tissue.stiffening > 0:
        raise ModelRangeError(
            "finger.tissue.stiffening = {stiffening:g}: {what} is linear, expected 0",
            code="linear_alone",
            stiffening=tissue.stiffening,
            what=what,
        )
