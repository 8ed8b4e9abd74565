"""Measured candidates as the rows that `rig bench --json` prints, and the sets of candidates that it measures."""

from collections.abc import Iterable, Iterator
from typing import Any

from sim.config.fingertip_config import MeshSpec
from sim.speed_and_error.candidates import QUADRATIC, Candidate, coarse, nested
from sim.speed_and_error.measure import QUANTITIES, Measured
from sim.speed_and_error.reference import Reference

PER_LENGTH = frozenset({"section"})
"""Models whose force is per length: it has no error against a finger's."""

QUICK = (
    Candidate("halfspace", "0.28 mm", coarse(0.28)),
    Candidate("section", "0.28 mm", coarse(0.28)),
    Candidate("section", "n = 3", nested(3)),
    Candidate("finger", "0.28 mm", coarse(0.28)),
    Candidate("finger", "n = 2", nested(2)),
    Candidate("finger", "0.28 mm", coarse(0.28, "full")),
    Candidate("finger", "n = 2", nested(2, element="full")),
    Candidate("finger", "0.28 mm", coarse(0.28, "incompatible")),
    Candidate("finger", "n = 2", nested(2, element="incompatible")),
    Candidate("finger", "n = 1", nested(1, element="quadratic")),
)
WHOLE = (
    *QUICK,
    Candidate("halfspace", "default"),
    Candidate("section", "default"),
    Candidate("section", "n = 5", nested(5)),
    Candidate("finger", "n = 3", nested(3)),
    Candidate("finger", "n = 3", nested(3, element="full")),
    Candidate("finger", "0.34 mm", QUADRATIC),
    Candidate("finger", "0.34 mm, two in the epidermis", QUADRATIC.model_copy(update={"epidermis_elements": 2})),
    Candidate("finger", "default"),
    Candidate("finger", "default", MeshSpec(element="full")),
    Candidate("finger", "default", MeshSpec(element="incompatible")),
    Candidate("finger", "default, axial 0.17", MeshSpec(axial_spacing_mm=0.17)),
    Candidate("finger", "fine", MeshSpec(level="fine")),
)


def rows(measured: Iterable[Measured], reference: Reference) -> Iterator[dict[str, Any]]:
    """One for each scene and quantity; `seconds` from nothing to the answer, `error` relative."""
    for found in measured:
        for scene, answer in found.answers.items():
            for quantity in QUANTITIES:
                if quantity == "force" and found.candidate.model in PER_LENGTH:
                    continue
                yield {
                    "model": found.candidate.model,
                    "element": found.candidate.element,
                    "refinement": found.candidate.refinement,
                    "nodes": found.nodes,
                    "scene": scene.name,
                    "family": scene.family,
                    "quantity": quantity,
                    "error": reference.error(scene, quantity, answer),
                    "seconds": found.build_s + answer.seconds,
                    "contact_s": answer.seconds,
                    "memory_mb": found.memory_mb,
                }
