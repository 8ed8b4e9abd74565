"""Tissue that stiffens and relaxes: the simulator in time beside a solve step by step at finite strain.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.stiffening.in_time         # docs/validation/relaxation.md
    OMP_NUM_THREADS=1 .venv/bin/python -m studies.stiffening.in_time FILE    # the reference's rows, some minutes

Every layer is Yeoh's and relaxes quasi-linearly (`studies/finite_strain/solver/relaxing.py`); the finger is pressed
down a ramp, held, withdrawn in part, and held; or its force is held. Forces are for E(epidermis) = 1 MPa.
"""

import json
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.relaxation import Prony, PronyTerm
from sim.models.viscoelastic import InTime
from studies.finite_strain.solver.laws import Yeoh
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.relaxing import PressInTime
from studies.finite_strain.solver.scene import Specimen
from studies.stiffening.fingers import finger
from studies.stiffening.references import read

KEPT = Path(__file__).parent / "kept" / "in_time.jsonl"
FINGER, STIFFENING = "default", 0.3
TISSUE = Prony([PronyTerm(0.2, 0.07), PronyTerm(0.2, 1.4)])
STEP_MM, DEEPEST_MM, WITHDRAWN_MM = 0.1, 1.0, 0.7
PARTS = ("ramp", "hold", "back", "rest")
HELD_S = (0.02, 0.08, 0.3, 0.8, 1.8)  # steps of time


class History(NamedTuple):
    """What is pressed how fast to 1 mm; then the depth is held and 0.3 mm are taken back as fast, or the force is."""

    shape: str
    speed_mm_s: float
    then: str = "depth"

    def steps(self) -> Iterator[tuple[str, float, float]]:
        """Part, seconds, and depth in mm; of a held force, the depth where it began."""
        yield from self._moved("ramp", 0.0, DEEPEST_MM)
        yield from (("hold", step_s, DEEPEST_MM) for step_s in HELD_S)
        if self.then == "depth":
            yield from self._moved("back", DEEPEST_MM, WITHDRAWN_MM)
            yield from (("rest", step_s, WITHDRAWN_MM) for step_s in HELD_S)

    def _moved(self, part: str, from_mm: float, to_mm: float) -> Iterator[tuple[str, float, float]]:
        count = round(abs(to_mm - from_mm) / STEP_MM)
        for k in range(1, count + 1):
            yield part, STEP_MM / self.speed_mm_s, round(from_mm + (to_mm - from_mm) * k / count, 6)


HISTORIES = (
    *(History(shape, speed) for shape in ("flat", "sphere:3") for speed in (10.0, DEEPEST_MM / 3)),
    History("flat", 10.0, "force"),
)


def rows(history: History) -> Iterator[dict[str, Any]]:
    """Of each step the force and the depth, and the elastic force of where the indentor was meant to be."""
    began, t_s, held = time.process_time(), 0.0, 0.0
    specimen, elastic = Specimen(finger(FINGER)), _elastic(history.shape)
    touch = specimen.touch(history.shape)
    press = PressInTime(specimen.body(Yeoh(STIFFENING)), TISSUE, specimen.skin, touch)
    for part, step_s, doi_mm in history.steps():
        if part == "hold" and history.then == "force":
            found = press.to_force(step_s, held)
        else:
            found = press.to_depth(step_s, doi_mm)
            held = found.force
        t_s += step_s
        where = {**history._asdict(), "part": part, "t_s": round(t_s, 6), "doi_mm": float(f"{found.doi_mm:.6g}")}
        forces = {"force": float(f"{found.force:.6g}"), "elastic": float(f"{elastic[doi_mm]:.6g}")}
        yield {**where, **forces, "cpu_s": round(time.process_time() - began, 1)}
        began = time.process_time()


@cache
def _elastic(shape: str) -> dict[float, float]:
    """Forces by depth of tissue that does not relax."""
    specimen = Specimen(finger(FINGER))
    depths_mm = [round(STEP_MM * k, 6) for k in range(1, round(DEEPEST_MM / STEP_MM) + 1)]
    pressed = presses(specimen.body(Yeoh(STIFFENING)), specimen.skin, specimen.touch(shape), depths_mm, STEP_MM)
    return {doi_mm: one.force for doi_mm, one in zip(depths_mm, pressed, strict=True)}


