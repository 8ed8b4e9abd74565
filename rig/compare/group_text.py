"""A verdict on several afferents in words, and as JSON."""

from collections.abc import Mapping, Sequence

from rig.compare.comparison_rows import AnswerJson, answers_as_json, measure_unit
from rig.compare.group import FEWEST, GroupOutcome, GroupRow, GroupVerdict
from rig.compare.verdict import AfferentVerdict, Candidate, six_digits
from rig_shared.outputs import Interval, Name, Output, Ratio, Unit
from rig_shared.plural import number_of

METHOD = (
    "Each afferent has its own receptor, gain k and threshold ε₀. For every measure, the likelihood of an afferent "
    "is averaged over the receptors and integrated over k and ε₀, whose population is normal in log|k| and ε₀. The "
    "probability of a measure assumes that one measure or control is common to all afferents, and that all are "
    "equally probable beforehand; the set shares 95 % of it. The noise of an afferent is integrated out, and counts "
    "as larger where no candidate fits. Intervals of the mean gain and threshold are those of Knapp and Hartung."
)
SYNTHETIC = "synthetic"


class OfAfferentJson(Output):
    """Log-likelihood of an afferent below that under the most probable candidate; negative if it is higher."""

    afferent: Name
    worse_by: Ratio | None


class GroupRowJson(Output):
    """A measure or control as the one in common; gain and threshold in the sign in which the rate rises."""

    candidate: Candidate
    control: bool
    unit: Unit
    """Unit of the candidate: gain is impulses/s per unit, thresholds are in it."""
    probability: Ratio | None
    worse_by: Ratio | None
    """Log-likelihood below that of the most probable candidate."""
    in_set: bool
    wins: int
    """Number of afferents whose own maximum-likelihood measure this is."""
    kept: int
    """Number of afferents whose set contains it."""
    gain: float | None
    """Geometric mean over the afferents."""
    gain_interval: Interval
    gain_factor: Ratio | None
    """Exponential of the standard deviation of the log gain between afferents."""
    threshold: float | None
    threshold_interval: Interval
    threshold_sd: float | None
    by_afferent: list[OfAfferentJson]


class GroupVerdictJson(Output):
    """Verdict on the group; rows in order of descending probability."""

    outcome: GroupOutcome
    answer_text: str
    besides_text: list[str]
    afferents: int
    unexplained: int
    """Number of afferents whose own verdict rejects every measure."""
    set: list[Candidate]
    rows: list[GroupRowJson]
    method_text: str


class AfferentAnswerJson(Output):
    """An afferent and its own verdict."""

    afferent: Name
    answer: AnswerJson


def sentence_of_group(verdict: GroupVerdict | None) -> str:
    """Return the verdict on the group in one sentence."""
    if verdict is None:
        return f"A group requires {FEWEST} afferents with enough positions; there is no verdict on the group."
    best, number = verdict.best, len(verdict.afferents)
    if verdict.outcome == "nothing":
        return (
            f"No measure explains these afferents: {verdict.unexplained} of {number} {_reject(verdict.unexplained)}. "
            f"The most probable one in common is {best.name}."
        )
    if verdict.outcome == "one measure":
        return f"{best.name} explains these {number} afferents as the one measure in common."
    names = listed_names(verdict.set)
    if verdict.outcome == "not beyond controls":
        return f"No measure is shown to explain these {number} afferents: {names} share 95 % of the probability."
    return f"Several measures explain these {number} afferents and cannot be distinguished: {names}."


def sentences_of_group(verdict: GroupVerdict) -> list[str]:
    """Return further sentences, most important first."""
    number = len(verdict.afferents)
    others = [row for row in verdict.rows if not row.in_set]
    besides = (
        f"The next candidate, {others[0].name}, has a log-likelihood that is lower by {others[0].worse_by:.1f}."
        if others
        else "No candidate is excluded."
    )
    wins = ", ".join(f"{row.name} {row.wins}" for row in verdict.rows if row.wins)
    best = verdict.best
    return [
        f"Probability: {listed_probabilities(verdict.set)}. {besides}",
        f"Maximum-likelihood measure of each afferent alone: {wins}, of {number} afferents. {best.name} is in the "
        f"set of {best.kept}, and {verdict.unexplained} {_reject(verdict.unexplained)}.",
    ]


def in_short(verdict: AfferentVerdict) -> str:
    """Return the verdict on one afferent that was not silent as a line of a table."""
    inside = f"{number_of(len({row.name for row in verdict.set}), 'measures')} in the set"
    controls = ", ".join(dict.fromkeys(row.name for row in verdict.controls_in_set))
    found = {
        "explained": "explained",
        "not beyond controls": f"not beyond controls ({controls})",
        "nothing": "every measure is rejected",
    }[verdict.outcome]
    return f"{found}; {inside}; maximum-likelihood pair {verdict.closest.title}"


def listed_names(rows: Sequence[GroupRow]) -> str:
    """Return names, e.g. "ep1, sed and skin pressure"."""
    names = [row.name for row in rows]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def listed_probabilities(rows: Sequence[GroupRow]) -> str:
    """Return names with their probabilities."""
    return ", ".join(f"{row.name} {100 * row.probability:.0f} %" for row in rows)


def is_synthetic(names: Sequence[str]) -> bool:
    """Return whether any recording is synthetic by its name."""
    return any(SYNTHETIC in name.casefold() for name in names)


def group_as_json(verdict: GroupVerdict | None) -> GroupVerdictJson | None:
    """Return the verdict on the group for `--json`."""
    if verdict is None:
        return None
    return {
        "outcome": verdict.outcome,
        "answer_text": sentence_of_group(verdict),
        "besides_text": sentences_of_group(verdict),
        "afferents": len(verdict.afferents),
        "unexplained": verdict.unexplained,
        "set": [row.name for row in verdict.set],
        "rows": [_row(row, list(verdict.afferents)) for row in verdict.rows],
        "method_text": METHOD,
    }


def _row(row: GroupRow, afferents: Sequence[str]) -> GroupRowJson:
    of = row.population
    return {
        "candidate": row.name,
        "control": row.control,
        "unit": measure_unit(row.name),
        "probability": six_digits(row.probability),
        "worse_by": six_digits(row.worse_by),
        "in_set": row.in_set,
        "wins": row.wins,
        "kept": row.kept,
        "gain": six_digits(of.gain),
        "gain_interval": _interval(of.gain_limits),
        "gain_factor": six_digits(of.gain_factor),
        "threshold": six_digits(of.threshold),
        "threshold_interval": _interval(of.threshold_limits),
        "threshold_sd": six_digits(of.threshold_sd),
        "by_afferent": [
            {"afferent": name, "worse_by": six_digits(float(value))}
            for name, value in zip(afferents, row.by_afferent, strict=True)
        ],
    }


def _interval(ends: tuple[float, float]) -> Interval:
    low, high = ends
    return six_digits(low), six_digits(high)


def afferents_as_json(verdicts: Mapping[str, AfferentVerdict]) -> list[AfferentAnswerJson]:
    """Return the verdict on each afferent alone for `--json`."""
    return [{"afferent": name, "answer": answers_as_json([one])[0]} for name, one in verdicts.items()]


def _reject(number: int) -> str:
    return f"reject{'s' if number == 1 else ''} every measure"
