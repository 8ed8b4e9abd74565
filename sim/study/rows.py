"""Measured candidates as the rows that `rig bench --json` prints, and the sets of candidates that it measures."""

from collections.abc import Iterable, Iterator
from typing import Any

from sim.config import MeshSpec
from sim.study.candidates import Candidate, coarse
from sim.study.measure import QUANTITIES, Measured
from sim.study.reference import Reference

PER_LENGTH = frozenset({"section"})
"""Models whose force is per length: it has no error against a finger's."""

QUICK = (
    Candidate("halfspace", "0.3 mm", coarse(0.3)),
    Candidate("section", "0.3 mm", coarse(0.3)),
    Candidate("finger", "0.5 mm", coarse(0.5)),
    Candidate("finger", "0.35 mm", coarse(0.35)),
    Candidate("finger", "0.5 mm", coarse(0.5, "full")),
    Candidate("finger", "0.35 mm", coarse(0.35, "full")),
)
WHOLE = (
    *QUICK,
    Candidate("halfspace", "0.17 mm", coarse(0.17)),
    Candidate("section", "0.17 mm", coarse(0.17)),
    Candidate("finger", "0.25 mm", coarse(0.25)),
    Candidate("finger", "0.25 mm", coarse(0.25, "full")),
    Candidate("finger", "0.17 mm", coarse(0.17)),
    Candidate("finger", "0.17 mm", coarse(0.17, "full")),
    Candidate("finger", "default"),
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
