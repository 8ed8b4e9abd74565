"""`rig compare`: runs against the model and against recorded profiles."""

import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import typer

from rig.cli.compare_example import EXAMPLES, compare_example, write_sidecar
from rig.cli.compare_group import GroupInput, compare_group, named_group, read_group, refuse_options
from rig.cli.options import HTML, MOST_FRICTION, ExactOption, JsonOption, checked_file, numbers, option
from rig.cli.output import THE_FINGER, busy, complain, out, print_json, writes_json
from rig.cli.recorded_run import recorded_run
from rig.cli.request import Alone, Excludes, Needs, Rule, given_options, repeats, takes
from rig.compare.comparison import Comparison, compare, left_out, left_out_lines
from rig.compare.comparison_rows import as_json as comparison_as_json
from rig.compare.comparison_rows import fingers_as_json
from rig.compare.likelihood import Form
from rig.compare.make_verdict import answers
from rig.compare.place_grid import PlaceRange, ReceptorLocation, place_lines, places_as_json
from rig.compare.plausible_fingers import PlausibleFingers, on_plausible_fingers, read_plausible
from rig.compare.receptor_place import RequestedRanges, common_range, places, refuse_uncovered
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.reading import Reading, read_recordings, refuse_unused_options, sha256
from rig.compare.recordings.recording import Recording
from rig.compare.spike_clock import (
    ClockShift,
    clock_shift,
    columns_sentences,
    contents_sentences,
    outcome_of,
    recording_sentences,
    recordings_as_json,
    shift_as_json,
)
from rig.compare.stimuli import StimulusRow, pressed, stimuli, stimulus_maps
from rig.compare.verdict import AfferentVerdict
from rig.compare.verdict_text import TOO_FEW, positions, sentence
from rig.compare.wider_run import with_wider_runs
from rig.data.run import Run, warnings_as_json
from rig.errors import BadInputError
from rig.plan.config import load_config
from rig.plan.finger_model import from_copy
from rig.report.comparison_report import fingers_sections, place_section, write_comparison
from rig.report.page_parts import Section
from rig.report.page_source import indentors_in_words
from rig.report.recording_sections import Deflection, deflection_section, read_deflections, simulated
from rig.report.spikes_section import spikes_sections
from sim.contact.indentor import ACROSS
from sim.contact.shapes import parse_shape, with_size
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM
from sim.models.fingertip import Fingertip
from sim.models.interpolation import HOW_MADE

_RECORDING, _MODEL, _RECEPTORS, _OUTPUT = "Recording", "Model", "Receptors", "Output"


