"""Convergence at sharp shapes: every position of step 1, bars down to zero edge radius, gratings, wedges, hollows.

    .venv/bin/python -m studies.accuracy.sharp_sweep [EVERY]    # EVERY = 7: each seventh scene

Prints the table of docs/validation/hard_cases.md. Each scene is pressed from rest to its depth.
The tests run a thinned version of the same sweep.
"""

import sys
from collections.abc import Iterator
from itertools import product

import numpy as np

from sim.contact.measured_profile import MeasuredProfile
from sim.contact.profiles import Bar, Grating, IndentorProfile, SinusoidalStep, Wedge
from sim.contact.solver import TARGET_RESIDUAL
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from studies.accuracy.random_poses import ON_ITS_PATCH

Scene = tuple[IndentorProfile, float, float]  # profile, x and DOI in mm

STEP_POSITIONS_MM = np.append(np.arange(2.0, -3.7, -0.17), -3.7).round(2).tolist()
DOIS_MM = (0.05, 0.1, 0.2, 0.4, 0.73, 1.0)
OFFSETS_MM = (0.0, 0.06, -0.7)  # over the apex, a third of an element beside it, on the pad's flank
EDGE_RADII_MM = (0.2, 0.1, 0.05, 0.02, 0.01, 0.001, 0.0)
GROOVE = MeasuredProfile("two ridges", (-1.2, -0.6, 0.0, 0.6, 1.2), (0.4, 0.0, 0.25, 0.0, 0.4))
BOWL = MeasuredProfile("bowl", (-1.8, -1.2, 0.0, 1.2, 1.8), (0.0, 0.15, 0.4, 0.15, 0.0))
KINKS = (
    MeasuredProfile("ridge kink", (-1.5, 0.0, 1.5), (0.6, 0.0, 0.9), linear=True),
    MeasuredProfile("hollow kink", (-1.5, 0.0, 1.5), (0.0, 0.5, 0.1), linear=True),
    MeasuredProfile("zigzag", (-1.6, -0.8, 0.0, 0.8, 1.6), (0.3, 0.0, 0.3, 0.0, 0.3), linear=True),
)


def groups() -> dict[str, list[Scene]]:
    """Scenes by what makes them hard."""
    return {
        "step 1, x = 2 … −3.7": list(product([SinusoidalStep("1")], STEP_POSITIONS_MM, DOIS_MM)),
        **{f"bars, edge radius {r:g}": _over([Bar(w, r) for w in (3.0, 1.5)]) for r in EDGE_RADII_MM},
        "gratings": _over([Grating(0.3, 0.6), Grating(0.5, 1.2), Grating(0.5, 2.5), Grating(0.5, 1.2, 0.0)]),
        "wedges": _over([Wedge(a, r) for a, r in product((15.0, 45.0, 75.0), (0.05, 0.0))]),
        "concave": _over([GROOVE, BOWL]),
        "kinks": _over(KINKS),
    }


def _over(profiles: list[IndentorProfile] | tuple[IndentorProfile, ...]) -> list[Scene]:
    return list(product(profiles, OFFSETS_MM, DOIS_MM))


def solved(finger: Fingertip, scenes: list[Scene]) -> Iterator[tuple[Scene, IndentationResult]]:
    """Scenes that lie within the patch, each pressed from rest."""
    for profile, x, doi in scenes:
        try:
            yield (profile, x, doi), finger.indent(profile, x, doi_mm=doi)
        except ModelRangeError:
            continue


def main() -> None:
    """Print the table and the scenes that miss."""
    every = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    finger = Fingertip.load(ON_ITS_PATCH)
    columns = ("shape", "scenes", "residual > 1e-10", "worst residual", "passes, median / p99 / max",
               "processor ms, median / p95")  # fmt: skip
    print(f"| {' | '.join(columns)} |")
    print("|---|---|---|---|---|---|")
    for name, scenes in groups().items():
        results = list(solved(finger, scenes[::every]))
        residual = np.array([r.state.residual for _, r in results])
        passes = np.array([r.state.passes for _, r in results])
        ms = 1e3 * np.array([r.contact_s for _, r in results])
        spent = f"{np.median(passes):.0f} / {np.percentile(passes, 99):.0f} / {passes.max()}"
        took = f"{np.median(ms):.0f} / {np.percentile(ms, 95):.0f}"
        missed = int((residual > TARGET_RESIDUAL).sum())
        print(f"| {name} | {len(results)} | {missed} | {residual.max():.0e} | {spent} | {took} |", flush=True)
        for scene, r in results:
            if r.state.residual > TARGET_RESIDUAL:
                print(f"missed: {scene} residual {r.state.residual:.1e}", file=sys.stderr)


if __name__ == "__main__":
    main()
