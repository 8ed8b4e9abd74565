"""The shape test as a part of the report of its own: it says something of the simulation, nothing of a recording."""

from rig.compare.comparison import COLLINEAR, Comparison
from rig.compare.shape_chance import DRAWS, chance_rows
from rig.compare.shape_test import THRESHOLD
from rig.compare.stimuli import Stimulus
from rig.compare.tables import threshold_rows
from rig.report.html import Figure, Section
from rig.report.labels import as_positions
from sim.measures.measures import MEASURES

_ONLY_SIMULATED = (
    "A property of the simulation: it asks whether simulated profiles have the form that the source's recordings "
    "have (for steps a peak above its dip, for bars two peaks), and ignores every recording given here."
)


def shape_sections(comparison: Comparison, figures: list[Figure]) -> list[Section]:
    """Its verdicts with `figures` below, how they hang on its threshold, and which measures go together."""
    judged = [stimulus for stimulus in comparison.stimuli if comparison.passes(stimulus) is not None]
    title = "The shape test: a property of the simulation"
    if not judged:
        none = "None is defined for these indentors or schedules: it needs steps or bars at five positions or more."
        return [
            Section(title, f"{_ONLY_SIMULATED}\n\n{none}", figures=tuple(figures)),
            *_collinear(comparison),
        ]
    return [
        Section(
            title,
            f"{_ONLY_SIMULATED}\n\n{_candidates(comparison)} The table lists the receptors (x in mm) at which each "
            f"measure passes, at a threshold of {100 * THRESHOLD:g} %. {_by_chance(comparison)}",
            ("measure", "candidate", *(stimulus.title for stimulus in judged)),
            _rows(comparison, judged),
            tuple(figures),
            points=_by_condition(comparison),
        ),
        _thresholds(comparison, judged),
        *_collinear(comparison),
    ]


def _candidates(comparison: Comparison) -> str:
    names = ", ".join(comparison.candidates()) or "none"
    return (
        f"Candidates: {names}. A candidate passes at one and the same receptor under every step given here, at every "
        "force, and near x = 0 under every bar."
    )


def _by_chance(comparison: Comparison) -> str:
    """What the test lets pass that has no form at all."""
    rows = [row for row in chance_rows(comparison.stimuli) if row["passes_by_chance"] is not None]
    shares = [f"{row['shape']} at {row['condition']} {100 * row['passes_by_chance']:.0f} %" for row in rows]
    return f"Of {DRAWS} random profiles as smooth as a stimulus's own pass: {', '.join(shares)}." if rows else ""


def _by_condition(comparison: Comparison) -> tuple[str, ...]:
    found = comparison.candidates_by_condition()
    return tuple(f"{name}: {', '.join(names) or 'none'}" for name, names in found) if len(found) > 1 else ()


def _rows(comparison: Comparison, judged: list[Stimulus]) -> tuple[tuple[str, ...], ...]:
    candidates = comparison.candidates()
    passed = [(s.receptor_mm, comparison.passes(s)) for s in judged]
    return tuple(
        (
            name,
            "yes" if name in candidates else "no",
            *(as_positions(x[flags[measure]]) for x, flags in passed if flags is not None),
        )
        for measure, name in enumerate(MEASURES)
    )


def _thresholds(comparison: Comparison, judged: list[Stimulus]) -> Section:
    receptors = len(comparison.stimuli[0].receptor_mm)
    return Section(
        "How the shape test hangs on its threshold",
        f"Number of passing profiles, of {len(MEASURES)} measures × {receptors} receptors, and the candidates.",
        ("threshold", *(stimulus.title for stimulus in judged), "candidates"),
        tuple(
            (f"{100 * row['threshold']:g} %", *map(str, row["counts"]), ", ".join(row["candidates"]) or "none")
            for row in threshold_rows(comparison)
        ),
    )


def _collinear(comparison: Comparison) -> list[Section]:
    found = [(name, groups) for name, groups in comparison.collinear() if groups]
    if not found:
        return []
    return [
        Section(
            "Nearly collinear measures",
            "Which a recording with these stimuli can hardly tell apart, whatever is recorded (|r| ≥ "
            f"{COLLINEAR:g} over all positions and receptors).",
            points=tuple(f"{name}: {'; '.join(' = '.join(names) for names in groups)}" for name, groups in found),
        )
    ]
