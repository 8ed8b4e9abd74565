"""The reference of the accuracy study, and whether a further level lands inside its error bars.

.venv/bin/python bench/reference.py            # writes sim/data/study_reference.json; 8 GB, a quarter of an hour
"""

import json
from pathlib import Path

import numpy as np

from sim.study.candidates import Candidate, nested
from sim.study.measure import QUANTITIES, Measured, measure
from sim.study.reference import FILE, Reference, as_json, extrapolated
from sim.study.scenes import FAMILIES, SCENES

COARSE, FINE = nested(3), nested(4)
FURTHER = nested(5, dermis_spacing_mm=0.1, growth=1.12, far_growth=1.25, near_spacing_mm=0.25, far_spacing_mm=0.75)
"""Left out of the extrapolation: finer where sharp edges need it, across the finger and through the epidermis."""

DATA = Path(__file__).parents[1] / "sim" / "data" / FILE


def combined(coarse: Measured, fine: Measured, further: Measured) -> Reference:
    """The reference and what is known about it."""
    ratio = coarse.candidate.mesh.spacing_mm / fine.candidate.mesh.spacing_mm
    provenance = {
        "command": "bench/reference.py",
        "levels": {
            name: {"nodes": level.nodes, "mesh": level.candidate.mesh.model_dump(mode="json")}
            for name, level in {"coarse": coarse, "fine": fine, "further": further}.items()
        },
    }
    reference = extrapolated(coarse.answers, fine.answers, ratio, provenance)
    return Reference(reference.values, reference.bars, {**provenance, "further": landings(reference, further)})


def landings(reference: Reference, further: Measured) -> dict[str, dict[str, dict[str, float]]]:
    """By family and quantity: the longest bar, the further level's largest deviation, and how many lie inside."""
    out: dict[str, dict[str, dict[str, float]]] = {}
    for family in FAMILIES:
        scenes = [scene for scene in further.answers if scene.family == family]
        out[family] = {}
        for quantity in QUANTITIES:
            off = [reference.error(scene, quantity, further.answers[scene]) for scene in scenes]
            bars = [reference.bar(scene, quantity) for scene in scenes]
            inside = float(np.mean([o <= b for o, b in zip(off, bars, strict=True)]))
            out[family][quantity] = {"bar": max(bars), "further": max(off), "inside": inside}
    return out


def main() -> None:
    """Compute, print and store."""
    levels = list(measure([Candidate("finger", name, mesh) for name, mesh in
                           (("coarse", COARSE), ("fine", FINE), ("further", FURTHER))], SCENES))  # fmt: skip
    reference = combined(*levels)
    DATA.write_text(as_json(reference), encoding="utf-8")
    print(json.dumps(reference.provenance["further"], indent=1))


if __name__ == "__main__":
    main()
