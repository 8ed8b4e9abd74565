"""Tissue that relaxes, against closed forms, and the cost of a step: tables of docs/validation/tissue.md.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.verification.in_time    # about two minutes

Errors are the largest over a way, in percent of the elastic force at its deepest; steps are those in a relaxation
time.
"""

import time

import numpy as np

from sim.contact.patch import Patch
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.relaxation import Prony, PronyTerm
from sim.models.viscoelastic import InTime
from studies.verification import relaxing_contact as exact

NODES = 33
STEPS = (5, 10, 20, 40)
SHAPES = ("cylinder:9", "bar:3.0", "step:1", "sphere:5")
TISSUE = Prony([PronyTerm(0.2, 0.07), PronyTerm(0.2, 1.4)])


def main() -> None:
    """Print both tables."""
    skin = exact.flat_skin(NODES)
    elastic = exact.elastic(skin)
    print("| steps in τ | ramp and hold (Lee & Radok) | and back (Ting) | creep at held force |\n|---|---|---|---|")
    for steps in STEPS:
        errors = (_of_growing(skin, elastic, steps), _of_shrinking(skin, elastic, steps), _of_creep(steps))
        print(f"| {steps} | " + " | ".join(f"{100 * error:.2f} %" for error in errors) + " |", flush=True)
    print("\n| indentor | elastic, from the last depth | a step of time there | ratio |\n|---|---|---|---|")
    for shape in SHAPES:
        once_ms, step_ms = _cost(load("finger"), shape)
        print(f"| {shape} | {once_ms:.1f} ms | {step_ms:.1f} ms | {step_ms / once_ms:.1f} |", flush=True)


def _of_growing(skin: Patch, elastic: float, steps: int) -> float:
    way = exact.up_and_held(steps)
    times_s = np.cumsum([step_s for step_s, _ in way])
    found = exact.pressed_along(skin, way) / elastic
    return float(np.abs(found - [exact.growing(t_s) for t_s in times_s]).max())


def _of_shrinking(skin: Patch, elastic: float, steps: int) -> float:
    way = exact.up_and_down(steps)
    times_s = np.cumsum([step_s for step_s, _ in way])[steps:]
    found = exact.pressed_along(skin, way)[steps:] / elastic
    return float(np.abs(found - [exact.shrinking(t_s) for t_s in times_s]).max())


def _of_creep(steps: int) -> float:
    """Of the depth after two relaxation times, relative to it."""
    finger, force_gwt = load("halfspace"), 1.0
    press = InTime(finger, "cylinder:9", exact.SERIES)
    press.to_force(0.0, force_gwt)
    for _ in range(2 * steps):
        now = press.to_force(exact.TERM.tau_s / steps, force_gwt)
    expected = finger.indent("cylinder:9", force_gwt=exact.crept(now.t_s) * force_gwt)
    return abs(now.doi_mm / expected.doi_mm - 1)


def _cost(finger: Fingertip, shape: str) -> tuple[float, float]:
    """Milliseconds of a press that goes on from one 0.02 mm above it, elastic and in time; medians, interleaved."""
    depths_mm = np.arange(0.1, 0.6, 0.02)
    elastic_ms, in_time_ms = [], []
    press, state = InTime(finger, shape, TISSUE), None
    for doi_mm in depths_mm:
        began = time.process_time()
        state = finger.indent(shape, doi_mm=doi_mm, start=state).state
        between = time.process_time()
        press.to_depth(0.05, doi_mm)
        elastic_ms.append(1e3 * (between - began))
        in_time_ms.append(1e3 * (time.process_time() - between))
    return float(np.median(elastic_ms)), float(np.median(in_time_ms))


if __name__ == "__main__":
    main()