class Beside(NamedTuple):
    """A step of the reference and the simulator's: its depth, force and elastic force at that depth."""

    reference: Mapping[str, Any]
    doi_mm: float
    force: float
    elastic: float

    @property
    def elastic_error(self) -> float:
        """Of the elastic force, relative."""
        return float(self.elastic / self.reference["elastic"] - 1)

    @property
    def left(self) -> float:
        """What relaxation leaves of the reference's elastic force at the same depth."""
        return float(self.reference["force"] / self.reference["elastic"])

    @property
    def error(self) -> float:
        """Of what relaxation leaves."""
        return self.force / self.elastic - self.left

    @property
    def force_error(self) -> float:
        """Of the force, relative: both together."""
        return float(self.force / self.reference["force"] - 1)


def beside(history: History, kept: Sequence[Mapping[str, Any]]) -> list[Beside]:
    """The simulator along a history, on the same mesh; a force that is held is its own."""
    skin, held_gwt, found = _finger(), 0.0, []
    press = InTime(skin, history.shape, TISSUE)
    for (part, step_s, doi_mm), row in zip(history.steps(), kept, strict=True):
        if part == "hold" and history.then == "force":
            now = press.to_force(step_s, held_gwt)
        else:
            now = press.to_depth(step_s, doi_mm)
            held_gwt = now.force_gwt
        elastic_n = skin.indent(history.shape, doi_mm=doi_mm).force_n
        found.append(Beside(row, now.doi_mm, now.force_n / skin.e_epidermis_mpa, elastic_n / skin.e_epidermis_mpa))
    return found


@cache
def _finger() -> Fingertip:
    return load("finger", finger(FINGER, stiffening=STIFFENING), cached=False)


def of_history(history: History, kept: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Its rows."""
    return [row for row in kept if tuple(row[name] for name in History._fields) == tuple(history)]


def table(kept: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Largest errors of each part, percent, where the depth is held."""
    yield "| shape | ramp | elastic force | relaxation: ramp | hold | back | after it | force: pressed | then |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for history in HISTORIES:
        if history.then == "force":
            continue
        found = beside(history, of_history(history, kept))
        what = f"| {history.shape} | {DEEPEST_MM / history.speed_mm_s:g} s"
        parts = {name: [one for one in found if one.reference["part"] == name] for name in PARTS}
        worst = [max(parts[name], key=lambda one: abs(one.error)) for name in PARTS]
        pressed, then = ([one for name in names for one in parts[name]] for names in (PARTS[:2], PARTS[2:]))
        cells = [f"{100 * one.error:+.1f} of {100 * one.left:.0f}" for one in worst]
        forces = [max((one.force_error for one in some), key=abs) for some in (pressed, then)]
        elastic = max((one.elastic_error for one in found), key=abs)
        cells = [f"{100 * elastic:+.1f}", *cells, *(f"{100 * error:+.1f}" for error in forces)]
        yield f"{what} | {' | '.join(cells)} |"


def creep(kept: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """How far a held force creeps, the simulator's and the reference's."""
    yield f"| shape | ramp | creep in {sum(HELD_S):g} s | the reference's |"
    yield "|---|---|---|---|"
    for history in HISTORIES:
        if history.then == "force":
            last = beside(history, of_history(history, kept))[-1]
            crept = [f"{1e3 * (one - DEEPEST_MM):.1f} µm" for one in (last.doi_mm, last.reference["doi_mm"])]
            yield f"| {history.shape} | {DEEPEST_MM / history.speed_mm_s:g} s | {' | '.join(crept)} |"


def main(*to: str) -> None:
    """Append what is missing, or print the table."""
    for path in map(Path, to):
        kept = read(path)
        for history in HISTORIES:
            if not of_history(history, kept):
                for row in rows(history):
                    print(json.dumps(row), flush=True)
                    with path.open("a", encoding="utf-8") as out:
                        out.write(json.dumps(row) + "\n")
    if not to:
        print("\n".join([*table(read(KEPT)), "", *creep(read(KEPT))]))


if __name__ == "__main__":
    main(*sys.argv[1:])
