"""What is only known of linear tissue."""

from sim.config.fingertip_config import Tissue
from sim.models.errors import ModelRangeError


def refuse_stiffening(tissue: Tissue, what: str) -> None:
    """Raises ModelRangeError where tissue stiffens."""
    if tissue.stiffening > 0:
        raise ModelRangeError(f"finger.tissue.stiffening = {tissue.stiffening:g}: {what} is linear, expected 0")