@dataclass(frozen=True)
class CompareRequest:
    """Arguments and options of `rig compare`."""

    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="RUN...", help="Run folders to compare with the recordings.")
    ] = None
    example: Annotated[str | None, option("Shipped recording to rehearse: bar3.", "NAME", _RECORDING)] = None
    recorded: Annotated[
        list[str] | None,
        option("Recording (may be repeated), or a table or folder of several afferents.", "SHAPE=FILE", _RECORDING),
    ] = None
    columns: Annotated[
        list[str] | None, option("Columns of the recordings, e.g. position=x:um,rate=FR.", "ROLE=COLUMN", _RECORDING)
    ] = None
    mirror: Annotated[list[str] | None, option("Indentor whose positions to negate.", "SHAPE", _RECORDING)] = None
    normalize: Annotated[
        bool, option("Divide rates by the largest of their family.", panel=_RECORDING, name="--normalize")
    ] = False
    window_s: Annotated[
        str, option("Window in which spikes count: BEGIN,END, in s from the start of the hold.", "A,B", _RECORDING)
    ] = "0,1"
    field_centre_mm: Annotated[float, option("x of the receptive field for spikes, in mm.", "X", _RECORDING)] = 0.0
    deflection: Annotated[
        Path | None, option("Measured skin deflection (docs/comparison.md).", "CSV", _RECORDING)
    ] = None
    receptor_x_mm: Annotated[str | None, option("Receptor x, in mm. Default: ten receptors.", "X,X…", _RECEPTORS)] = (
        None
    )
    receptor_depth_mm: Annotated[float, option("Depth of the receptors below the skin, in mm.", "D", _RECEPTORS)] = (
        DEFAULT_DEPTH_MM
    )
    fingers: Annotated[Path | None, option("Ranges of the finger (docs/comparison.md).", "TOML", _MODEL)] = None
    saturating: Annotated[
        bool, option("Fit rates that saturate, with a third parameter.", panel=_MODEL, name="--saturating")
    ] = False
    silent_at_rest: Annotated[
        bool, option("Constrain the fit to k > 0 and ε₀ ≥ 0.", panel=_MODEL, name="--silent-at-rest")
    ] = False
    friction: Annotated[
        float,
        option("Friction coefficient. Default: 0.", "MU", _MODEL, within=(0, MOST_FRICTION), show_default=False),
    ] = 0.0
    place: Annotated[
        bool, option("Fit the receptor location too: x and depth with intervals.", panel=_RECEPTORS, name="--place")
    ] = False
    depth_range_mm: Annotated[
        str | None,
        option(
            "Depths below the skin that --place searches, in mm. Default: 0.1 to 0.7 mm below the epidermis.",
            "LOW,HIGH",
            _RECEPTORS,
        ),
    ] = None
    offset_mm: Annotated[
        str | None,
        option(
            "Offset range of the field center to fit with --place, in mm. Default: no offset.", "LOW,HIGH", _RECEPTORS
        ),
    ] = None
    out_file: Annotated[
        Path | None, option("Report. Default: comparison.html in the first run.", "HTML", _OUTPUT, name="--out")
    ] = None
    exact: ExactOption = False
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (
        Alone("--example", ("--out", "--json"), "example_alone", "it brings its own rehearsal and recording"),
        Excludes("--friction", ("--place", "--fingers"), "friction_with"),
        Needs("--depth-range-mm", ("--place",)),
        Needs("--offset-mm", ("--place",)),
        Needs("--place", ("--recorded",)),
    )

    def refuse_first(self) -> None:
        """Refuse options that do not apply to a table or folder of several afferents. Raises BadInputError."""
        if named_group(self.recorded or []) is not None:
            refuse_options(given_options(self, without=_WITH_GROUPS))


_WITH_GROUPS = (
    *("RUNS", "--recorded", "--columns", "--mirror", "--window-s", "--field-centre-mm", "--receptor-x-mm"),
    *("--receptor-depth-mm", "--friction", "--out", "--json"),
)
"""Options that apply to several afferents too."""


@takes(CompareRequest)
def command(request: CompareRequest) -> None:
    """Compare runs, write the report and a sidecar with dates and times."""
    began = time.perf_counter()
    group = named_group(request.recorded or [])
    if request.example is not None:
        _compare_example(request, request.example)
        return
    if not request.runs:
        raise BadInputError("compare: requires a run folder, or --example bar3", "needs_run")
    reading = Reading(
        _two("--window-s", request.window_s, "begin,end"), request.field_centre_mm, column_map(request.columns or [])
    )
    if request.out_file is not None:
        checked_file("--out", request.out_file, *HTML)
    report = request.out_file or request.runs[0] / "comparison.html"
    with busy("reading the runs …", quick=True):
        runs = _without_copies([recorded_run(path) for path in request.runs])
        if request.recorded:
            _refuse_other_fingers(runs)
    checked_file("--out", report)
    if group is not None:
        _compare_group(request, group, runs, reading, report)
    else:
        _compare_afferents(request, runs, reading, report)
    write_sidecar(report, time.perf_counter() - began)


def _compare_group(request: CompareRequest, group: Path, runs: list[Run], reading: Reading, report: Path) -> None:
    """Compare a table or folder of several afferents."""
    receptors = _receptors(request)
    recordings = read_group(group, request.mirror or [], runs, _pressed(runs, receptors), reading)
    answered = _answered(runs, receptors, request.friction)
    solved = [stimulus for one in answered for stimulus in one.stimuli]
    made_by = repeats("compare", request, without=_NOT_OF_THE_REPORT)
    compare_group(GroupInput(recordings, runs, solved, made_by), report)


