"""How wrong each model is, for `rig indent --model auto`, and the half-space's effective modulus.

.venv/bin/python -m studies.accuracy.model_errors    # writes sim/data/model_errors.json; some minutes
"""

from pathlib import Path

from sim.config.fingertip_config import MeshSpec
from sim.models.halfspace import EFFECTIVE_MODULUS
from sim.speed_and_error.candidates import Candidate
from sim.speed_and_error.choice import FILE, table_as_json
from sim.speed_and_error.measure import Measured, measure
from sim.speed_and_error.reference import Reference, stored
from sim.speed_and_error.scenes import SCENES

SHIPPED = (
    Candidate("halfspace", "default"),
    Candidate("section", "default"),
    Candidate("finger", "default"),
    Candidate("finger", "fine", MeshSpec(level="fine")),
)
DATA = Path(__file__).parents[2] / "sim" / "data" / FILE


def effective_modulus(halfspace: Measured, reference: Reference) -> float:
    """E / E(epidermis) with which the half-space carries the reference's force in the first scene."""
    scene = SCENES[0]
    return EFFECTIVE_MODULUS * float(reference.values[scene]["force"][0]) / halfspace.answers[scene].force_mm2


def main() -> None:
    """Measure, print the modulus and store the errors."""
    reference = stored()
    measured = list(measure(SHIPPED, SCENES))
    modulus = effective_modulus(measured[0], reference)
    print(f"effective modulus of the half-space: {modulus:.4f} (in use: {EFFECTIVE_MODULUS})")
    DATA.write_text(table_as_json(measured, reference), encoding="utf-8")


if __name__ == "__main__":
    main()
