"""`rig design`: choose presses that distinguish candidate measures within a session."""

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from rig.cli.options import (
    HTML,
    FingerConfigOption,
    FingerFileOption,
    ForceFingerOption,
    JsonOption,
    checked_file,
    numbers,
    option,
)
from rig.cli.output import THE_FINGER, Activity, busy, out, print_json, print_lines, writes_json
from rig.cli.progress import counted
from rig.cli.request import Excludes, Rule, repeats, takes
from rig.compare.plausible_fingers import read_plausible
from rig.compare.verdict import Candidate
from rig.data.folder import replace_text
from rig.design.checked_script import checked_script
from rig.design.confusion import share_and_error
from rig.design.design import DEPTHS_MM, DesignRequest, design, finger_of, judged
from rig.design.design_text import (
    DesignedJson,
    about_the_design,
    headline,
    percent,
    power_lines,
    quick_line,
    separation_line,
    verdict_lines,
)
from rig.design.design_text import as_json as design_as_json
from rig.design.exceptions import DesignError
from rig.design.fibers import Unknowns
from rig.design.power import power_rows
from rig.design.recorded_counts import SessionVerdict
from rig.plan.config import load_config, with_finger
from rig.report.design_page import DesignPage, write_design_page
from rig_shared.outputs import File, Output, Ratio
from sim.measures.measures import MEASURES

T = TypeVar("T")

_FIBER, _TIME = "The fiber", "Time"


class DesignJson(DesignedJson):
    """A design of presses, its script and its page.

    effective_draws: effective number of draws behind the evidence of the true candidate; nine of ten experiments
    have more.
    """

    script: File
    report: File
    duration_s: float
    wall_s: float


class JudgedCandidateJson(Output):
    """A candidate after the counts of a session."""

    name: Candidate
    probability: Ratio
    in_set: bool
    p_fit: Ratio
    """Probability of a worse fit if this candidate is the truth."""


class SessionJson(Output):
    """Verdict on the counts of a designed session, with --counts; most probable first."""

    candidates: list[JudgedCandidateJson]
    presses: int
    different_presses: int
    effective_draws: Ratio


@dataclass(frozen=True)
class DesignOptions:
    """Arguments and options of `rig design`."""

    candidates: Annotated[str | None, option("Candidate measures or controls. Default: the 18 measures.", "M,M")] = (
        None
    )
    shapes: Annotated[str, option("Indentors on the bench.", "S,S")] = "step:1,bar:3.0,cylinder:3"
    minutes: Annotated[float, option("Duration of the session, in min, {within}.", "MIN", within=(1, 240))] = 20.0
    depths_mm: Annotated[str | None, option("Depths to choose from, in mm. Default: 0.25,0.5,0.75,1.", "D,D")] = None
    forces_gwt: Annotated[str | None, option("Forces to choose from, in gwt, instead of depths.", "F,F")] = None
    config: FingerConfigOption = None
    finger_file: FingerFileOption = None
    force: ForceFingerOption = False
    fingers: Annotated[Path | None, option("Plausible fingers, as in rig compare.", "TOML")] = None
    to: Annotated[Path, option("Protocol script to write.", "PY")] = Path("designed.py")
    out_file: Annotated[
        Path | None, option("HTML page to write. Default: beside the script.", "HTML", name="--out")
    ] = None
    counts: Annotated[
        Path | None, option("Spike counts of the session to evaluate, instead of designing one.", "CSV")
    ] = None
    seed: Annotated[int, option("Seed of the choice and the order.", "N", min=0)] = 1
    quick: Annotated[bool, option("Use a coarser search, which takes a sixth of the time.", name="--quick")] = False
    power: Annotated[bool, option("Print how many fibers reach 80 % power.", name="--power")] = False
    rate_per_s: Annotated[str, option("Rate at the strongest press, in spikes/s.", "LOW,HIGH", _FIBER)] = "20,100"
    threshold: Annotated[str, option("Threshold ε₀, in % of ε at the strongest press.", "LOW,HIGH", _FIBER)] = "0,50"
    receptor_x_mm: Annotated[str, option("Receptor x, in mm.", "LOW,HIGH", _FIBER)] = "-0.5,0.5"
    receptor_below_mm: Annotated[str, option("Depth below the epidermis, in mm.", "LOW,HIGH", _FIBER)] = "0.1,0.7"
    dispersion: Annotated[str, option("Variance of counts over Poisson's.", "LOW,HIGH", _FIBER)] = "1.5"
    drift: Annotated[
        float, option("Drift of the gain in ten minutes, sd in %.", "PERCENT", _FIBER, within=(0, 100))
    ] = 10.0
    hold_s: Annotated[float, option("Hold, in which spikes are counted, in s.", "S", _TIME, within=(0.05, 60))] = 1.0
    rest_s: Annotated[float, option("Rest after each press, the washout, in s.", "S", _TIME, within=(0, 3600))] = 2.0
    change_s: Annotated[float, option("Time to change the indentor, in s.", "S", _TIME, within=(0, 3600))] = 60.0
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (Excludes("--depths-mm", ("--forces-gwt",)),)