def _compare_afferents(request: CompareRequest, runs: list[Run], reading: Reading, report: Path) -> None:
    """Compare recordings of one afferent for each shape, or only simulate."""
    plausible = None if request.fingers is None else read_plausible(request.fingers)
    with busy("reading the recordings …", quick=True):
        recordings = read_recordings(request.recorded or [], request.mirror or [], runs, reading)
        refuse_unused_options(recordings.values(), reading)
        compare(_pressed(runs, _receptors(request)), recordings, normalize=request.normalize)
        measured = [] if request.deflection is None else _measured_deflection(runs, request.deflection)
    where = _sought(request, runs)
    if where is not None:
        refuse_uncovered(runs, recordings, where, normalize=request.normalize)
    answered = _answered(runs, _receptors(request), request.friction)
    with busy("skin along the finger: computing its deflection …", quick=True):
        beside = _along_the_finger(answered, measured, request.deflection)
    comparison = _compared(request, answered, recordings, plausible)
    if any(left_out(overlay).any() for overlay in comparison.overlays):
        with busy("positions left out: checking how far a run may reach …"):
            by_run = {one.run.folder.path.name: (one.run, one.finger) for one in answered}
            comparison = with_wider_runs(comparison, by_run)
    form = Form(request.saturating, request.silent_at_rest)
    with busy("comparing every measure with the recordings …") if recordings else nullcontext():
        verdicts = answers(comparison, form)

    def outcome(shifted: Mapping[str, Recording]) -> object:
        again = compare(comparison.stimuli, shifted, normalize=request.normalize, plausible=plausible)
        return outcome_of(answers(again, form))

    timed = any(one.spikes for one in recordings.values())
    with busy(THE_CLOCK) if timed else nullcontext():
        shift = clock_shift(recordings, outcome)
    with busy(THE_PLACES) if where else nullcontext():
        at = places(runs, recordings, where, form, normalize=request.normalize) if where else []
    with busy(THE_MAPS):
        maps = [m for one in answered for m in stimulus_maps(one.run, one.finger, one.stimuli)]
    with busy("writing the report …"):
        write_comparison(
            report,
            comparison,
            runs,
            answered[0].finger,
            repeats("compare", request, without=_NOT_OF_THE_REPORT),
            [
                *spikes_sections({"": recordings}, shift),
                *map(place_section, at),
                *fingers_sections(comparison),
                *beside,
            ],
            maps=maps,
            answers=verdicts,
        )
    if writes_json():
        result = comparison_as_json(comparison, str(report), verdicts, places_as_json(at))
        result["recordings"], result["clock_shift"] = recordings_as_json({"": recordings}), shift_as_json(shift)
        result["indentors_text"] = indentors_in_words(runs)
        if measured:
            result["deflection_text"] = " ".join(one.contents for one in measured)
        if (with_fingers := fingers_as_json(comparison)) is not None:
            result["fingers"] = with_fingers
        if with_warnings := warnings_as_json(runs):
            result["warnings"] = with_warnings
        print_json(result)
    else:
        _print(comparison, verdicts, at, report, _of_the_clock(recordings, shift))
        for one in measured:
            out.print(f"deflection  {one.contents}")
        if comparison.interpolated:
            out.print(
                f"simulated responses of the plausible fingers were {HOW_MADE}; --exact builds a full model of each"
            )


_NOT_OF_THE_REPORT = ("--out", "--json")


def _compare_example(request: CompareRequest, example: str) -> None:
    if example not in EXAMPLES:
        raise BadInputError(f"--example {example}: must be one of {', '.join(EXAMPLES)}", "no_such_example")
    made_by = repeats("compare", request, without=_NOT_OF_THE_REPORT)
    compare_example(request.out_file or Path(f"{example}.html"), made_by)


