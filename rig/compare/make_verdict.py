"""Verdicts from recordings: every candidate is fitted once to one afferent, tested, and used for prediction."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.candidate_measures import Candidates, Fitted, by_monotone, by_repeats, detectable, tail
from rig.compare.comparison import Comparison, Joint, Overlay, Pair, left_out_line
from rig.compare.fit import Flags, by_pair, compared, correlation, fit_rates
from rig.compare.intervals import ConfidenceLimits, limits
from rig.compare.likelihood import Form, Observed, observed
from rig.compare.model_confidence_set import Predicted, imitated, predicted_left_out, set_probabilities
from rig.compare.plausible_fingers import PlausibleFingers
from rig.compare.stimuli import CONTROLS, StimulusRow
from rig.compare.verdict import (
    A_CONSTANT,
    LEVEL,
    AfferentVerdict,
    FittedPositions,
    LeftOut,
    Mimic,
    PairRow,
    Power,
    Separate,
    Together,
    titled,
)
from rig.compare.wider_run import WiderRun
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]

_NOT_KNOWN = ConfidenceLimits((np.nan, np.nan), (np.nan, np.nan))


def answers(comparison: Comparison, form: Form = Form()) -> tuple[AfferentVerdict, ...]:  # noqa: B008
    """Return one verdict for each afferent; none if the receptors in play cover too few positions."""
    found = [_answer(group, comparison, form) for group in afferents(comparison)]
    return tuple(one for one in found if one is not None)


def afferents(comparison: Comparison) -> list[tuple[Overlay, ...]]:
    """Return overlays by afferent: one, unless families have their own units or a recording has several."""
    if comparison.normalized:
        families = groupby(comparison.overlays, key=lambda p: p.stimulus.family)
        return [tuple(group) for _, group in families]
    laid = [id(overlay.recording) for overlay in comparison.overlays]
    if len(set(laid)) < len(laid):
        return [joint.overlays for joint in comparison.joints]
    return [comparison.overlays] if comparison.overlays else []


class _Named(NamedTuple):
    """Row of a pair: its name, whether it is a control, and its receptor (mm)."""

    name: str
    control: bool
    receptor_mm: float | None

    @property
    def title(self) -> str:
        """Title of the pair, as in tables."""
        return titled(self.name, self.receptor_mm)


class CandidatePool(NamedTuple):
    """Candidates of one afferent in one order, at the positions (of all) that are used."""

    named: list[_Named]
    observed: Observed
    candidates: Candidates
    used: Flags


class _Judged(NamedTuple):
    """Candidates with their fits and tests."""

    named: list[_Named]
    observed: Observed
    candidates: Candidates
    fit: Fitted
    left_out: Predicted
    ratio: Array
    p_fit: Array
    p_set: Array

    @property
    def measures(self) -> Flags:
        """Flags (N,) of measures, as opposed to controls."""
        return np.array([not one.control for one in self.named])

    @property
    def closest(self) -> int:
        """Number of the maximum-likelihood measure."""
        return int(np.argmin(np.where(self.measures, self.fit.found.total, np.inf)))


def _answer(overlays: Sequence[Overlay], comparison: Comparison, form: Form) -> AfferentVerdict | None:
    plausible = comparison.plausible
    pool = candidate_pool(overlays, form, with_fingers=plausible is not None)
    if pool is None:
        return None
    data = pool.observed
    noise = data.noise
    repeated = noise.source == "repeats"
    silent = AfferentVerdict(
        title=", ".join(overlay.stimulus.title for overlay in overlays),
        stimuli=tuple(overlay.stimulus.title for overlay in overlays),
        recordings=tuple(overlay.recording.name for overlay in overlays),
        places=FittedPositions(
            data.stimulus, data.position_mm, data.rate, np.sqrt(noise.dispersion * data.variance(data.rate))
        ),
        recorded=len(pool.used),
        left_out=_left_out(overlays, pool.used, comparison.wider),
        noise=noise,
        ceiling=np.nan,
        ceiling_from="repeats" if repeated else "monotone",
        rows=(),
        together=None,
        power=Power(np.nan, ()),
        saturating=form.saturating,
        silent_at_rest=form.silent_at_rest,
        fingers=len(pool.candidates.eps),
        spikes=data.spikes,
        rate_unit=overlays[0].recording.rate_unit,
        not_observed=tuple(
            f"{overlay.recording.name}: {overlay.recording.spikes.left_out}"
            for overlay in overlays
            if overlay.recording.spikes is not None and overlay.recording.spikes.lost_mm
        ),
    )
    if data.silent:
        return silent
    judged = _judged(pool)
    order = np.argsort(judged.fit.found.total, kind="stable")
    return replace(
        silent,
        ceiling=by_repeats(data) if repeated else by_monotone(judged.fit.eps, data),
        rows=tuple(_row(judged, int(n), plausible) for n in order),
        together=_together(judged, list(silent.stimuli)),
        power=_power(judged),
    )


def candidate_pool(overlays: Sequence[Overlay], form: Form, *, with_fingers: bool = False) -> CandidatePool | None:
    """Return measures, controls and a constant with the recordings, or None if too few positions are covered.

    Positions are those that every receptor in play covers.
    """
    eps = _eps(overlays, with_fingers=with_fingers)
    which = compared(eps[0])
    if which is None:
        return None
    receptors, used = which
    names = [*MEASURES, *CONTROLS][: eps.shape[1]]
    places = overlays[0].stimulus.receptor_mm[receptors]
    named = [_Named(name, name in CONTROLS, float(x)) for name in names for x in places]
    constant = np.zeros((len(eps), 1, int(used.sum())))
    pairs = np.concatenate([by_pair(eps[:, :, used][..., receptors]), constant], axis=1)
    data = observed([overlay.recording for overlay in overlays], used)
    return CandidatePool([*named, _Named(A_CONSTANT, True, None)], data, Candidates(pairs, form), used)


def joint_limits(joint: Joint, pairs: Sequence[Pair], *, with_fingers: bool = False) -> list[ConfidenceLimits | None]:
    """Return limits of pairs at receptors in play, over the recordings of a joint fit; rates do not saturate.

    None if the pair's own fit is rejected, and with too few positions.
    """
    pool = candidate_pool(joint.overlays, Form(), with_fingers=with_fingers)
    if pool is None or not pairs or pool.observed.silent:
        return [None] * len(pairs)
    data, receptor_mm = pool.observed, joint.overlays[0].stimulus.receptor_mm
    number = {(one.name, one.receptor_mm): n for n, one in enumerate(pool.named)}
    candidates = pool.candidates.only(np.array([number[MEASURES[m], float(receptor_mm[k])] for m, k in pairs]))
    fit = candidates.fitted(data)
    ratio, p = candidates.tested(data, fit)
    fits = (p >= LEVEL) & np.isfinite(fit.found.k)
    return [limits(candidates, data, fit, n, float(ratio[n])) if fits[n] else None for n in range(len(pairs))]


def _eps(overlays: Sequence[Overlay], *, with_fingers: bool) -> Array:
    """Return ε (fingers, 18 + controls, all positions, receptors); controls only if every stimulus has them."""
    each = [_with_controls(overlay, with_fingers=with_fingers) for overlay in overlays]
    fewest = min(one.shape[1] for one in each)
    return np.concatenate([one[:, :fewest] for one in each], axis=2)


def _with_controls(overlay: Overlay, *, with_fingers: bool) -> Array:
    measures = overlay.eps_on_fingers if with_fingers else overlay.eps[None]
    control = overlay.stimulus.controls_at(overlay.recording.position_mm)
    return np.concatenate([measures, np.broadcast_to(control, (len(measures), *control.shape))], axis=1)


def _judged(pool: CandidatePool) -> _Judged:
    named, data, candidates, _ = pool
    fit = candidates.fitted(data)
    p_set = set_probabilities(fit.found.deviance / data.noise.dispersion, data.stimulus)
    left_out = predicted_left_out(candidates, data)
    return _Judged(named, data, candidates, fit, left_out, *candidates.tested(data, fit), p_set)


def _row(judged: _Judged, n: int, plausible: PlausibleFingers | None) -> PairRow:
    data, fit, named = judged.observed, judged.fit, judged.named[n]
    found, eps, noise = fit.found, fit.eps[n], judged.observed.noise
    fits = judged.p_fit[n] >= LEVEL or n == judged.closest
    region = limits(judged.candidates, data, fit, n, float(judged.ratio[n])) if fits else _NOT_KNOWN
    error = np.sqrt(noise.dispersion * data.variance(found.mean[n]))
    return PairRow(
        **named._asdict(),
        k=float(found.k[n]),
        eps0=float(found.eps0[n]),
        saturation=float(found.saturation[n]),
        k_interval=region.k,
        eps0_interval=region.eps0,
        r=float(correlation(eps[None, :, None], data.rate)[0, 0]),
        r2=_least_squares_r2(eps, data.rate),
        deviance=float(found.total[n] / noise.dispersion),
        lack_of_fit=float(judged.ratio[n]),
        p_fit=float(judged.p_fit[n]),
        p_set=float(judged.p_set[n]),
        left_out=float(judged.left_out.share()[n]),
        eps=eps,
        predicted=found.mean[n],
        residual=(data.rate - found.mean[n]) / error,
        finger=None if plausible is None else plausible.values(fit.place[n]),
    )


def _least_squares_r2(eps: Array, rate: Array) -> float:
    total = float(((rate - rate.mean()) ** 2).sum())
    left = float(fit_rates(eps, rate).rss)
    return 1 - left / total if total > 0 else np.nan


def _left_out(overlays: Sequence[Overlay], used: Flags, wider: Mapping[StimulusRow, WiderRun]) -> tuple[LeftOut, ...]:
    """Return the positions that not every receptor in play covers."""
    ends = np.cumsum([len(overlay.recording.position_mm) for overlay in overlays])[:-1]
    found = []
    for overlay, mine in zip(overlays, np.split(used, ends), strict=True):
        position_mm, rate = overlay.recording.position_mm[~mine], overlay.recording.rate[~mine]
        if len(position_mm):
            line = left_out_line(overlay, wider.get(overlay.stimulus), mine)
            found.append(LeftOut(overlay.stimulus.title, tuple(position_mm.tolist()), tuple(rate.tolist()), line))
    return tuple(found)


def _together(judged: _Judged, stimuli: Sequence[str]) -> Together | None:
    """Compare separate fits with the joint fit, for the maximum-likelihood measure on the finger of its joint fit."""
    data, n = judged.observed, judged.closest
    numbers = np.unique(data.stimulus)
    if len(numbers) < 2:
        return None
    one = Candidates(judged.fit.eps[None, n : n + 1], judged.candidates.form)
    apart = 0.0
    separate = []
    for number in numbers:
        mine = data.stimulus == number
        found = one.fitted(data, mine).found
        apart += float(found.total[0])
        share = float(judged.left_out.share(mine)[n])
        separate.append(Separate(stimuli[number], float(found.k[0]), float(found.eps0[0]), share))
    noise, even = data.noise, data.evenness
    freedom = one.parameters * (len(numbers) - 1.0)
    ratio = max(float(judged.fit.found.total[n]) - apart, 0.0) / noise.dispersion / freedom
    p = float(tail(np.array([ratio]), np.array([even * freedom]), even * noise.freedom)[0])
    return Together((freedom, noise.freedom), ratio, p, tuple(separate))


def _power(judged: _Judged) -> Power:
    """Return the power against each control at its best receptor."""
    mimics, total = [], judged.fit.found.total
    measures = np.flatnonzero(judged.measures)
    for name in dict.fromkeys(one.name for one in judged.named if one.control and one.receptor_mm is not None):
        mine = np.array([one.name == name for one in judged.named])
        control = int(np.argmin(np.where(mine, total, np.inf)))
        truth = judged.fit.found.mean[control]
        best, chance = imitated(judged.candidates.only(measures), judged.observed, truth)
        who = judged.named[measures[best]]
        mimics.append(Mimic(judged.named[control].title, who.title, chance))
    return Power(detectable(judged.observed, judged.candidates.parameters), tuple(mimics))
