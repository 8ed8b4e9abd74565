"""How wrong each model and level is in the scenes of the reference, and the half-space's effective modulus.

.venv/bin/python -m studies.accuracy.model_errors    # some minutes

What `auto` goes by is measured in more scenes: `studies/choice/table.py`.
"""

from sim.benchmark import QUANTITIES, SCENES, Candidate, Measured, ReferenceValues, measure, stored
from sim.config import MeshSpec
from sim.models.halfspace import EFFECTIVE_MODULUS

SHIPPED = (
    Candidate("halfspace", "default"),
    Candidate("section", "default"),
    Candidate("finger", "coarse", MeshSpec(level="coarse")),
    Candidate("finger", "default"),
    Candidate("finger", "fine", MeshSpec(level="fine")),
)


def effective_modulus(halfspace: Measured, reference: ReferenceValues) -> float:
    """E / E(epidermis) with which the half-space carries the reference's force in the first scene."""
    scene = SCENES[0]
    return EFFECTIVE_MODULUS * float(reference.values[scene]["force"][0]) / halfspace.answers[scene].force_mm2


def main() -> None:
    """Measure and print."""
    reference = stored()
    measured = list(measure(SHIPPED, SCENES))
    modulus = effective_modulus(measured[0], reference)
    print(f"effective modulus of the half-space: {modulus:.4f} (in use: {EFFECTIVE_MODULUS})")
    for found in measured:
        for family, errors in reference.largest_errors(found.answers).items():
            told = ", ".join(f"{quantity} {100 * errors[quantity]:.1f} %" for quantity in QUANTITIES)
            print(f"{found.candidate.model}, {found.candidate.refinement}, {family}: {told}")


if __name__ == "__main__":
    main()
