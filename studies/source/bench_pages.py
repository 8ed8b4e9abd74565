"""The source's schedules on the virtual bench, as a comparison shows them.

    .venv/bin/python -m studies.source.bench_pages [FOLDER]    # default: study; minutes on two idle cores

Writes FOLDER/comparison.html and .pdf (steps, bars, gratings), FOLDER/forces.html (the paired-force study) and
FOLDER/synthetic.html (what a comparison looks like, on synthetic recordings), over this machine's processes.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from rig.compare.comparison import compare
from rig.compare.make_verdict import answers
from rig.compare.recordings.reading import Reading, read_recordings
from rig.compare.recordings.spikes import afferent_for, record, write_synthetic
from rig.compare.stimuli import StimulusRow, stimuli, stimulus_maps
from rig.data import Run, read_run
from rig.plan.config import load_config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.report.comparison_report import write_comparison
from rig.report.run_report import write_report
from rig.session.session import NewRun, Session, dry_run
from rig.study.parallel import spread
from sim.models.fingertip import Fingertip

LOW_GWT, HIGH_GWT = 2.33, 8.0
Words = tuple[str, ...]
SCHEDULES: tuple[Words, ...] = (
    ("bars", "width_mm=3.0"),  # the longest first
    ("bars", "width_mm=1.5"),
    ("gratings",),
    *(("steps", f"step={n}", f"force_gwt={f}") for f in (LOW_GWT, HIGH_GWT) for n in "135"),
    ("paired_forces",),
    ("cylinders", "diameter_mm=9"),
    ("cylinders", "diameter_mm=3"),
    ("line",),
)
COMMAND = "make study-bench"


@dataclass(frozen=True)
class Done:
    """A finished run and what it took."""

    words: Words
    path: Path
    seconds: float
    problem: str

    @property
    def run(self) -> Run:
        """Its journal."""
        return read_run(self.path)

    @property
    def line(self) -> str:
        """For the table of times."""
        n = len(self.run.stream("hold_end"))
        stopped = f", stopped: {self.problem}" if self.problem else ""
        return f"{' '.join(self.words):<34} {n:>4} holds {self.seconds:6.1f} s of one process{stopped}"


def carry_out(words: Words, folder: Path) -> Done:
    """One protocol on the virtual bench, as `rig dry-run` does it; what stops early is kept as far as it got."""
    began = time.process_time()
    config, finger = load_config(None), Fingertip.load()
    script = load_script(words[0], words[1:])
    plan = make_plan(script, config, finger)
    done = dry_run(Session(script, config, finger, plan, NewRun(folder)))
    write_report(done.run, finger)
    done.folder.write_checksums()
    return Done(words, done.folder.path, time.process_time() - began, str(done.problem or ""))


def carry_out_all(folder: Path) -> list[Done]:
    """Every schedule, and the thin cylinder at the thick one's force; each is told when it is done."""
    count = len(SCHEDULES) + 1
    print(f"{count} schedules on the virtual bench, over this machine's processes …", flush=True)
    done: list[Done] = []
    for one in spread(partial(carry_out, folder=folder), SCHEDULES):
        done.append(one)
        print(f"{len(done):>2} of {count}  {one.line}", flush=True)
    done.append(carry_out(("cylinders", "diameter_mm=3", f"force_gwt={equal_force_gwt(done)}"), folder))
    print(f"{count:>2} of {count}  {done[-1].line}", flush=True)
    return done


def equal_force_gwt(done: Sequence[Done]) -> float:
    """The force that the 9 mm cylinder needs for its deepest DOI."""
    run = next(d.run for d in done if d.words == ("cylinders", "diameter_mm=9"))
    return float(round(run.stream("hold_end")[-1]["force_gwt"], 2))


def comparison_page(folder: Path, done: Sequence[Done], finger: Fingertip) -> None:
    """Steps, bars and gratings."""
    runs = [d.run for d in done if d.words[0] in ("steps", "bars", "gratings")]
    pressed = [(run, stimuli(run, finger)) for run in runs]
    found = compare([stimulus for _, members in pressed for stimulus in members], {})
    maps = [one for run, members in pressed for one in stimulus_maps(run, finger, members)]
    page = partial(write_comparison, folder / "comparison.html", found, runs, finger, COMMAND)
    page(title="Steps, bars and gratings on the virtual bench", maps=maps, pdf=folder / "comparison.pdf")


def forces_page(folder: Path, done: Sequence[Done], finger: Fingertip) -> None:
    """Step 1 at two forces."""
    runs = [d.run for d in done if d.words[0] == "paired_forces"]
    found = compare([s for run in runs for s in stimuli(run, finger)], {})
    write_comparison(folder / "forces.html", found, runs, finger, COMMAND, title="Step 1 at two forces")


def synthetic_page(folder: Path, done: Sequence[Done], finger: Fingertip) -> None:
    """A comparison with synthetic recordings of one afferent: ep1 at −1.0 under the steps at 8 gwt and both bars."""
    runs = [d.run for d in done if d.words[0] == "bars" or f"force_gwt={HIGH_GWT}" in d.words]
    chosen = [s for run in runs for s in stimuli(run, finger) if s.family in ("step", "bar")]
    names = _recorded(folder, chosen, np.random.default_rng(1998))
    comparison = compare(chosen, read_recordings(names, [], runs, Reading()))
    title, said = "An example on synthetic recordings (not data)", answers(comparison)
    write_comparison(folder / "synthetic.html", comparison, runs, finger, COMMAND, title=title, answers=said)


def _recorded(folder: Path, members: list[StimulusRow], rng: np.random.Generator) -> list[str]:
    """SHAPE=CSV of a synthetic recording of each."""
    receptor = int(np.argmin(np.abs(members[0].receptor_mm + 1.0)))
    afferent = afferent_for(members, "ep1", receptor, peak=60.0, silent=0.3)
    positions = np.arange(-2.0, 2.01, 0.2)
    return [f"{s.indentor}={write_synthetic(folder, record(afferent, s, positions, rng))}" for s in members]


def main() -> None:
    """Run everything and write the reports."""
    began = time.perf_counter()
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "study")
    folder.mkdir(parents=True, exist_ok=True)
    finger = Fingertip.load()
    done = carry_out_all(folder / "runs")
    print(f"schedules {time.perf_counter() - began:.0f} s; comparing …", flush=True)
    comparison_page(folder, done, finger)
    forces_page(folder, done, finger)
    synthetic_page(folder, done, finger)
    print(f"everything {time.perf_counter() - began:.0f} s; {folder / 'comparison.html'}")


if __name__ == "__main__":
    main()
