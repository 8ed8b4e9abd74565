"""The whole study: every schedule on the virtual bench, the comparison and the facts of the source.

    .venv/bin/python bench/study.py [FOLDER]      # default: study; several minutes

Writes FOLDER/study.html (steps, bars, gratings; facts; Table 5.2), FOLDER/forces.html (the paired-force study) and
FOLDER/synthetic.html (what a comparison with recordings looks like, on synthetic ones). Times go to standard output.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.compare import write_report
from rig.compare.comparison import Comparison, compare
from rig.compare.comparison_report import Section, write_comparison
from rig.compare.inputs import SpikeReading, read_recordings
from rig.compare.shape_test import THRESHOLDS
from rig.compare.stimuli import Stimulus, stimuli
from rig.compare.synthetic import afferent_for, record, write_synthetic
from rig.compare.table_5_2 import SHAPES, agreement, source_flags
from rig.data import Run
from rig.protocol.config import load_config
from rig.protocol.plan import make_plan
from rig.protocol.script import load_script
from rig.protocol.session import Session, dry_run
from sim.fingertip import Fingertip
from sim.measures.measures import MEASURES
from study_facts import DEPTHS_MM, FINE_X_MM, all_facts
from study_figures import shapes_side_by_side
from study_pressure import layers_section, press_all, pressure_section

LOW_GWT, HIGH_GWT = 2.33, 8.0
SCHEDULES = (
    *(("steps", f"step={n}", f"force_gwt={f}") for f in (LOW_GWT, HIGH_GWT) for n in "135"),
    ("bars", "width_mm=1.5"),
    ("bars", "width_mm=3.0"),
    ("gratings",),
    ("paired_forces",),
    ("cylinders", "diameter_mm=9"),
    ("cylinders", "diameter_mm=3"),
)
COMMAND = "make study"


@dataclass(frozen=True)
class Done:
    """A finished run and what it took."""

    run: Run
    words: tuple[str, ...]
    seconds: float


def carry_out(words: tuple[str, ...], finger: Fingertip, folder: Path) -> Done:
    """One protocol on the virtual bench, as `rig dry-run` does it; what stops early is kept as far as it got."""
    began = time.perf_counter()
    config = load_config(None)
    script = load_script(words[0], words[1:])
    plan = make_plan(script, config, finger)
    done = dry_run(Session(script, config, finger, plan, folder, interrupted=lambda: False))
    write_report(done.run, finger)
    done.folder.write_checksums()
    taken = time.perf_counter() - began
    n = len(done.run.stream("hold_end"))
    print(f"{' '.join(words):<34} {n:>4} holds {taken:6.1f} s, {taken / max(n, 1):.2f} s each", flush=True)
    if done.problem is not None:
        print(f"  stopped: {done.problem}", flush=True)
    return Done(done.run, words, taken)


def equal_force_gwt(done: list[Done]) -> float:
    """The force that the 9 mm cylinder needs for its deepest DOI."""
    run = next(d.run for d in done if d.words == ("cylinders", "diameter_mm=9"))
    return float(round(run.stream("hold_end")[-1]["force_gwt"], 2))


def table_5_2(found: Comparison) -> tuple[Section, Section]:
    """The source's table against ours at 2.33 gwt: cell by cell, and over thresholds."""
    judged = [next(s for s in found.stimuli if s.title == f"{shape} at {LOW_GWT:g} gwt") for shape in SHAPES]
    source = source_flags(judged[0].receptor_mm)

    def ours(threshold: float) -> np.ndarray:
        return np.stack([flags for s in judged if (flags := found.passes(s, threshold)) is not None], axis=1)

    rows = []
    for threshold in THRESHOLDS:
        a = agreement(ours(threshold), source)
        counts = (f"{a.both}", f"{a.ours}", f"{a.source}", f"{a.neither}")
        scores = (f"{a.precision:.2f}", f"{a.recall:.2f}", f"{a.matthews:.2f}")
        survivors = ", ".join(found.candidates(threshold, judged)) or "none"
        rows.append((f"{100 * threshold:g} %", *counts, *scores, survivors))
    cells = tuple(_cells(judged[0], m, source, ours(0.05)) for m in range(len(MEASURES)))
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
            "would score 0 in Matthews' coefficient. The source judged by eye, on an unpublished geometry.",
            ("threshold", "both", "only ours", "only the source", "neither", "precision", "recall", "Matthews",
             "survivors of the three steps"),
            tuple(rows),
        ),
    )  # fmt: skip


