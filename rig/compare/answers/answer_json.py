"""An answer as what `--json` prints."""

import math
from collections.abc import Sequence
from typing import Any

from rig.compare.answers.answer import Answer, Limits, PairRow, Together
from rig.compare.answers.methods import methods
from rig.compare.answers.wording import sentence, sentences

_DIGITS = 6


def answers_as_json(found: Sequence[Answer]) -> list[dict[str, Any]]:
    """One for each afferent; the same rows as on the page, likeliest first."""
    return [_as_json(answer) for answer in found]


def _as_json(answer: Answer) -> dict[str, Any]:
    headline, following = answer.headline, answer.next
    return {
        "stimuli": list(answer.stimuli),
        "recordings": list(answer.recordings),
        "positions": len(answer.places.rate),
        "positions_recorded": answer.recorded,
        "left_out": [{"stimulus": one.stimulus, "position_mm": list(one.position_mm)} for one in answer.left_out],
        "noise": answer.noise._asdict() | {"freedom": _number(answer.noise.freedom)},
        "outcome": answer.outcome,
        "answer": sentence(answer),
        "besides": sentences(answer),
        "set": [row.title for row in answer.set],
        "controls_in_set": [row.title for row in answer.controls_in_set],
        "headline": headline.title if headline else None,
        "next": following.title if following else None,
        "next_is_worse_by": _number(answer.worse_by),
        "ceiling": {"share": _number(answer.ceiling), "from": answer.ceiling_from},
        "together": _together(answer.together),
        "power": {
            "detectable_misfit": _number(answer.power.detectable),
            "mimics": [one._asdict() for one in answer.power.mimics],
        },
        "intervals": {name: _intervals(answer, name) for name in dict.fromkeys(row.name for row in answer.set)},
        "rows": [_row(row) for row in answer.rows],
        "fingers": answer.fingers,
        "methods": methods(answer),
    }


def _row(row: PairRow) -> dict[str, Any]:
    numbers = ("k", "eps0", "saturation", "r", "r2", "deviance", "lack_of_fit", "p_fit", "p_set", "left_out")
    return {
        "name": row.name,
        "control": row.control,
        "receptor_mm": row.receptor_mm,
        **{name: _number(getattr(row, name)) for name in numbers},
        "k_interval": _limits(row.k_interval),
        "eps0_interval": _limits(row.eps0_interval),
        "fits": row.fits,
        "in_set": row.in_set,
        "fires_unloaded": row.fires_unloaded,
        "finger": row.finger,
    }


def _intervals(answer: Answer, name: str) -> dict[str, Any]:
    return {"k": _limits(answer.interval(name, "k")), "eps0": _limits(answer.interval(name, "eps0"))}


def _together(found: Together | None) -> dict[str, Any] | None:
    if found is None:
        return None
    separate = [
        {"stimulus": one.stimulus, **{name: _number(getattr(one, name)) for name in ("k", "eps0", "left_out")}}
        for one in found.separate
    ]
    return {"ratio": _number(found.ratio), "p": _number(found.p), "separate": separate}


def _limits(found: Limits) -> list[float | None]:
    return [_number(value) for value in found]


def _number(value: float) -> float | None:
    """Six digits; NaN and infinities as None."""
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
