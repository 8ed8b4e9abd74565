"""Verdict on a fiber from the counts of a designed session."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, logsumexp

from rig.compare.recordings.table import Row, no_rows, read_table
from rig.compare.recordings.totals import refuse_nines
from rig.design.counts import TEN_MINUTES_S, CountModel
from rig.design.fibers import FiberDraws, draw_fibers, log_rates, relative_rates
from rig.design.posterior import CandidatePosterior, in_set
from rig.design.press_times import PressTimes
from rig.design.presses import PossiblePress
from rig.design.refined import FEW, best_draws, effective_draws, refined_evidence
from rig.design.response_table import ResponseTable
from rig_shared.natural_order import natural_order
from sim.contact.shapes import shape_name

Array = NDArray[np.float64]

_DECIMALS = 3
_FEW = 12  # places that a message lists
_PARAMETERS = 4  # gain, threshold, x and depth


class CountedPress(NamedTuple):
    """Number of a possible press, and the spikes in its hold."""

    press: int
    spikes: float


class CandidateVerdict(NamedTuple):
    """A candidate after the counts; `p_fit` is the probability of a worse fit if it is the truth."""

    name: str
    probability: float
    in_set: bool
    p_fit: float


class SessionVerdict(NamedTuple):
    """Candidates after a session, most probable first, and the effective draws of the first one's evidence."""

    candidates: tuple[CandidateVerdict, ...]
    presses: int
    different: int
    """Number of different presses among them."""
    effective: float
    hold_s: float
    """Window of the counts."""


def read_counts(path: Path, presses: Sequence[PossiblePress], hold_s: float) -> list[CountedPress]:
    """Return the counts of a table with the columns shape, x_mm, doi_mm or force_gwt, and count, in order of time.

    A column window_s must be the hold, over which spikes are counted. Raises RecordingError, naming row and column.
    """
    kind = presses[0].kind
    columns = ("shape", "x_mm", kind, "count")
    number = {
        (shape_name(one.shape), round(one.x_mm, _DECIMALS), round(one.target, _DECIMALS)): k
        for k, one in enumerate(presses)
    }
    names = {shape_name(one.shape) for one in presses}
    targets = sorted({round(one.target, _DECIMALS) for one in presses})
    option = "--depths-mm" if kind == "doi_mm" else "--forces-gwt"
    found = []
    rows = read_table(path, columns, ("window_s",))
    for row in rows:
        x_mm, target, count = row.number("x_mm"), row.number(kind), row.number("count", 0.0)
        if count != round(count):
            raise row.wrong("count", "no_whole_number", "a whole number of spikes")
        shape = row.cells["shape"].strip()
        if shape not in {one.shape for one in presses} | names:
            shapes = ", ".join(sorted(names, key=natural_order))
            raise row.wrong("shape", "shape_not_designed", f"one of {shapes}")
        if "window_s" in row.cells and not np.isclose(row.number("window_s"), hold_s, rtol=1e-3, atol=0.0):
            expected = f"the hold, {hold_s:g} s; use the same --hold-s as for the design, and count over all of it"
            raise row.wrong("window_s", "other_window", expected)
        if round(target, _DECIMALS) not in targets:
            possible = ", ".join(f"{one:g}" for one in targets)
            expected = f"one of {possible}; use the same {option} as for the design"
            raise row.wrong(kind, "press_not_designed", expected)
        at = shape_name(shape), round(x_mm, _DECIMALS), round(target, _DECIMALS)
        if at not in number:
            places = _in_words(sorted(x for name, x, to in number if (name, to) == (at[0], at[2])))
            expected = f"that of a possible press of this shape to this target, {places} mm"
            raise row.wrong("x_mm", "press_not_designed", expected)
        found.append(CountedPress(number[at], count))
    if not found:
        raise no_rows(path, "a count")
    refuse_nines(rows, "count")
    _refuse_a_copy(rows, found)
    _refuse_a_sum(rows, found)
    return found