THE_MAPS = "strain under the skin: reading it from the cache, or computing it …"
THE_CLOCK = "clock of the spike times: shifting it …"
THE_PLACES = "receptor locations: loading strains from the cache, or computing them …"


class Receptors(NamedTuple):
    """Receptor locations."""

    x_mm: tuple[float, ...]
    depth_mm: float


def _receptors(request: CompareRequest) -> Receptors:
    x_mm = numbers("--receptor-x-mm", request.receptor_x_mm) if request.receptor_x_mm else DEFAULT_X_MM
    return Receptors(x_mm, request.receptor_depth_mm)


@dataclass(frozen=True)
class Answered:
    """A run, the finger of its configuration, and the simulated responses."""

    run: Run
    finger: Fingertip
    stimuli: list[StimulusRow]


def _pressed(runs: Sequence[Run], receptors: Receptors) -> list[StimulusRow]:
    """Return what the runs pressed, without responses."""
    found = [one for run in runs for one in pressed(run, receptors.x_mm)]
    if not found:
        raise BadInputError(
            f"run folder {runs[0].folder.path}: contains no finished indentation; compare a run with at least one",
            "nothing_finished",
        )
    return found


def _answered(runs: list[Run], receptors: Receptors, friction: float) -> list[Answered]:
    """Return the simulated responses to each run."""
    fingers = [finger.with_friction(friction) for finger in _fingers(runs, receptors)]
    with busy("simulated responses: reading them from the cache, or computing them …"):
        return [Answered(run, finger, stimuli(run, finger)) for run, finger in zip(runs, fingers, strict=True)]


def _compared(
    request: CompareRequest,
    answered: list[Answered],
    recordings: dict[str, Recording],
    plausible: PlausibleFingers | None,
) -> Comparison:
    """Compare, with the responses of every plausible finger if ranges are set; reject incompatible input first."""
    comparison = compare([s for one in answered for s in one.stimuli], recordings, normalize=request.normalize)
    if plausible is None:
        return comparison
    with busy("plausible fingers: reading their responses from the cache, or computing them …"):
        found = [on_plausible_fingers(a.run, a.stimuli, a.finger, plausible, exact=request.exact) for a in answered]
        on_all = [stimulus for some in found for stimulus in some]
    return compare(on_all, recordings, normalize=request.normalize, plausible=plausible)


def _without_copies(runs: Sequence[Run]) -> list[Run]:
    """Return each run once, from the folder with the most of its journal; say which folders are copies."""
    kept: dict[object, Run] = {}
    for run in runs:
        uid = run.start.get("uid") or run.folder.path
        other = kept.setdefault(uid, run)
        if other is not run:
            more, less = (other, run) if _events(other) >= _events(run) else (run, other)
            complain(f"{less.folder.path}: a copy of {more.folder.path} (uid {uid}); the run is compared once")
            kept[uid] = more
    return list(kept.values())


def _events(run: Run) -> int:
    return sum(map(len, run.events.values()))


def _of_the_clock(recordings: Mapping[str, Recording], shift: ClockShift | None) -> list[str]:
    """Return lines on the columns that were read, presses that were not observed, and the clock of spike times."""
    several = len(recordings) > 1
    lines = [f"{f'{one.name}: ' if several else ''}{said}" for one in recordings.values()
             for said in recording_sentences(one)]  # fmt: skip
    read = [*columns_sentences(recordings.values()), *contents_sentences({"": recordings})]
    return [*read, *lines, *([] if shift is None else [shift.sentence])]


def _measured_deflection(runs: Sequence[Run], file: Path) -> list[Deflection]:
    """Return measured deflections; refuse them beside runs without an indentor across the finger."""
    found = read_deflections(file)
    shapes = (from_copy(run.folder.path, one.indentor) for run in runs for one in pressed(run, ()))
    if not any(parse_shape(shape).axes == ACROSS for shape in shapes):
        raise BadInputError(
            f"--deflection {file}: the runs contain no shape that lies across the finger; add a run with one, "
            "or compare a single press with rig indent --deflection",
            "nothing_across",
        )
    return found


