"""The table that `auto` goes by: largest errors by family, depth and place, and what each candidate costs.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.choice.table [EACH] [KEPT]    # half an hour of processor time, once

EACH scenes are drawn in every cell, pressed by each candidate on the patch that the scene is given, and held against
the fine level on the whole patch. Writes sim/data/expected_errors.json. What is done is a line of KEPT (default:
choice_table.jsonl), and is not done again until that is deleted.
"""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim.benchmark import LEVELS, PER_LENGTH, QUANTITIES, SHARES
from sim.cheapest_model import FILE, Cell, Rung, Situation, cell_of
from sim.contact.indentor import ACROSS, ALONG, BOTH
from studies.choice.answers import Row, Solver, answers, error, numbered
from studies.choice.drawn import DrawnScene, stratified

SEED, EACH = 9, 8
DATA = Path(__file__).parents[2] / "sim" / "data" / FILE

MARGIN = 1.25
"""The largest error of a few scenes is not the largest there is: chosen by leaving out one scene after the other."""

OWN = {
    "along, smooth": {"force": 0.003, "width": 0.013, "sed": 0.005, "ep1": 0.003},
    "along, sharp": {"force": 0.004, "width": 0.074, "sed": 0.017, "ep1": 0.011},
    "across, smooth": {"force": 0.003, "width": 0.013, "sed": 0.005, "ep1": 0.003},
    "across, sharp": {"force": 0.018, "width": 0.074, "sed": 0.028, "ep1": 0.012},
    "both, smooth": {"force": 0.003, "width": 0.013, "sed": 0.005, "ep1": 0.003},
    "both, sharp": {"force": 0.008, "width": 0.074, "sed": 0.034, "ep1": 0.017},
}
"""Error of the fine level against refined meshes: docs/validation/performance.md. Contact width was measured there
only under shapes along the finger, and smooth ones across it not at all: taken to be the same."""

Errors = Mapping[str, float]
Known = Mapping[tuple[str, int], Row]


def truth(axes: tuple[int, ...]) -> Solver:
    """What the others are held against."""
    return Solver("finger", "fine", axes, SHARES[-1])


def rungs(axes: tuple[int, ...]) -> list[Rung]:
    """Those that may be chosen, from the coarsest; a section is for shapes along the finger."""
    simple = [Rung("halfspace", "default"), *([Rung("section", "default")] if axes == ALONG else [])]
    return [*simple, *(Rung("finger", level) for level in LEVELS)]


def shares(rung: Rung) -> tuple[float, ...]:
    """Of the patch; the fine level is what the others are held against, on the whole of it."""
    return SHARES if rung.level != "fine" else SHARES[-1:]


def candidates(situation: Situation) -> list[Solver]:
    """The same on the patch that a scene is given."""
    axes = situation.axes
    given = {rung: next(s for s in shares(rung) if s >= situation.share) for rung in rungs(axes)}
    return [Solver(*rung, axes, share) for rung, share in given.items()]


def errors_of(scenes: Sequence[DrawnScene], known: Known) -> dict[Cell, list[dict[Rung, Errors]]]:
    """Of every scene that the whole patch holds; of a candidate whose patch does not, none."""
    found: dict[Cell, list[dict[Rung, Errors]]] = {}
    for n, scene in enumerate(scenes):
        situation = scene.situation
        cell, right = cell_of(situation), known[truth(situation.axes).name, n]
        if cell is not None and "refused" not in right:
            solved = {Rung(s.model, s.level): known[s.name, n] for s in candidates(situation)}
            found.setdefault(cell, []).append(
                {rung: _errors(row, right) for rung, row in solved.items() if "refused" not in row}
            )
    return found


def _errors(row: Row, right: Row) -> Errors:
    return {quantity: error(row, right, quantity, by_force=False) for quantity in QUANTITIES}


def expected(cell: Cell, scenes: Sequence[Mapping[Rung, Errors]]) -> dict[Rung, dict[str, float]]:
    """The largest errors with their margin; what the fine level is off by itself is added to it.

    No level promises more than a finer one.
    """
    found = {}
    for rung in {rung: None for scene in scenes for rung in scene}:
        some = [scene[rung] for scene in scenes if rung in scene]
        own = OWN[cell.family] if rung == Rung("finger", "fine") else dict.fromkeys(QUANTITIES, 0.0)
        found[rung] = {q: own[q] + MARGIN * max(errors[q] for errors in some) for q in QUANTITIES}
    least: Errors = dict.fromkeys(QUANTITIES, 0.0)
    for rung in (Rung("finger", level) for level in reversed(LEVELS) if Rung("finger", level) in found):
        found[rung] = {q: max(found[rung][q], least[q]) for q in QUANTITIES}
        least = found[rung]
    return found