def _cells(stimulus: Stimulus, m: int, source: np.ndarray, ours: np.ndarray) -> tuple[str, ...]:
    def cell(shape: int) -> str:
        marks = {(True, True): "", (False, True): "+", (True, False): "−"}
        words = [
            f"{marks[bool(source[m, shape, k]), bool(ours[m, shape, k])]}({x:g})"
            for k, x in enumerate(stimulus.receptor_mm)
            if source[m, shape, k] or ours[m, shape, k]
        ]
        return " ".join(words).replace("-", "−") or "·"

    return MEASURES[m], *(cell(shape) for shape in range(len(SHAPES)))


def synthetic(folder: Path, chosen: list[Stimulus], runs: list[Run], finger: Fingertip) -> None:
    """A comparison with synthetic recordings: ep1 at −1.0 under the steps, at 0 under the bars."""
    rng = np.random.default_rng(1998)
    names = []
    for family, x_mm in (("step", -1.0), ("bar", 0.0)):
        members = [stimulus for stimulus in chosen if stimulus.family == family]
        receptor = int(np.argmin(np.abs(members[0].receptor_mm - x_mm)))
        afferent = afferent_for(members, "ep1", receptor, peak=60.0, silent=0.3)
        for stimulus in members:
            path = write_synthetic(folder, record(afferent, stimulus, np.arange(-2.0, 2.01, 0.2), rng))
            names.append(f"{stimulus.indentor}={path}")
    comparison = compare(chosen, read_recordings(names, [], runs, SpikeReading()))
    title = "An example on synthetic recordings (not data)"
    write_comparison(folder / "synthetic.html", comparison, runs, finger, COMMAND, title=title)


def main() -> None:
    """Run everything and write the reports."""
    began = time.perf_counter()
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "study")
    finger = Fingertip.load()
    fine = {depth: Fingertip.load(receptor_x_mm=FINE_X_MM, receptor_depth_mm=depth) for depth in DEPTHS_MM}
    print(f"models {time.perf_counter() - began:.1f} s", flush=True)
    done = [carry_out(words, finger, folder / "runs") for words in SCHEDULES]
    force_gwt = equal_force_gwt(done)
    done.append(carry_out(("cylinders", "diameter_mm=3", f"force_gwt={force_gwt}"), finger, folder / "runs"))

    main_runs = [d.run for d in done if d.words[0] in ("steps", "bars", "gratings")]
    found = compare([s for run in main_runs for s in stimuli(run, finger)], {})
    by_title = {stimulus.title: stimulus for stimulus in found.stimuli}
    pressures = press_all(finger)
    facts = Section(
        "Facts of the source",
        "What Raju (1998, ch. 4 and 5) reports of his model, and what this one gives. Nothing was tuned to it.",
        ("fact", "the source", "here", ""),
        tuple(fact.row for fact in all_facts(finger, fine, by_title, pressures)),
    )
    shapes = shapes_side_by_side(finger, fine, force_gwt)
    title = "The study: steps, bars and gratings"
    extra = (facts, *table_5_2(found), shapes, pressure_section(pressures), layers_section())
    write_comparison(folder / "study.html", found, main_runs, finger, COMMAND, extra, title)

    paired = [d.run for d in done if d.words[0] == "paired_forces"]
    pairs = compare([s for run in paired for s in stimuli(run, finger)], {})
    write_comparison(folder / "forces.html", pairs, paired, finger, COMMAND, title="Step 1 at two forces")

    recorded = [d for d in done if d.words[0] == "bars" or f"force_gwt={HIGH_GWT}" in d.words]
    runs = [d.run for d in recorded]
    synthetic(folder, [s for run in runs for s in stimuli(run, finger)], runs, finger)
    print(f"everything {time.perf_counter() - began:.0f} s; {folder / 'study.html'}")


if __name__ == "__main__":
    main()
