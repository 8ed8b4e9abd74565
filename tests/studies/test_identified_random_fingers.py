"""A tenth of `docs/validation/identification.md`, other seeds: fingers that only the bench knows, over its bytes.

By the tables that come with the program, so that only the bench's fingers are to be built.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest

from rig.identify.adaptive_presses import with_reliable_touch
from rig.plan.config import Config
from sim.identification.next_press import PressAt
from sim.identification.predicted_forces import PredictedForces
from sim.identification.prior import REAL_KINDS, Prior
from sim.models.fingertip import Fingertip
from studies.identification.proof import identified
from studies.identification.random_fingers import AS_FINE, RandomFinger, inside, outside

KNOWN = with_reliable_touch(Config())
GOALS = (PressAt("cylinder:9", 0.0, 0.67), PressAt("cylinder:9", 0.8, 0.5), PressAt("sphere:6", -0.5, 0.5))
"""Of shapes that no identification presses."""

FIRST, INSIDE = 5000, 20
SLIPS = 5001


@cache
def _configured() -> Fingertip:
    return Fingertip.load(KNOWN.finger)


def _identified(drawn: RandomFinger) -> dict[str, Any]:
    return identified(
        drawn, PredictedForces.over(KNOWN.finger, Prior(kinds=REAL_KINDS), 1.8, 1.1), _configured(), KNOWN, GOALS
    )


@pytest.fixture(scope="module")
def rows() -> list[dict[str, Any]]:
    return [_identified(inside(KNOWN, FIRST + k, AS_FINE)) for k in range(INSIDE)]


def test_identification_predicts_forces_of_unpressed_shapes_within_ten_percent(rows: list[dict[str, Any]]) -> None:
    """Bounds of the whole proof; of 60 truths on 20 fingers 48 or more are in their bands of 90 %."""
    error, half = (np.abs(np.concatenate([row[key] for row in rows])) for key in ("error", "half"))
    assert np.median(error) <= 0.05
    assert np.quantile(error, 0.9) <= 0.10
    assert np.median(half) <= 0.08
    assert np.sum([row["covered"] for row in rows]) >= 48
    configured = np.abs(np.concatenate([row["configured_error"] for row in rows]))
    assert np.median(configured) > 5 * np.median(error)


def test_identification_takes_at_most_eight_gentle_presses_and_three_minutes(rows: list[dict[str, Any]]) -> None:
    for row in rows:
        assert row["ended"] is None
        assert 4 <= row["presses"] <= 8
        assert row["bench_s"] <= 180
        assert max(row["of_trip"]) <= 1
        assert row["highest_gwt"] <= 1.25 * 20


def test_at_most_one_in_twenty_fingers_is_rejected_as_no_finger(rows: list[dict[str, Any]]) -> None:
    assert sum(row["mismatch"] is not None for row in rows) <= 1


def test_identification_rejects_a_mount_that_slips() -> None:
    drawn = outside(KNOWN, SLIPS)
    assert drawn.kind == "mount slips"
    assert _identified(drawn)["mismatch"].startswith("no finger of the prior predicts these forces: ")
