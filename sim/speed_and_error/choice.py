"""The cheapest model that holds a tolerance, by the errors that `studies/accuracy/model_errors.py` measured."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from sim.contact.indentor import ALONG, Indentor
from sim.models.catalogue import ModelName
from sim.models.errors import ModelRangeError
from sim.speed_and_error.measure import Measured
from sim.speed_and_error.reference import Reference
from sim.speed_and_error.rows import rows
from sim.speed_and_error.scenes import SCENES

FILE = "model_errors.json"
SMOOTH, SHARP = ("smooth",), ("bar", "step")

_SIMPLE = ("halfspace", "section")
_DEEPEST_MM = max(scene.doi_mm for scene in SCENES)
_FARTHEST_MM = max(abs(scene.x_mm) for scene in SCENES)


class NoModelError(ModelRangeError):
    """No model is known to hold the tolerance."""


@dataclass(frozen=True)
class Choice:
    """A model, the level of its mesh, and what it promises."""

    model: ModelName
    level: str
    promised: float  # largest error measured in scenes of this kind, relative
    why: str


def choose(
    indentor: Indentor, x_mm: float, doi_mm: float | None, quantity: str, tolerance: float, *, per_length: bool
) -> Choice:
    """The first model, from cheap to dear, whose measured error holds; raises NoModelError with the best there is.

    A half-space or a section is trusted only within the range of the scenes it was measured in; a section only where
    a force per length is of use, and for shapes prismatic along the finger.
    """
    kind = SHARP if indentor.sharp else SMOOTH
    passed: list[str] = []
    for model, level, error in _ranked(kind, quantity):
        doubt = _doubt(model, indentor, x_mm, doi_mm, per_length=per_length)
        if doubt is None and error <= tolerance:
            return Choice(model, level, error, _why(model, level, kind, quantity, error, tolerance, passed))
        passed.append(f"{model} {level}: {doubt or f'{100 * error:.1f} %'}")
    raise NoModelError(
        f"no model is known to hold {100 * tolerance:g} % of {quantity} for {indentor.name} ({'; '.join(passed)})"
    )


def _doubt(
    model: ModelName, indentor: Indentor, x_mm: float, doi_mm: float | None, *, per_length: bool
) -> str | None:
    """Why a model's measured error says nothing about a scene, if it does not."""
    if model not in _SIMPLE:
        return None
    if indentor.axes != ALONG:
        return "not measured for this kind of shape"
    if doi_mm is None or doi_mm > _DEEPEST_MM or abs(x_mm) > _FARTHEST_MM:
        return f"measured only by DOI, up to {_DEEPEST_MM:g} mm, and for |x| ≤ {_FARTHEST_MM:g} mm"
    if model == "section" and not per_length:
        return "gives force per length only"
    return None


def _why(
    model: str, level: str, kind: tuple[str, ...], quantity: str, error: float, tolerance: float, passed: list[str]
) -> str:
    shapes = "sharp" if kind == SHARP else "smooth"
    return (
        f"{model}, level {level}: the largest error of {quantity} measured under {shapes} shapes is "
        f"{100 * error:.1f} %, the tolerance {100 * tolerance:g} %"
        + (f"; cheaper ones passed over: {'; '.join(passed)}" if passed else "")
    )


def _ranked(kind: tuple[str, ...], quantity: str) -> Iterator[tuple[ModelName, str, float]]:
    for row in sorted(_table(), key=lambda row: float(row["seconds"])):
        errors = [row["errors"][family].get(quantity) for family in kind]
        if None not in errors:
            yield row["model"], row["level"], max(errors)


@cache
def _table() -> list[dict[str, Any]]:
    return list(json.loads((files("sim") / "data" / FILE).read_text(encoding="utf-8"))["rows"])


def table_as_json(measured: Iterable[Measured], reference: Reference) -> str:
    """What `choose` reads: for each candidate the seconds, and the largest error by family and quantity."""
    lines = []
    for found in measured:
        errors: dict[str, dict[str, float]] = {}
        for row in rows([found], reference):
            of = errors.setdefault(row["family"], {})
            of[row["quantity"]] = max(of.get(row["quantity"], 0.0), row["error"])
        lines.append(
            {
                "model": found.candidate.model,
                "level": found.candidate.refinement,
                "nodes": found.nodes,
                "seconds": found.build_s + found.contact_s,
                "errors": errors,
            }
        )
    provenance = {"command": "python -m studies.accuracy.model_errors", "reference": dict(reference.provenance)}
    return json.dumps({"provenance": provenance, "rows": lines}, indent=1) + "\n"
