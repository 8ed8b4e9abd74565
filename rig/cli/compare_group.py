"""`rig compare` with a table or folder of several afferents."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple, NotRequired

from rig.cli.output import busy, out, print_json, writes_json
from rig.compare.comparison import LeftOutOfRecordingJson, compare, left_out_rows
from rig.compare.group import group_verdict
from rig.compare.group_text import (
    AfferentAnswerJson,
    GroupVerdictJson,
    afferents_as_json,
    group_as_json,
    in_short,
    sentence_of_group,
    sentences_of_group,
)
from rig.compare.likelihood import Form
from rig.compare.make_verdict import CandidatePool, afferents, answers, candidate_pool
from rig.compare.recordings.afferents_table import Recordings, read_afferents
from rig.compare.recordings.reading import Reading, refuse_unused_options
from rig.compare.recordings.recording import Recording
from rig.compare.recordings.table_cells import file_and_sheet
from rig.compare.spike_clock import (
    ClockShiftJson,
    RecordingJson,
    clock_shift,
    columns_sentences,
    contents_sentences,
    recording_sentences,
    recordings_as_json,
    shift_as_json,
)
from rig.compare.stimuli import StimulusRow
from rig.compare.verdict import AfferentVerdict
from rig.compare.verdict_text import positions
from rig.data.run import Run, RunWarningJson, warnings_as_json
from rig.errors import BadInputError
from rig.report.group_page import GroupPage, write_group_page
from rig_shared.outputs import File, Name, Output

_SILENT = "it hardly fired"
_TOO_FEW = "the runs cover too few of its positions"


class LeftOutOfAfferentJson(LeftOutOfRecordingJson):
    """Positions of a recording of an afferent that are left out."""

    afferent: Name


class GroupJson(Output):
    """Several afferents. group: null below two afferents with enough positions."""

    group: GroupVerdictJson | None
    afferents: list[AfferentAnswerJson]
    afferents_left_out: list[Name]
    left_out: list[LeftOutOfAfferentJson]
    report: File
    recordings: list[RecordingJson]
    clock_shift: ClockShiftJson | None
    warnings: NotRequired[list[RunWarningJson]]


def named_group(recorded: Sequence[str]) -> Path | None:
    """Return the table or folder of several afferents that --recorded names, or None."""
    paths = [Path(text) for text in recorded if file_and_sheet(Path(text))[0].exists()]
    return paths[0] if len(recorded) == 1 and paths else None


class GroupInput(NamedTuple):
    """Recordings of several afferents, the runs to compare them with, and the command."""

    recordings: Recordings
    runs: Sequence[Run]
    stimuli: Sequence[StimulusRow]
    command: str


def read_group(
    path: Path, mirror: Sequence[str], runs: Sequence[Run], pressed: Sequence[StimulusRow], reading: Reading
) -> Recordings:
    """Return the recordings of several afferents, each of which the runs pressed. Raises RecordingError."""
    with busy("reading the recordings …", quick=True):
        found = read_afferents(path, mirror, runs, pressed, reading)
        refuse_unused_options((one for some in found.values() for one in some.values()), reading)
    return found


def refuse_options(options: Sequence[str]) -> None:
    """Refuse options that apply to the recordings of one afferent only."""
    for option in options:
        raise BadInputError(
            f"{option} does not apply to several afferents; remove it, or compare one afferent with "
            "--recorded SHAPE=FILE",
            "not_for_groups",
        )


_SHIFTS_S = (0.1, 0.5)
"""Shifts of the clock that are tried: each repeats the comparison of every afferent."""


def _judged(
    stimuli: Sequence[StimulusRow], found: Recordings
) -> tuple[dict[str, tuple[CandidatePool, AfferentVerdict]], dict[str, str], str]:
    """Return the verdicts on the afferents, those left out with the reason, and the note on small strain."""
    judged: dict[str, tuple[CandidatePool, AfferentVerdict]] = {}
    left_out: dict[str, str] = {}
    small_strain = ""
    for name, recordings in found.items():
        comparison = compare(stimuli, recordings)
        small_strain = small_strain or comparison.small_strain.note
        (overlays,) = afferents(comparison)
        pool, verdict = candidate_pool(overlays, Form()), answers(comparison)
        if pool is None or not verdict:
            left_out[name] = _TOO_FEW
        elif verdict[0].outcome == "silent":
            left_out[name] = _SILENT
        else:
            judged[name] = pool, verdict[0]
    return judged, left_out, small_strain


def _answer(stimuli: Sequence[StimulusRow], flat: Mapping[str, Recording]) -> object:
    """Return what a shift of the clock may change: the outcome and set of the group, and the afferents left out."""
    found: Recordings = {}
    for name, one in flat.items():
        afferent, _, key = name.partition("\n")
        found.setdefault(afferent, {})[key] = one
    judged, left_out, _ = _judged(stimuli, found)
    group = group_verdict(judged)
    return None if group is None else (group.outcome, sorted(row.name for row in group.set), sorted(left_out))


def compare_group(of: GroupInput, report: Path) -> None:
    """Compare every afferent and the group, and write the page."""
    found = of.recordings
    with busy("comparing every measure with every afferent …"):
        judged, left_out, small_strain = _judged(of.stimuli, found)
        group = group_verdict(judged)
    verdicts = {name: one for name, (_, one) in judged.items()}
    flat = {f"{name}\n{key}": one for name, some in found.items() for key, one in some.items()}
    timed = any(one.spikes for one in flat.values())
    with busy("clock of the spike times: shifting it …") if timed else nullcontext():
        shift = clock_shift(flat, lambda shifted: _answer(of.stimuli, shifted), _SHIFTS_S)
    page = GroupPage(group, verdicts, found, left_out, of.runs, of.command, small_strain, shift)
    with busy("writing the report …"):
        write_group_page(report, page)
    if writes_json():
        result: GroupJson = {
            "group": group_as_json(group),
            "afferents": afferents_as_json(verdicts),
            "afferents_left_out": list(left_out),
            "left_out": [
                {"afferent": name, **row}
                for name, some in found.items()
                for row in left_out_rows(compare(of.stimuli, some))
            ],
            "report": str(report),
            "recordings": recordings_as_json(found),
            "clock_shift": shift_as_json(shift),
        }
        if with_warnings := warnings_as_json(of.runs):
            result["warnings"] = with_warnings
        print_json(result)
        return
    out.print(page.title)
    out.print(f"group       {sentence_of_group(group)}")
    for line in sentences_of_group(group) if group is not None else ():
        out.print(f"            {line}")
    for name, one in verdicts.items():
        out.print(f"{name:<12}{in_short(one)}")
        if one.left_out:
            out.print(f"{'':<12}{positions(one)}")
    for name, why in left_out.items():
        out.print(f"{name:<12}left out: {why}")
    for name, some in found.items():
        for read in (read for read in some.values() if read.spikes is not None):
            out.print(f"{name:<12}{read.name}: {' '.join(recording_sentences(read))}")
    columns = columns_sentences(read for some in found.values() for read in some.values())
    for line in (*columns, *contents_sentences(found)):
        out.print(f"recordings  {line}")
    if shift is not None:
        out.print(f"clock       {shift.sentence}")
    out.print(f"report      {report}")
