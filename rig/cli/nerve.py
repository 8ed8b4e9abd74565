"""`rig nerve`: add the spikes of simulated afferents to a run."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NotRequired

from rig.cli.options import JsonOption, RunArgument, checked_file, option
from rig.cli.output import THE_FINGER, busy, complain, out, print_json, writes_json
from rig.cli.recorded_run import recorded_run
from rig.cli.request import takes
from rig.data.run import Run, RunWarningJson, warnings_as_json
from rig.data.tables import foreign_in_one_line
from rig.errors import BadInputError
from rig.plan.config import Config, load_config
from rig_shared.outputs import File, Name, Output, Ratio
from rig_shared.plural import number_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rig.data.spike_files import SpikeRecord
    from rig.plan.nerve import FiringSpeed, SpikeRequest, Visits
    from rig.session.rehearsal_summary import FiringSpeedJson
    from sim.models.fingertip import Fingertip
    from sim.nerve.population import AfferentPopulation

AFFERENTS = "3xSA1,5xRA"
AFFERENTS_HELP = (
    "Afferents: 3xSA1 at random locations on the pad, SA1@X or SA1@X:ALONG at a location (mm), separated by commas; "
    "or a density such as 'monkey fingertip'."
)
MOST_SEED, MOST_PATH_M = 1_000_000, 2.0


class SimulatedAfferentJson(Output):
    """An afferent of the finger model, and how many spikes it fired."""

    afferent: Name
    model: Name
    """Class: SA1, RA or PC."""
    x_mm: float
    along_mm: float
    """Place along the finger, from the receptor plane."""
    depth_mm: float
    sensitivity: Ratio
    delay_s: float
    """Delay from a spike at the receptor to the same spike at the electrode."""
    spikes: int


class SpikesJson(Output):
    """Spikes of simulated afferents, which are not data; `left_out` presses have no contact height."""

    run: File
    seed: int
    electrode_text: str
    afferents: list[SimulatedAfferentJson]
    left_out: int
    files: list[File]
    warnings: NotRequired[list[RunWarningJson]]


class NerveJson(SpikesJson):
    """Spikes of simulated afferents, which are not data; `left_out` presses have no contact height."""

    report: File


@dataclass(frozen=True)
class NerveRequest:
    """Arguments and options of `rig nerve`."""

    run: RunArgument
    afferents: Annotated[str, option(AFFERENTS_HELP, "LIST")] = AFFERENTS
    seed: Annotated[
        int, option("Seed of the random locations, sensitivities and noise.", "N", within=(0, MOST_SEED - 1))
    ] = 0
    path_m: Annotated[float, option("Length of the nerve from the fingertip to the electrode, in m.", "M")] = 0.2
    as_json: JsonOption = False


@takes(NerveRequest)
def nerve_command(request: NerveRequest) -> None:
    """Simulate spikes during a run, write them to its folder, and update its report. They are synthetic, not data."""
    wanted = spike_request(request.afferents, request.seed, request.path_m)
    with busy("reading the run …", quick=True):
        found = recorded_run(request.run)
    checked_file("RUN", found.folder.report)
    with foreign_in_one_line(request.run):
        settings = load_config(found.folder.config)
        with busy(THE_FINGER):
            from rig.plan.nerve import visits_of
            from sim.models.fingertip import Fingertip

            finger = Fingertip.load(settings.finger)
        with busy("drawing the afferents, and when they fire …"):
            begun = visits_of(found, settings), wanted.drawn(finger)
            from rig.plan.nerve import firing_speeds, presses_of_visits

            speeds = firing_speeds(finger, begun[1], presses_of_visits(found, begun[0]))
        print_firing(speeds)
        with found.folder.owned():
            answer = _add(finger, found, wanted, *begun)
            from rig.cli.runs import renewed_report  # `rig run` does without

            renewed_report(found, finger, {Path(name).name for name in answer["files"]})
    report = found.folder.report
    if writes_json():
        reported: NerveJson = {**answer, "report": str(report)}
        if warnings := warnings_as_json([found]):
            reported["warnings"] = warnings
        print_json(reported)
    else:
        out.print("\n".join([*spike_lines(answer), f"report  {report}"]))


def print_firing(speeds: "Sequence[FiringSpeed]") -> None:
    """Print the speed at which each class fires; a warning if none is expected to."""
    if not writes_json():
        for one in speeds:
            out.print(f"firing  {one.sentence}")
    if all(one.silent for one in speeds):
        complain("warning: no afferent is expected to fire; press faster or deeper, or ask for other afferents")


def firing_as_json(speeds: "Sequence[FiringSpeed]") -> "list[FiringSpeedJson]":
    """Return the same speeds for `rig check --json`."""
    return [
        {
            "model": one.model,
            "afferents": one.afferents,
            "sensitivity": one.sensitivity,
            "firing_speed_mm_s": one.slowest_mm_s,
            "doi_mm": one.doi_mm,
            "press_speed_mm_s": one.fastest_mm_s,
            "silent": one.silent,
        }
        for one in speeds
    ]


def spike_request(afferents: str, seed: int, path_m: float = 0.2) -> "SpikeRequest":
    """Return the requested spikes. Raises BadInputError or ModelRangeError before any computation."""
    from rig.plan.nerve import SpikeRequest

    if not 0 < path_m <= MOST_PATH_M:
        raise BadInputError(f"--path-m {path_m:g}: must be more than 0 and at most {MOST_PATH_M:g}", "outside_range")
    wanted = SpikeRequest(afferents, seed, path_m)
    wanted.refuse()
    return wanted


def add_spikes(finger: "Fingertip", run: Run, config: Config, wanted: "SpikeRequest") -> SpikesJson:
    """Write the spikes of a run into its folder; return the JSON output of the command, without the report."""
    from rig.plan.nerve import visits_of

    return _add(finger, run, wanted, visits_of(run, config), wanted.drawn(finger))


def _add(
    finger: "Fingertip",
    run: Run,
    wanted: "SpikeRequest",
    found: "Visits",
    afferents: "AfferentPopulation",
) -> SpikesJson:
    from rig.data.export import export_spikes
    from rig.plan.nerve import run_spikes

    with busy(
        f"simulating the spikes of {number_of(len(afferents), 'afferents')} …",
    ) as now:
        record = run_spikes(
            run, found, finger, afferents, seed=wanted.seed, path_m=wanted.path_m, show_progress=now.at
        )
    with busy("writing the spikes …", quick=True):
        files, missing = export_spikes(run, record)
    if missing:
        extras = ",".join(missing)
        complain(f"warning: not written without the extra {extras}: pip install 'indentation-rig[{extras}]'")
    return {
        "run": str(run.folder.path),
        "seed": wanted.seed,
        "electrode_text": record.electrode,
        "afferents": _as_rows(record),
        "left_out": found.left_out,
        "files": [str(path) for path in files],
    }


def _as_rows(record: "SpikeRecord") -> list[SimulatedAfferentJson]:
    return [
        {
            "afferent": one.afferent,
            "model": one.model,
            "x_mm": one.x_mm,
            "along_mm": one.along_mm,
            "depth_mm": one.depth_mm,
            "sensitivity": one.sensitivity,
            "delay_s": one.delay_s,
            "spikes": len(one.spike_s),
        }
        for one in record.trains
    ]


def spike_lines(answer: SpikesJson) -> list[str]:
    """Return the lines that describe simulated spikes."""
    counts = ", ".join(f"{one['afferent']} {one['spikes']}" for one in answer["afferents"][:20])
    more = f", and {len(answer['afferents']) - 20} more" if len(answer["afferents"]) > 20 else ""
    lines = [f"spikes  synthetic, electrode {answer['electrode_text']}: {counts}{more}"]
    if not any(one["spikes"] for one in answer["afferents"]):
        lines.append("        no afferent fired")
    if answer["left_out"]:
        lines.append(f"        left out: {number_of(answer['left_out'], 'presses')} without a contact height")
    return [*lines, *(f"file    {name}" for name in answer["files"])]