def costs(scenes: Sequence[DrawnScene], known: Known) -> Iterator[dict[str, Any]]:
    """Of every candidate on every patch; a press is the median over its scenes."""
    press: dict[tuple[str, bool], list[float]] = {}
    for n, scene in enumerate(scenes):
        situation = scene.situation
        for solver in {*candidates(situation), truth(situation.axes)}:
            row = known[solver.name, n]
            press.setdefault((solver.name, situation.sharp), []).extend([row["press_s"]] if "press_s" in row else [])
    for axes in (ALONG, ACROSS, BOTH):
        for rung in rungs(axes):
            for share in shares(rung):
                name = Solver(*rung, axes, share).name
                row, took = known[name, -1], [press.get((name, sharp)) or [0.0] for sharp in (False, True)]
                yield {
                    **{"model": rung.model, "level": rung.level, "axes": list(axes), "share": share},
                    **{"nodes": row["nodes"], "patch_nodes": row["patch_nodes"]},
                    **{part: round(row[part], 2) for part in ("build_s", "receptors_s", "memory_mb")},
                    **{"smooth_press_s": _median(took[0]), "sharp_press_s": _median(took[1])},
                }


def _median(seconds: Sequence[float]) -> float:
    return round(float(np.median(seconds)), 4)


def as_json(found: Mapping[Cell, Sequence[Mapping[Rung, Errors]]], cost: list[dict[str, Any]], each: int) -> str:
    """What `sim/cheapest_model.py` reads: a line for each row."""
    about = {
        "command": f"python -m studies.choice.table {each}",
        "seed": SEED,
        "largest": f"of {each} scenes, times {MARGIN:g}; held against level fine on the whole patch",
        "fine": "what it is off by itself is added: docs/validation/performance.md",
        "seconds": "of one thread, 2.6 GHz, machine busy; builds with ten receptors, receptors_s of which are theirs",
    }
    lists = {"errors": [_row(cell, scenes) for cell, scenes in sorted(found.items())], "costs": cost}
    parts = [f' "{name}": [\n  ' + ",\n  ".join(map(json.dumps, rows)) + "\n ]" for name, rows in lists.items()]
    return "{\n" + ",\n".join([f' "provenance": {json.dumps(about)}', *parts]) + "\n}\n"


def _row(cell: Cell, scenes: Sequence[Mapping[Rung, Errors]]) -> dict[str, Any]:
    largest = [
        {**rung._asdict(), "errors": {name: float(f"{value:.3g}") for name, value in _comparable(rung, errors)}}
        for rung, errors in expected(cell, scenes).items()
    ]
    return {**cell._asdict(), "scenes": len(scenes), "largest": largest}


def _comparable(rung: Rung, errors: Errors) -> list[tuple[str, float]]:
    """A section's force is per length, and has no error against a finger's."""
    return [(name, value) for name, value in errors.items() if name != "force" or rung.model not in PER_LENGTH]


def kept_word(found: Mapping[Cell, Sequence[Mapping[Rung, Errors]]]) -> float:
    """The share of errors that the other scenes of their cell foretell."""
    held = []
    for cell, scenes in found.items():
        for n, one in enumerate(scenes):
            others = [scene for k, scene in enumerate(scenes) if k != n]
            told = expected(cell, others)
            held += [errors[q] <= told[rung][q] for rung, errors in one.items() for q in ("force", "sed", "ep1")]
    return float(np.mean(held))


def main() -> None:
    """Measure what is missing, and write."""
    each = int(sys.argv[1]) if len(sys.argv) > 1 else EACH
    kept = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("choice_table.jsonl")
    scenes = stratified(each, SEED)
    situations = [scene.situation for scene in scenes]
    asked = {n: {truth(situation.axes), *candidates(situation)} for n, situation in enumerate(situations)}
    known = answers(numbered(scenes, asked, patch_gb=0), kept)
    found = errors_of(scenes, known)
    DATA.write_text(as_json(found, list(costs(scenes, known)), each), encoding="utf-8")
    print(f"{len(scenes)} scenes; one left out at a time, {100 * kept_word(found):.1f} % of errors are as expected")


if __name__ == "__main__":
    main()