def _along_the_finger(answered: list[Answered], measured: list[Deflection], file: Path | None) -> list[Section]:
    """Return sections on skin deflection under indentors across the finger, with measured deflections overlaid."""
    profiles = [profile for one in answered for profile in simulated(one.run, one.finger)]
    source = "" if file is None else f"{file.name} (SHA-256 {sha256(file)})"
    return [deflection_section(profiles, measured, source)] if profiles else []


def _fingers(runs: list[Run], receptors: Receptors) -> list[Fingertip]:
    """Return the finger of each run's configuration."""
    configs = [load_config(run.folder.path / "config.toml").finger for run in runs]
    loaded: dict[str, Fingertip] = {}
    with busy(THE_FINGER):
        for config in configs:
            name = config.model_dump_json()
            if name not in loaded:
                loaded[name] = Fingertip.load(
                    config, receptor_x_mm=receptors.x_mm, receptor_depth_mm=receptors.depth_mm
                )
    return [loaded[config.model_dump_json()] for config in configs]


def _refuse_other_fingers(runs: Sequence[Run]) -> None:
    """Refuse runs on different fingers: one fit has one finger."""
    first, *others = [_leaves(load_config(run.folder.path / "config.toml").finger.model_dump()) for run in runs]
    for run, finger in zip(runs[1:], others, strict=True):
        names = [name for name in sorted({*first, *finger}) if first.get(name) != finger.get(name)]
        differing = [f"finger.{name} ({first.get(name)} and {finger.get(name)})" for name in names[:_MOST_DIFFERING]]
        if differing:
            raise BadInputError(
                f"run folders {runs[0].folder.path} and {run.folder.path}: their fingers differ in "
                f"{', '.join(differing)}; compare runs on one finger, or each run alone",
                "other_finger",
            )


_MOST_DIFFERING = 5


def _leaves(tree: Mapping[str, Any], under: str = "") -> dict[str, object]:
    """Return the values of nested tables by their dotted names."""
    found: dict[str, object] = {}
    for name, value in tree.items():
        found |= _leaves(value, f"{under}{name}.") if isinstance(value, dict) else {f"{under}{name}": value}
    return found


def _sought(request: CompareRequest, runs: list[Run]) -> PlaceRange | None:
    """Return the range of receptor locations to search, or None without --place."""
    if not request.place:
        return None
    ranges = {"--depth-range-mm": request.depth_range_mm, "--offset-mm": request.offset_mm}
    depth, offset = (None if text is None else _two(name, text, "LOW,HIGH") for name, text in ranges.items())
    x_mm = _receptors(request).x_mm
    return common_range(runs, RequestedRanges((min(x_mm), max(x_mm)), depth, offset))


def _two(option: str, text: str, named: str) -> tuple[float, float]:
    ends = numbers(option, text)
    if len(ends) != 2:
        raise BadInputError(f"{option} {text!r}: must be two numbers, {named}", "wrong_count")
    return ends[0], ends[1]


def _print(
    comparison: Comparison,
    verdicts: Sequence[AfferentVerdict],
    at: Sequence[ReceptorLocation],
    report: Path,
    clock: Sequence[str],
) -> None:
    names = comparison.candidates()
    out.print(", ".join(f"{with_size(one.indentor)} at {one.condition}" for one in comparison.stimuli))
    for answer in verdicts:
        under = f"{answer.title}: " if len(verdicts) > 1 else ""
        out.print(f"answer      {under}{sentence(answer)}")
        if answer.outcome != "silent":
            out.print(f"positions   {positions(answer)}")
    if comparison.overlays and not verdicts:
        out.print(f"answer      {TOO_FEW}")
    for number, line in enumerate(clock):
        out.print(f"{'' if number else 'recording':<12}{line}")
    for line in place_lines(at):
        out.print(f"place       {line}")
    for line in [] if verdicts else left_out_lines(comparison):
        out.print(f"left out    {line}")
    out.print(f"shape test  passed by {', '.join(names) or 'no measure'}; it does not use the recordings")
    out.print(f"report      {report}")