def _refuse_a_copy(rows: Sequence[Row], found: Sequence[CountedPress]) -> None:
    """Refuse a table whose rows are those above again, in their order, as if it was appended to itself."""
    for period in range(_FEWEST_COUNTS, len(found) - _FEWEST_COUNTS + 1):
        again = found[period:]
        if again == found[:-period] and len({one.spikes for one in again} - {0.0}) >= _FEWEST_COUNTS:
            raise rows[period].wrong(
                "count",
                "place_twice",
                f"that of another press: from this row on, the table has its rows from row {rows[0].row} on again; "
                "delete the copy",
            )


def _refuse_a_sum(rows: Sequence[Row], found: Sequence[CountedPress]) -> None:
    """Refuse a first or last row whose count is the sum of all others."""
    spikes = [one.spikes for one in found]
    for at, others in ((-1, spikes[:-1]), (0, spikes[1:])):
        if spikes[at] == sum(others) and len(set(others) - {0.0}) >= _FEWEST_COUNTS:
            raise rows[at].wrong(
                "count", "totals", "that of a press, but it is the sum of all others; delete the row"
            )


_FEWEST_COUNTS = 3  # that differ and are above 0: a silent fiber gives the same rows again


def _in_words(possible: Sequence[float]) -> str:
    few = [f"{x:g}" for x in possible]
    return ", ".join(few if len(few) <= _FEW else [*few[: _FEW - 1], "…", few[-1]])


def session_verdict(
    table: ResponseTable,
    times: PressTimes,
    candidates: Sequence[str],
    model: CountModel,
    counted: Sequence[CountedPress],
    draws: int,
    seed: int,
) -> SessionVerdict:
    """Return the verdict on counts in order of time."""
    known = draw_fibers(draws, table, model.unknowns, seed + 19)
    used, column = np.unique([one.press for one in counted], return_inverse=True)
    log_rate = np.stack([log_rates(relative_rates(table, name, known)[:, used]) for name in candidates])
    took_s = times.press_s[[one.press for one in counted]]
    tau = (np.cumsum(took_s) - took_s / 2 - took_s.sum() / 2) / TEN_MINUTES_S
    now = CandidatePosterior.before(model, known, log_rate, float(took_s.sum()) / 60)
    for k, one, at in zip(column.tolist(), counted, tau.tolist(), strict=True):
        now = now.updated(k, np.array([one.spikes]), at)
    likelihood, evidence = now.log_likelihood[:, 0], now.log_evidence
    effective = np.array([effective_draws(one) for one in likelihood])
    for c in np.flatnonzero(effective < FEW).tolist():
        best = best_draws(likelihood[c])
        evidence[0, c], effective[c] = refined_evidence(
            table, candidates[c], model, now.sums, known.z[best], likelihood[c, best],
            np.random.default_rng([seed, c]), used,
        )  # fmt: skip
    probability = np.exp(evidence - logsumexp(evidence, axis=1, keepdims=True))
    inside = in_set(probability)[0]
    count = np.array([one.spikes for one in counted])
    rows = [
        CandidateVerdict(
            name,
            float(probability[0, c]),
            bool(inside[c]),
            _p_fit(now, log_rate[c], known, int(likelihood[c].argmax()), column, count, tau),
        )
        for c, name in enumerate(candidates)
    ]
    return SessionVerdict(
        tuple(sorted(rows, key=lambda row: -row.probability)),
        len(counted),
        len(used),
        float(effective[probability[0].argmax()]),
        model.window_s,
    )


def _p_fit(
    now: CandidatePosterior,
    log_rate: NDArray[np.float32],
    known: FiberDraws,
    likeliest: int,
    column: NDArray[np.int64],
    count: Array,
    tau: Array,
) -> float:
    """Return the probability of a larger Pearson's statistic than that of the likeliest fiber among the draws."""
    model = now.model
    dispersion = model.unknowns.dispersions[known.level]
    exposure = model.exposure_s(log_rate, known.drift, now.sums)
    shape, rate = model.gain_posterior(now.sums, exposure, dispersion)
    gain = shape[0, likeliest] / rate[likeliest]
    mean = model.window_s * gain * np.exp(log_rate[likeliest, column] + known.drift[likeliest] * tau)
    statistic = float(((count - mean) ** 2 / (dispersion[likeliest] * (mean + 0.5))).sum())
    return float(chdtrc(max(len(count) - _PARAMETERS, 1), statistic))


FITS = 0.01
"""p of a fit below which a candidate does not explain the counts."""
