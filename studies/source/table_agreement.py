"""Table 5.2 of Raju (1998) against ours, and who survives, as sections of the study."""

from collections.abc import Sequence

import numpy as np

from rig.compare.comparison import Comparison
from rig.compare.profile_shape_test import THRESHOLD, THRESHOLDS
from rig.compare.raju_table_5_2 import SHAPES, AgreementLimits, agreement, agreement_limits, source_flags
from rig.compare.stimuli import StimulusRow
from rig.report.page_parts import Section
from sim.measures.measures import MEASURES


def table_5_2(found: Comparison, force_gwt: float) -> tuple[Section, Section]:
    """The source's table against ours at its force: cell by cell, and over thresholds."""
    judged = [next(s for s in found.stimuli if s.title == f"{shape} at {force_gwt:g} gwt") for shape in SHAPES]
    source = source_flags(judged[0].receptor_mm)

    def ours(threshold: float) -> np.ndarray:
        return np.stack([flags for s in judged if (flags := found.passes(s, threshold)) is not None], axis=1)

    rows = []
    for threshold in THRESHOLDS:
        a = agreement(ours(threshold), source)
        counts = (f"{a.both}", f"{a.ours}", f"{a.source}", f"{a.neither}")
        scores = _scores(ours(threshold), source)
        survivors = ", ".join(found.candidates(threshold, judged)) or "none"
        rows.append((f"{100 * threshold:g} %", *counts, *scores, survivors))
    cells = tuple(_cells(judged[0], m, source, ours(THRESHOLD)) for m in range(len(MEASURES)))
    return (
        Section(
            "Table 5.2 of the source, cell by cell",
            "Receptors (x in mm) that match under steps 1, 3 and 5 at 2.33 gwt: the source's by eye, ours by the "
            "shape test at 5 %. + only ours, − only the source's.",
            ("measure", *SHAPES),
            cells,
        ),
        Section(
            "Agreement with Table 5.2 over thresholds",
            "18 measures × 10 receptors × 3 steps, 57 of 540 cells pass in the source. A table of nothing but “no” "
            "would score 0 in Matthews' coefficient. "
            f"{LIMITS} The source judged by eye, on an unpublished geometry.",
            ("threshold", "both", "only ours", "only the source", "neither", "precision", "recall", "Matthews",
             "survivors of the three steps"),
            tuple(rows),
        ),
    )  # fmt: skip


LIMITS = (
    "In brackets 95 % limits by drawing measures again, and by drawing receptors again: 540 cells are not 540 "
    "observations."
)


def _scores(ours: np.ndarray, source: np.ndarray) -> tuple[str, ...]:
    """Precision, recall and Matthews' coefficient with their limits."""
    found = agreement(ours, source)
    limits = [agreement_limits(ours, source, over) for over in ("measures", "receptors")]
    return tuple(
        with_limits(getattr(found, name), [getattr(one, name) for one in limits]) for name in AgreementLimits._fields
    )


def with_limits(value: float, limits: Sequence[tuple[float, float]]) -> str:
    """For example "0.56 (0.35 … 0.72; 0.48 … 0.63)"."""
    told = "; ".join(f"{low:.2f} … {high:.2f}" for low, high in limits)
    return f"{value:.2f} ({told})".replace("-", "−")


def _cells(stimulus: StimulusRow, m: int, source: np.ndarray, ours: np.ndarray) -> tuple[str, ...]:
    def cell(shape: int) -> str:
        marks = {(True, True): "", (False, True): "+", (True, False): "−"}
        words = [
            f"{marks[bool(source[m, shape, k]), bool(ours[m, shape, k])]}({x:g})"
            for k, x in enumerate(stimulus.receptor_mm)
            if source[m, shape, k] or ours[m, shape, k]
        ]
        return " ".join(words).replace("-", "−") or "·"

    return MEASURES[m], *(cell(shape) for shape in range(len(SHAPES)))


def survivors_section(found: Comparison) -> Section:
    """Candidates under each condition, and under steps and bars together."""
    rows = [(name, ", ".join(names) or "none") for name, names in found.candidates_by_condition()]
    rows.append(("everything above", ", ".join(found.candidates()) or "none"))
    return Section(
        "Survivors by condition",
        f"Measures that pass the shape test at {100 * THRESHOLD:g} % at one receptor under every step, and near x = 0"
        " under every bar.",
        ("condition", "measures"),
        tuple(rows),
    )
