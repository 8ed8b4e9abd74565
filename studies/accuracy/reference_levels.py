"""The reference of the accuracy study, and how far a further level is off beside its error bars.

.venv/bin/python -m studies.accuracy.reference_levels    # 8 GB, a quarter of an hour

Writes sim/data/reference_answers.json.
"""

import json
from dataclasses import replace
from pathlib import Path

from sim.benchmark import FILE, SCENES, Candidate, Measured, ReferenceValues, as_json, from_levels, measure, nested

COARSE, FINE = nested(3), nested(4)
FURTHER = nested(5, dermis_spacing_mm=0.1, growth=1.12, far_growth=1.25, near_spacing_mm=0.25, far_spacing_mm=0.75)
"""Left out of the reference: finer where sharp edges need it, across the finger and through the epidermis."""

DATA = Path(__file__).parents[2] / "sim" / "data" / FILE


def combined(coarse: Measured, fine: Measured, further: Measured) -> ReferenceValues:
    """The reference and what is known about it."""
    about = {
        "command": "python -m studies.accuracy.reference_levels",
        "levels": {
            name: {"nodes": level.nodes, "mesh": level.candidate.mesh.model_dump(mode="json")}
            for name, level in {"coarse": coarse, "fine": fine, "further": further}.items()
        },
    }
    reference = from_levels(coarse.answers, fine.answers, about)
    return replace(reference, provenance={**about, "further": reference.largest_errors(further.answers)})


def main() -> None:
    """Compute, print and store."""
    levels = list(measure([Candidate("finger", name, mesh) for name, mesh in
                           (("coarse", COARSE), ("fine", FINE), ("further", FURTHER))], SCENES))  # fmt: skip
    reference = combined(*levels)
    DATA.write_text(as_json(reference), encoding="utf-8")
    print(f"bars:    {json.dumps(reference.bars)}\nfurther: {json.dumps(reference.provenance['further'])}")


if __name__ == "__main__":
    main()