@takes(DesignOptions)
def command(request: DesignOptions) -> None:
    """Choose presses, check them, and write a protocol script and a page."""
    began = time.perf_counter()
    page_file = request.to.with_suffix(".html") if request.out_file is None else request.out_file
    checked_file("--to", request.to, ".py")
    checked_file("--out", page_file, *HTML)
    option, targets = "--depths-mm", request.depths_mm
    if request.forces_gwt is not None:
        option, targets = "--forces-gwt", request.forces_gwt
    threshold = _range("--threshold", request.threshold, 0, 95)
    wanted = DesignRequest(
        shapes=_names(request.shapes),
        minutes=request.minutes,
        kind="doi_mm" if request.forces_gwt is None else "force_gwt",
        unknowns=Unknowns(
            _range("--rate-per-s", request.rate_per_s, 0.1, 1000),
            (threshold[0] / 100, threshold[1] / 100),
            _range("--receptor-x-mm", request.receptor_x_mm, -5, 5),
            _range("--receptor-below-mm", request.receptor_below_mm, 0.02, 3),
            _range("--dispersion", request.dispersion, 0.05, 20),
            request.drift / 100,
        ),
        hold_s=request.hold_s,
        rest_s=request.rest_s,
        change_s=request.change_s,
        seed=request.seed,
        quick=request.quick,
        candidates=MEASURES if request.candidates is None else _names(request.candidates),
        targets=DEPTHS_MM if targets is None else tuple(sorted(set(numbers(option, targets)))),
    )
    wanted.refuse()
    settings = with_finger(load_config(request.config), request.finger_file, force=request.force)
    plausible = None if request.fingers is None else read_plausible(request.fingers)
    with busy(THE_FINGER):
        finger = finger_of(wanted, settings.finger)
    with ShownProgress() as shown:
        if request.counts is not None:
            verdict = judged(wanted, request.counts, settings, finger, plausible, shown.count, shown.progress)
        else:
            found = design(wanted, settings, finger, plausible, shown.count, shown.progress)
    if request.counts is not None:
        _print_verdict(verdict)
        return
    words = repeats("design", request, without=("--json",))
    with busy("checking and rehearsing the script …"):
        script = checked_script(found, settings, finger, plausible, words)
    found = script.design
    with busy("computing the power …", quick=True):
        designs = [found.at("designed", m) for m in found.durations] if request.power else []
        rows = power_rows(designs, request.seed)
    with busy("writing the script and the page …"):
        replace_text(request.to, script.text)
        write_design_page(page_file, DesignPage(found, str(request.to), script.duration_s, rows, words))
    if writes_json():
        result: DesignJson = {
            "script": str(request.to),
            "report": str(page_file),
            "duration_s": script.duration_s,
            **design_as_json(found, rows),
            "wall_s": time.perf_counter() - began,
        }
        print_json(result)
        return
    kept = percent(*share_and_error(found.outcome.kept))
    how = "predicted" if request.quick else "rehearsed"
    lines: dict[str, Any] = {
        "design": headline(found),
        "truth": f"in the set in {kept}",
        "pairs": separation_line(found),
        "power": power_lines(rows) if request.power else [],
        "quick": quick_line(found) or [],
        "presses": about_the_design(found),
        "duration": f"{script.duration_s:.0f} s, {how}, with changes of shape",
        "script": str(request.to),
        "report": str(page_file),
    }
    print_lines(lines.items(), 10)


def _print_verdict(verdict: SessionVerdict) -> None:
    if writes_json():
        result: SessionJson = {
            "candidates": [
                {"name": one.name, "probability": one.probability, "in_set": one.in_set, "p_fit": one.p_fit}
                for one in verdict.candidates
            ],
            "presses": verdict.presses,
            "different_presses": verdict.different,
            "effective_draws": verdict.effective,
        }
        print_json(result)
        return
    for line in verdict_lines(verdict):
        out.print(line)


class ShownProgress(ExitStack):
    """Progress of a design: of tables by tasks, of all else by parts."""

    _what = ""
    _now: Activity

    def count(self, answers: Iterable[T], total: int, what: str, /) -> Iterator[T]:
        """Yield the results of tasks."""
        self._end()
        return counted(answers, total, what)

    def progress(self, what: str, done: int, total: int) -> None:
        """Show how far a part is."""
        pieces = total if total > 1 else 0
        if what != self._what:
            self._end()
            self._what, self._now = what, self.enter_context(busy(what, total=pieces))
        self._now.at(done, pieces)

    def _end(self) -> None:
        self.close()
        self._what = ""


def _names(text: str) -> tuple[str, ...]:
    return tuple(one.strip() for one in text.split(","))


def _range(option: str, text: str, low: float, high: float) -> tuple[float, float]:
    ends = numbers(option, text)
    if len(ends) not in (1, 2) or not low <= ends[0] <= ends[-1] <= high:
        raise DesignError(
            f"{option} {text}: must be one number, or the lower and the higher one, within {low:g} to {high:g}",
            "bad_range",
        )
    return ends[0], ends[-1]
