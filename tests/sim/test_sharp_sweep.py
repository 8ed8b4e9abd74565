"""Every scene converges: each thirteenth of the sharp sweep, a draw of random poses, and poses that once did not."""

from collections.abc import Iterator
from itertools import product

import numpy as np
import pytest

from sim.contact.measured_profile import MeasuredProfile
from sim.contact.profiles import Bar, Grating, IndentorProfile, SinusoidalStep, Wedge
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from studies.accuracy.random_poses import FAMILIES, touches_an_edge
from studies.accuracy.random_poses import solved as draw

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


@pytest.mark.parametrize("group", groups())
def test_every_sharp_scene_converges(unwidened: Fingertip, group: str) -> None:
    # 1e-10 is the solver's aim, 1e-8 what is required; 13 has no factor in common
    # with the numbers of depths, places and shapes, so that all of them occur.
    scenes = groups()[group][::13]
    results = list(solved(unwidened, scenes))
    assert len(results) >= 0.9 * len(scenes)  # the rest would leave the patch
    missed = [(scene, r.state.residual) for scene, r in results if r.state.residual > 1e-10]
    assert not missed


# --- a draw of random poses ---

POSES = 45


def test_every_random_pose_of_a_sharp_indentor_converges(unwidened: Fingertip) -> None:
    # The solver aims at 1e-10 and is required to reach 1e-8; `make bench` draws 2 000 such poses.
    solved = list(draw(unwidened, POSES, seed=1))
    missed = [(scene, r.state.residual) for scene, r in solved if r.state.residual > 1e-10]
    assert not missed
    active = np.array([r.state.active.sum() for _, r in solved])
    assert (active >= 20).mean() >= 0.8
    assert np.mean([touches_an_edge(r) for _, r in solved]) >= 0.25
    assert {scene.family for scene, _ in solved} == set(FAMILIES)


@pytest.mark.parametrize(
    ("profile", "x_mm", "doi_mm"),
    [
        (Bar(3.0), -0.6759254842383955, 0.7679173323734516),  # ran out of passes while the trust could only shrink
        (Bar(0.5819619459771768, 0.2), -0.1727, 0.8871),  # the same
        (Grating(1.3028907650456942, 1.8551575955394137), 0.3836285968378259, 0.8542953737583466),  # turned normals
        # a shortened step had turned aside: 2e-5, 4e-5 and 6e-5 after 120 passes, pressed in finely too
        (SinusoidalStep("1"), -1.63, 0.86),
        (SinusoidalStep("1"), -1.63, 0.91),
        (Grating(0.5, 1.2), 0.1, 1.01),
    ],
)
def test_formerly_divergent_poses_converge(
    finger: Fingertip, profile: IndentorProfile, x_mm: float, doi_mm: float
) -> None:
    assert finger.indent(profile, x_mm, doi_mm=doi_mm).state.residual <= 1e-10
