"""How often the shape test is wrong: on random smooth profiles, and on simulated ones that are perturbed.

.venv/bin/python -m studies.source.shape_test_errors    # the tables of docs/validation/comparison.md; fixed seeds
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.compare.profile_shape_test import (
    ShapePositions,
    candidates_by_chance,
    chance_rows,
    passed_by_chance,
    shape_flags,
    smooth_profiles,
)
from rig.compare.stimuli import StimulusRow
from rig.report.page_parts import Section
from sim.models.fingertip import Fingertip
from studies.source.printed.steps import POSITIONS_MM
from studies.source.simulated_stimuli import bars, stimulus

Array = NDArray[np.float64]

SMOOTH_OVER_MM = (0.25, 0.5, 1.0, 2.0)
DRAWS = 4000
PARTS = (0.01, 0.02, 0.05, 0.1)
PERTURBED = {"smooth over 0.5 mm": 0.5, "at each position by itself": 1e-3}
EACH = 40
BUMP_MM = 0.6


def source_stimuli(finger: Fingertip) -> list[StimulusRow]:
    """The steps at 2.33 gwt at the protocol's positions, and both bars at DOI 1.0."""
    three = [stimulus(finger, f"step:{n}", np.sort(x_mm), "force_gwt", 2.33) for n, x_mm in POSITIONS_MM.items()]
    return [*three, *bars(finger)]


def by_chance_section(stimuli: Sequence[StimulusRow]) -> Section:
    """Random smooth profiles at the positions of each stimulus, and unrelated responses that would be candidates."""
    schedules = [ShapePositions(s.indentor, s.x_mm) for s in stimuli]
    steps = [one for one in schedules if one.shape.startswith("step")]
    receptors = stimuli[0].receptor_mm
    rows = []
    for over_mm in SMOOTH_OVER_MM:
        shares = [passed_by_chance(one, over_mm, draws=DRAWS) for one in schedules]
        shares += [candidates_by_chance(some, receptors, over_mm, draws=DRAWS) for some in (steps, schedules)]
        rows.append((f"{over_mm:g} mm", *map(_percent, shares)))
    own = [row["smooth_over_mm"] for row in chance_rows(stimuli)]
    rows.append(("as its own", *(_percent(passed_by_chance(s, o, draws=DRAWS)) + f" at {o:.2g} mm"
                                 for s, o in zip(schedules, own, strict=True)), "–", "–"))  # fmt: skip
    return Section(
        "Random smooth profiles that pass the shape test",
        f"Percent of {DRAWS} (standard error 0.8 or less), by what they are smooth over; as its own: as smooth as "
        "the simulated profiles of that stimulus. The last two columns: a response that moves with the skin, "
        "unrelated from shape to shape, would be a candidate.",
        (
            "smooth over",
            *(f"{one.shape}, {len(one.x_mm)} positions" for one in schedules),
            "candidate under the steps",
            "under steps and bars",
        ),
        tuple(rows),
    )


def perturbed_section(stimuli: Sequence[StimulusRow]) -> Section:
    """What perturbations of a profile do to its verdict."""
    rng = np.random.default_rng(2024)
    families = [[s for s in stimuli if s.family == family] for family in ("step", "bar")]
    rows = []
    for how, over_mm in PERTURBED.items():
        for part in PARTS:
            cells = [cell for some in families for cell in _gained_and_lost(some, over_mm, part, rng)]
            bumps = [_bump_passes(some, over_mm, part, rng) for some in families]
            rows.append((how, f"{100 * part:g} %", *map(_percent, (*cells, *bumps))))
    return Section(
        "Perturbed profiles",
        "Every simulated profile of 18 measures at 10 receptors, with a perturbation whose standard deviation is a "
        f"part of the profile's range, {EACH} times each: percent of those that fail that then pass, and of those "
        f"that pass that are lost. One bump: a Gaussian of {BUMP_MM:g} mm at x = 0, which has neither dip nor second "
        "peak, and passes.",
        ("perturbed", "by", "steps: gained", "lost", "bars: gained", "lost", "one bump, steps", "bars"),
        tuple(rows),
    )


def _gained_and_lost(stimuli: Sequence[StimulusRow], over_mm: float, part: float, rng: np.random.Generator) -> Array:
    gained, lost = [], []
    for one in stimuli:
        profiles = np.moveaxis(one.measures, 1, -1).reshape(-1, len(one.x_mm))
        before = _flags(one, profiles)
        after = _flags(one, _perturbed(one, profiles, over_mm, part, rng))
        gained.append(after[:, ~before].ravel())
        lost.append(~after[:, before].ravel())
    return np.array([np.concatenate(found).mean() for found in (gained, lost)])


def _bump_passes(stimuli: Sequence[StimulusRow], over_mm: float, part: float, rng: np.random.Generator) -> float:
    found = []
    for one in stimuli:
        bump = np.broadcast_to(np.exp(-0.5 * (one.x_mm / BUMP_MM) ** 2), (25, len(one.x_mm)))
        found.append(_flags(one, _perturbed(one, bump, over_mm, part, rng)).ravel())
    return float(np.concatenate(found).mean())


def _perturbed(one: StimulusRow, profiles: Array, over_mm: float, part: float, rng: np.random.Generator) -> Array:
    """(EACH, N, n)."""
    noise = smooth_profiles(one.x_mm, over_mm, EACH * len(profiles), rng).reshape(EACH, *profiles.shape)
    return profiles + part * np.ptp(profiles, axis=-1)[:, None] * noise


def _flags(one: StimulusRow, profiles: Array) -> NDArray[np.bool_]:
    found = shape_flags(one.indentor, one.x_mm, profiles)
    assert found is not None
    return found


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"


def main() -> None:
    """Print the tables."""
    stimuli = source_stimuli(Fingertip.load())
    for section in (by_chance_section(stimuli), perturbed_section(stimuli)):
        print(f"{section.text}\n\n| {' | '.join(section.header)} |\n|{'---|' * len(section.header)}")
        print("\n".join(f"| {' | '.join(row)} |" for row in section.rows), end="\n\n", flush=True)


if __name__ == "__main__":
    main()
