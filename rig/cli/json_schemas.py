"""Schemas of the JSON output of each command; the reference page and the tests are made from them.

Numbers are numbers. A quantity has its unit at the end of its key (`force_gwt`), or beside it in `unit`. Prose is in
keys that end in `_text`. Identifiers come from closed lists, or have a format that says whose names they are.
"""

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal, NotRequired, Union

from pydantic import ConfigDict, Field, TypeAdapter
from typing_extensions import TypedDict

from rig.compare.group import GroupOutcome
from rig.compare.recordings.spike_times import ClockSource
from rig.compare.stimuli import CONTROLS
from rig.compare.verdict import A_CONSTANT, Outcome
from rig.data.run_status import RunStatus
from rig.engine.contact import ContactKind
from rig.records import Phase
from rig.session.early_ending import Left
from rig.units import UNITS
from sim.benchmark import FAMILIES, LEVELS, QUANTITIES
from sim.coding.operators import OperatorName
from sim.coding.section import Energy
from sim.coding.shape_class import SolidClass
from sim.coding.task import DecoderName
from sim.finger.mesh import LAYERS
from sim.identification.prior import PARAMETERS, named
from sim.measures.measures import MEASURES
from sim.models.cache import KINDS
from sim.models.catalogue import ModelName

SUFFIXES: Mapping[str, str] = UNITS | {
    "mm2": "mm²",
    "n_per_mm": "N/mm",
    "cycles_per_mm": "1/mm",
    "pa_per_pseudo": "Pa per pseudo-unit",
    "mpa": "MPa",
    "pseudo": "pseudo-unit",
    "bits": "bit",
    "mb": "MB",
    "bytes": "bytes",
    "hz": "1/s",
}
"""Units by the end of a key."""

DIMENSIONLESS = "1"
UNIT_FIELDS = (
    "", DIMENSIONLESS, *dict.fromkeys(SUFFIXES.values()),
    "pseudo-unit³", "1/pseudo-unit", "impulses/s",
)  # fmt: skip
"""Values of `unit`; empty where a value has none."""

FORMATS = ("name", "shape", "path", "port", "uri", "date-time", "date", "command-line", "toml", "code")
"""Formats of strings that are neither prose nor from a list."""


class Output(TypedDict):
    """An object of which every key is listed."""

    __pydantic_config__ = ConfigDict(extra="forbid", use_attribute_docstrings=True)  # type: ignore[misc]


Name = Annotated[str, Field(json_schema_extra={"format": "name"})]
Shape = Annotated[str, Field(json_schema_extra={"format": "shape"})]
File = Annotated[str, Field(json_schema_extra={"format": "path"})]
Port = Annotated[str, Field(json_schema_extra={"format": "port"})]
Uri = Annotated[str, Field(json_schema_extra={"format": "uri"})]
Time = Annotated[str, Field(json_schema_extra={"format": "date-time"})]
Day = Annotated[str, Field(json_schema_extra={"format": "date"})]
CommandLine = Annotated[str, Field(json_schema_extra={"format": "command-line"})]
Toml = Annotated[str, Field(json_schema_extra={"format": "toml"})]
Code = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$", json_schema_extra={"format": "code"})]
Unit = Annotated[str, Field(json_schema_extra={"enum": list(UNIT_FIELDS)})]
Ratio = Annotated[float, Field(json_schema_extra={"unit": DIMENSIONLESS})]
Measure = Annotated[str, Field(json_schema_extra={"enum": list(MEASURES)})]
Candidate = Annotated[str, Field(json_schema_extra={"enum": [*MEASURES, *CONTROLS, A_CONSTANT]})]
State = Annotated[str, Field(json_schema_extra={"enum": list(RunStatus)})]
Parameter = Annotated[str, Field(json_schema_extra={"enum": [named(one.name) for one in PARAMETERS]})]
Quantity = Annotated[str, Field(json_schema_extra={"enum": list(QUANTITIES)})]
Level = Annotated[str, Field(json_schema_extra={"enum": list(LEVELS)})]
Key = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")]
Setting = Any
"""A value of a configuration or of a protocol's parameter."""
Range = tuple[float, float]
Ends = tuple[Ratio, Ratio]
Limits = tuple[float | None, float | None]
Places = list[float] | list[Range]
"""Places along the skin; of a sheet, x and z of each."""


# --- what several commands print ---


class IndentorAtEndJson(Output):
    """Final position of the indentor."""

    left: Left
    x_mm: float | None
    height_mm: float | None
    trusted: bool
    may_touch: bool | None
    contact: ContactKind | None
    force_gwt: float | None
    measured_unix_s: float | None
    aged: bool


class EndingJson(Output):
    """Why a run ended early. A run whose journal has an end has no more than `reason_text` and `where_text`."""

    reason_text: str
    where_text: str | None
    indentor: NotRequired[IndentorAtEndJson]
    next_text: NotRequired[str]
    resume: NotRequired[CommandLine | None]
    """Command that continues the run; null if it never began."""


class FailureJson(Output):
    """A command that failed."""

    error_text: str
    """The line on standard error. It may change; match `code`."""
    code: Code
    exit_code: Literal[1, 2, 130]
    ending: NotRequired[EndingJson]


class SmallStrainJson(Output):
    """Deviation of a linear result from finite strain: smallest and largest; null without a comparison."""

    note_text: str
    force: Ends | None
    sed: Ends | None


class ContactJson(Output):
    """State of contact between indentor and finger; null where nothing is on record.

    measured_unix_s: when force and position were measured; null where the force never was.
    """

    contact: ContactKind | None
    may_touch: bool | None
    force_gwt: float | None
    measured_unix_s: float | None
    where_text: str
    to_do_text: str | None


class DeviceLookJson(Output):
    """A device: who owns its port, or its state, or the problem and its code."""

    kind: Name
    ports: list[Port]
    owner: NotRequired[int | None]
    """Process that owns the port; null if the system does not report it."""
    owner_text: NotRequired[str]
    does_text: NotRequired[str]
    since_utc: NotRequired[Time]
    stop: NotRequired[CommandLine]
    identity: NotRequired[Name]
    problem_text: NotRequired[str]
    code: NotRequired[Code]


class StageLookJson(DeviceLookJson):
    """State of the stage, with its position in machine coordinates."""

    state: NotRequired[Name]
    x_mm: NotRequired[float]
    y_mm: NotRequired[float]
    z_mm: NotRequired[float]


class ForceLookJson(DeviceLookJson):
    """State of the force sensor."""

    force_n: NotRequired[float]
    stable: NotRequired[bool]


class FileSizeJson(Output):
    """A file."""

    name: Name
    bytes: int


class PackageJson(Output):
    """A package and its version."""

    package: Name
    version: Name


# --- experiment ---


class ProbableCandidateJson(Output):
    """A candidate after the counts of an adaptive run."""

    name: Name
    probability: Ratio
    in_set: bool


class AdaptiveVerdictJson(Output):
    """Verdict of an adaptive run; `truth`: that of a virtual nerve, `planned_from`: press where counts stopped."""

    candidates: list[ProbableCandidateJson]
    ended: Code | None
    truth: Name | None
    planned_from: int | None


class FinishedRunJson(Output):
    """A run that was carried out or resumed."""

    run: File
    complete: bool
    indentations: int
    duration_s: float
    wall_s: float
    report: File | None
    choice: NotRequired[AdaptiveVerdictJson]
    missing: NotRequired[int]
    repeated: NotRequired[int]
    restarted: NotRequired[int]
    code: NotRequired[Code]
    ending: NotRequired[EndingJson]
    deviation_text: NotRequired[str]
    files_text: NotRequired[str]


class MarginsJson(Output):
    """Margins to the limits."""

    force_gwt: float
    doi_mm: float
    mean_pressure_kpa: float
    contact_s: float


class PlannedStepJson(Output):
    """A planned indentation; bands hold 90 % and are those of an identified finger."""

    index: int
    indentor: Shape
    x_mm: float
    target: Literal["doi_mm", "force_gwt"]
    value: float
    unit: Literal["mm", "gwt"]
    increments: int
    hold_s: float
    doi_mm: float
    force_gwt: float
    force_band_gwt: NotRequired[Range]
    doi_band_mm: NotRequired[Range]
    highest_gwt: NotRequired[float]
    contact_area_mm2: float
    mean_pressure_kpa: float
    peak_pressure_kpa: float
    overshoot_gwt: float
    ramp_mm_s: NotRequired[float]
    """Speed of a ramp. The force limits below hold for the predicted stiffness."""
    ramp_fastest_mm_s: NotRequired[float]
    ramp_stop_mm: NotRequired[float]
    """Stopping distance, with the delays of sensor, reading and controller."""
    ramp_trip_gwt: NotRequired[float]
    ramp_bound_gwt: NotRequired[float]
    """Soft trip and overshoot of a press, which the ramp does not exceed either."""


class PossiblePressesJson(Output):
    """All presses that an adaptive run may choose."""

    presses: int
    peak_force_gwt: float
    peak_pressure_kpa: float
    soft_trip_n: float


class FiringSpeedJson(Output):
    """Slowest press at which the most sensitive afferent of a class fires; null if at none."""

    model: Name
    afferents: int
    sensitivity: Ratio
    firing_speed_mm_s: float | None
    doi_mm: float
    press_speed_mm_s: float
    silent: bool


class CheckJson(Output):
    """A protocol against the limits."""

    protocol: Name
    indentations: int
    other_presses: int
    duration_s: float
    contact_s: float
    peak_force_n: float
    peak_force_gwt: float
    small_strain: SmallStrainJson
    repeats: bool
    peak_pressure_kpa: float
    soft_trip_n: float
    hard_trip_n: float
    margins: MarginsJson
    sample_age_s: float
    press_speed_mm_s: float
    rise_gwt: float
    stop_distance_mm: float
    overshoot_gwt: float
    steps: list[PlannedStepJson]
    possible: NotRequired[PossiblePressesJson]
    firing: NotRequired[list[FiringSpeedJson]]


class IdentifiedParameterJson(Output):
    """A parameter of the finger, with its 90 % band; stiffness and moduli over the default's."""

    name: Parameter
    unit: Unit
    estimate: float
    """Value of the most likely finger whose parameters all lie within their bands."""
    mean: float
    sd: float
    low: float
    high: float


class PredictedForceJson(Output):
    """Force of a press on the identified finger with its 90 % band, in gwt."""

    shape: Shape
    x_mm: float
    doi_mm: float
    force_gwt: float
    low: float
    high: float
    unit: Literal["gwt"]


class IdentificationJson(Output):
    """An identified finger. `consistent`: the presses agree with a finger of the prior, and the bands hold."""

    run: File
    finger: File | None
    presses: int
    bench_s: float
    consistent: bool
    parameters: list[IdentifiedParameterJson]
    predicted: list[PredictedForceJson]
    problems_text: list[str]
    code: NotRequired[Code]
    ending: NotRequired[EndingJson]


class WatchJson(Output):
    """Current state of a run."""

    run: File
    state: State
    done: int
    planned: int
    force_gwt: float | None
    doi_mm: float | None
    x_mm: float | None
    height_mm: float | None
    phase: Phase | None
    now_text: str | None
    next_text: str | None
    left_s: float | None
    ending: EndingJson | None


class PanelJson(Output):
    """Address of the panel."""

    url: Uri
    port: int
    pid: int


class FingerFrameJson(Output):
    """Position of the finger in machine coordinates."""

    pad_centre_x_mm: float
    apex_z_mm: float
    roll_deg: NotRequired[float]
    tilt_deg: NotRequired[float]


class FindJson(Output):
    """Position of the finger, fitted to touches; `toml` is for the configuration."""

    value: FingerFrameJson
    sd: FingerFrameJson
    correlation: list[list[Ratio]]
    residual_mm: float
    touches: int
    toml: Toml


# --- results ---


class RunSummaryJson(Output):
    """A run."""

    name: Name
    date_utc: Time
    protocol: Name
    title: Name
    subject: Name
    shapes: list[Shape]
    state: State
    virtual: bool
    planned: int
    done: int
    duration_s: float


class UnreadableJson(Output):
    """A folder that cannot be read."""

    name: Name
    problem_text: str


class RunsJson(Output):
    """All runs of a folder."""

    runs: list[RunSummaryJson]
    unreadable: list[UnreadableJson]
    table: NotRequired[File]
    holds: NotRequired[int]


class PressesJson(Output):
    """Holds with one indentor to one target."""

    indentor: Shape
    target_doi_mm: float | None
    target_force_gwt: float | None
    increment: bool
    """Whether the presses went on to a further target after these holds."""
    holds: int
    from_x_mm: float
    to_x_mm: float
    mean_force_gwt: float
    mean_doi_mm: float
    peak_gwt: float


class RunDevicesJson(Output):
    """Devices of a run, and the identities that they reported."""

    stage: NotRequired[Name]
    force: NotRequired[Name]
    controller: NotRequired[Name]
    sensor: NotRequired[Name]


class RunModelJson(Output):
    """Finger model of a run."""

    nodes: NotRequired[int]
    e_epidermis_mpa: NotRequired[float]
    from_cache: NotRequired[bool]


class ShowJson(Output):
    """A run."""

    run: File
    title: Name
    protocol: Name
    source_text: str
    parameters: dict[Key, Setting]
    """Parameters of the protocol by their names."""
    subject: Name | None
    began_utc: Time
    duration_s: float
    virtual: bool
    state: State
    planned: int
    done: int
    ending: EndingJson | None
    presses: list[PressesJson]
    choice: NotRequired[AdaptiveVerdictJson]
    limits: dict[Key, Setting]
    """Table [limits] of the configuration, and the soft trip of the plan."""
    devices: RunDevicesJson
    versions: list[PackageJson]
    model: RunModelJson | None
    files: list[FileSizeJson]


class ColumnJson(Output):
    """A column of a run's tables."""

    table: Name
    name: Name
    unit: Unit
    dtype: Literal["bool", "text (UTF-8)", "float64"]
    what_text: str


class ColumnsJson(Output):
    """Columns of all tables."""

    columns: list[ColumnJson]


class ExportJson(Output):
    """Files that were written."""

    run: File
    files: list[File]


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


class NerveJson(Output):
    """Spikes of simulated afferents, which are not data."""

    run: File
    seed: int
    electrode_text: str
    afferents: list[SimulatedAfferentJson]
    left_out: int
    """Number of presses without a contact height."""
    files: list[File]
    report: File


class StimulusJson(Output):
    """A stimulus, and the number that was commanded."""

    stimulus: Name
    shape: Shape
    condition: Name
    target: Literal["doi_mm", "force_gwt"]
    value: float
    unit: Literal["mm", "gwt"]
    run: File


class ComparisonRowJson(Output):
    """A measure at a receptor under a stimulus, R = k (ε − ε₀). unit: of ε; k is in impulses/s per unit."""

    shape: Shape
    condition: Name
    measure: Measure
    unit: Unit
    receptor_mm: float
    shape_test: bool | None
    r: Ratio | None
    positions: int | None
    k: float | None
    eps0: float | None
    fires_unloaded: bool | None
    run: File


class MeasuresOfGroupJson(Output):
    """Measures that pass the shape test under a group of stimuli."""

    group: Name
    measures: list[Measure]


class CollinearInGroupJson(Output):
    """Sets of measures that no recording of a group can distinguish."""

    group: Name
    sets: list[list[Measure]]


class JointFitJson(Output):
    """A measure fitted to several shapes, by least squares, with 95 % limits of the likelihood."""

    shapes: list[Shape]
    condition: Name
    measure: Measure
    unit: Unit
    receptor_mm: float
    k: float | None
    k_interval: Limits | None
    eps0: float | None
    eps0_interval: Limits | None
    fires_unloaded: bool
    r2: Ratio | None


class FitValuesJson(Output):
    """Same fit on the run's own finger."""

    unit: Unit
    k: float | None
    k_interval: Limits | None
    eps0: float | None
    eps0_interval: Limits | None
    r2: Ratio | None


class NamedValueJson(Output):
    """A parameter of a finger, by its place in the configuration."""

    name: Name
    value: float
    unit: Unit


class NamedRangeJson(Output):
    """Range of a parameter of a finger."""

    name: Name
    low: float
    high: float
    unit: Unit


class FitWithFingerJson(Output):
    """A measure with its best plausible finger."""

    shapes: list[Shape]
    condition: Name
    measure: Measure
    unit: Unit
    receptor_mm: float
    r2: Ratio | None
    best_finger: list[NamedValueJson]
    k: float | None
    k_interval: Limits | None
    eps0: float | None
    eps0_interval: Limits | None
    on_this_finger: FitValuesJson


class PlausibleFingersJson(Output):
    """Fits over plausible fingers."""

    ranges: list[NamedRangeJson]
    built: int
    interpolation_text: str | None
    joint: list[FitWithFingerJson]


class ChanceJson(Output):
    """Correlation that chance alone exceeds in one of twenty cases."""

    shapes: list[Shape]
    condition: Name
    positions: int
    positions_recorded: int
    looked_at: int
    chance_r: Ratio


class MissingPositionsJson(Output):
    """Positions that one receptor does not cover."""

    receptor_mm: float
    positions_mm: list[float]


class LeftOutOfRecordingJson(Output):
    """Positions of a recording that are left out."""

    shape: Shape
    condition: Name
    recording: File
    positions: int
    left_out: list[MissingPositionsJson]
    range_needed_mm: Range
    covered_receptor_x_mm: list[float]
    command: CommandLine
    covered_by_command: int


class ShapeTestChanceJson(Output):
    """Share of random profiles that pass the shape test."""

    shape: Shape
    condition: Name
    positions: int
    smooth_over_mm: float | None
    passes_by_chance: Ratio | None
    draws: int


class PairJson(Output):
    """A measure or control at a receptor; a constant rate has none."""

    measure: Candidate
    receptor_mm: float | None


class LeftOutOfAnswerJson(Output):
    """Positions of a stimulus that are not used."""

    stimulus: Name
    position_mm: list[float]


class RecordingNoiseJson(Output):
    """Noise of a recording. dispersion: of counts and of rates with an sd relative, of rates alone (impulses/s)²."""

    kind: Literal["counts", "sd", "rates"]
    source: Literal["repeats", "sd", "neighbours"]
    dispersion: Ratio
    freedom: Ratio | None


class CeilingJson(Output):
    """Share of the variance that a model can explain."""

    share: Ratio | None
    source: Literal["repeats", "monotone"]


class SeparateFitJson(Output):
    """Maximum-likelihood pair fitted to one stimulus."""

    stimulus: Name
    unit: Unit
    k: float | None
    eps0: float | None
    left_out: Ratio | None


class TogetherJson(Output):
    """F test of separate fits against one fit of all stimuli."""

    ratio: Ratio | None
    p: Ratio | None
    separate: list[SeparateFitJson]


class MimicJson(Output):
    """Pair that imitates a control best, and the probability that it would be rejected."""

    control: PairJson
    pair: PairJson
    probability: Ratio


class PowerJson(Output):
    """Power of the fit test."""

    detectable_misfit: Ratio | None
    mimics: list[MimicJson]


class IntervalJson(Output):
    """Limits of k and ε₀ over the receptors of the set."""

    measure: Measure
    unit: Unit
    k: Limits
    eps0: Limits


class PairRowJson(Output):
    """A measure or control at a receptor, with its fit."""

    measure: Candidate
    control: bool
    unit: Unit
    receptor_mm: float | None
    k: float | None
    eps0: float | None
    saturation: Ratio | None
    r: Ratio | None
    r2: Ratio | None
    deviance: Ratio | None
    lack_of_fit: Ratio | None
    p_fit: Ratio | None
    p_set: Ratio | None
    left_out: Ratio | None
    k_interval: Limits
    eps0_interval: Limits
    fits: bool
    in_set: bool
    fires_unloaded: bool
    finger: list[NamedValueJson] | None


class AnswerJson(Output):
    """Verdict on one afferent; rows in order of descending likelihood."""

    stimuli: list[Name]
    recordings: list[File]
    positions: int
    positions_recorded: int
    left_out: list[LeftOutOfAnswerJson]
    noise: RecordingNoiseJson
    outcome: Outcome
    answer_text: str
    besides_text: list[str]
    set: list[PairJson]
    controls_in_set: list[PairJson]
    headline: PairJson | None
    next: PairJson | None
    next_is_worse_by: Ratio | None
    ceiling: CeilingJson
    together: TogetherJson | None
    power: PowerJson
    intervals: list[IntervalJson]
    rows: list[PairRowJson]
    fingers: int
    methods_text: str


class PlaceRowJson(Output):
    """A measure at its maximum-likelihood place, with 95 % intervals."""

    measure: Measure
    unit: Unit
    x_mm: float | None
    depth_mm: float | None
    offset_mm: float | None
    k: float | None
    eps0: float | None
    deviance: Ratio | None
    lack_of_fit: Ratio | None
    p_fit: Ratio | None
    x_interval_mm: Limits
    depth_interval_mm: Limits
    offset_interval_mm: Limits | None
    fits: bool
    at_bounds: list[Literal["x low", "x high", "depth low", "depth high", "offset low", "offset high"]]


class PlaceJson(Output):
    """Location of one afferent's receptor."""

    stimuli: list[Name]
    recordings: list[File]
    positions: int
    positions_recorded: int
    x_range_mm: Range
    depth_range_mm: Range
    offset_range_mm: Range | None
    frame_text: str
    rows: list[PlaceRowJson]


class PhaseCandidateJson(Output):
    """Measure, rate of a measure or control at one receptor, against one phase of the example."""

    candidate: Name
    receptor_mm: float | None
    control: bool
    r: Ratio | None
    held_out: Ratio | None
    p_fit: Ratio | None
    p_set: Ratio | None
    held_out_interval: list[Ratio | None]
    in_set: bool


class PhaseJson(Output):
    """One phase of the recorded example; candidates by the share of held-out deviance they predict."""

    phase: Literal["static", "dynamic"]
    positions: int
    positions_recorded: int
    sed_r: Ratio | None
    monotone_bound: Ratio | None
    rows: list[PhaseCandidateJson]


class ClockJson(Output):
    """Clock of the spike times; drift and the worst pulse are null without pulses."""

    source: ClockSource
    drift_ppm: Ratio | None
    worst_ms: float | None
    at_start_s: float | None
    """Time of the file at the start of the run."""
    clock_text: str


class ClockShiftJson(Output):
    """Smallest tried shift of the clock of the spike times that changes the answer; null if none does."""

    later_s: float | None
    earlier_s: float | None
    tried_s: list[float]
    shift_text: str


class RecordedRateJson(Output):
    """Rates at a recorded position: their mean, and those of the presses (repeats)."""

    position_mm: float
    rate: float
    repeats: list[float]
    unit: Name
    """1/s, or the unit that the file states, such as a.u."""


class RecordingJson(Output):
    """A recording that was read. presses, observed_text, clock: null if it is a table of rates or counts."""

    afferent: Name | None
    """Null for the recordings of one afferent."""
    shape: Shape
    recording: File
    positions: int
    columns_text: str
    """Columns that were read, and their units."""
    window_s: float | None
    """Window of the counts; null for rates."""
    rates: list[RecordedRateJson]
    presses: int | None
    not_observed_mm: list[float]
    """Positions of the presses at which the unit was not observed; they are left out."""
    observed_text: str | None
    clock: ClockJson | None


class CompareJson(Output):
    """Runs against recordings; k and ε₀ in the signs in which profiles are shown."""

    stimuli: list[StimulusJson]
    rows: list[ComparisonRowJson]
    candidates: list[Measure]
    candidates_by_condition: list[MeasuresOfGroupJson]
    collinear: list[CollinearInGroupJson]
    joint: list[JointFitJson]
    chance: list[ChanceJson]
    small_strain: SmallStrainJson
    report: File
    left_out: list[LeftOutOfRecordingJson]
    shape_test: list[ShapeTestChanceJson]
    answers: list[AnswerJson]
    recordings: NotRequired[list[RecordingJson]]
    clock_shift: NotRequired[ClockShiftJson | None]
    places: list[PlaceJson]
    fingers: NotRequired[PlausibleFingersJson]
    phases: NotRequired[list[PhaseJson]]


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
    gain_interval: Limits
    gain_factor: Ratio | None
    """Exponential of the standard deviation of the log gain between afferents."""
    threshold: float | None
    threshold_interval: Limits
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


# --- simulation ---


class LoadingPathJson(Output):
    """Dependence of the result on the loading path."""

    may_depend: bool
    spread: Ratio | None
    others_over_force: list[Ratio]


class PressureProfileJson(Output):
    """Contact pressure in the receptor plane."""

    x_mm: list[float]
    kpa: list[float]


class ReceptorsJson(Output):
    """Measures at receptors, one item each; tension is positive. unit: of each measure."""

    x_mm: list[float]
    depth_mm: list[float]
    z_mm: list[float]
    unit: dict[Measure, Unit]
    e11: list[float]
    e22: list[float]
    e33: list[float]
    e12: list[float]
    e23: list[float]
    e13: list[float]
    ep1: list[float]
    ep2: list[float]
    ep3: list[float]
    s11: list[float]
    s22: list[float]
    s33: list[float]
    sp1: list[float]
    sp2: list[float]
    sp3: list[float]
    mean: list[float]
    sed: list[float]
    third: list[float]


class SolverJson(Output):
    """Model and solution of its contact."""

    model: Name
    nodes: int
    iterations: int
    kkt_residual: Ratio
    converged: bool
    contact_s: float
    build_s: float


class ExpectedErrorsJson(Output):
    """Largest measured relative error of each requested quantity."""

    force: NotRequired[Ratio]
    width: NotRequired[Ratio]
    sed: NotRequired[Ratio]
    ep1: NotRequired[Ratio]


class ExpectedCostJson(Output):
    """Measured cost."""

    from_nothing_s: float
    press_s: float
    memory_mb: float


class ChoiceJson(Output):
    """Choice of the model; a model named on the command line has only the first three keys."""

    level: Level | None
    promised_error: Ratio | None
    why_text: str
    tolerance: NotRequired[Ratio]
    outputs: NotRequired[list[Literal["force", "contact", "receptors"]]]
    mesh: NotRequired[dict[Key, Setting]]
    """Table [finger.mesh] of the configuration."""
    patch_mm: NotRequired[Range]
    expected_error: NotRequired[ExpectedErrorsJson]
    expected_cost: NotRequired[ExpectedCostJson]


class DeflectionJson(Output):
    """Measured skin deflection beside the model's."""

    points: int
    beside_the_patch: int
    mean_mm: float | None
    rms_mm: float | None
    x_mm: list[float]
    z_mm: list[float]
    measured_mm: list[float]
    model_mm: list[float | None]


class FrictionJson(Output):
    """Friction, and the errors of contact and of Coulomb's law."""

    coefficient: Ratio
    increments: int
    sticking_share: Ratio
    """Share of the normal force that sticking points carry."""
    shear_x_n: float
    shear_z_n: float
    normal_residual: Ratio
    cone_residual: Ratio
    slip_residual: Ratio


class IndentJson(Output):
    """An indentation. A section without --length-mm has its force per mm only; a point load has no depth."""

    force_n: float | None
    force_gwt: float | None
    force_n_per_mm: NotRequired[float]
    effective_length_mm: NotRequired[float | None]
    doi_mm: float | None
    peak_pressure_kpa: float | None
    small_strain: NotRequired[SmallStrainJson]
    path: NotRequired[LoadingPathJson]
    contact_regions_mm: list[Range]
    pressure: PressureProfileJson
    receptors: ReceptorsJson
    solver: SolverJson
    choice: ChoiceJson
    friction: NotRequired[FrictionJson]
    deflection: NotRequired[DeflectionJson]
    code: NotRequired[Code]


class DesignedPressJson(Output):
    """A press of a design, in order."""

    shape: Shape
    x_mm: float
    target: Literal["doi_mm", "force_gwt"]
    value: float
    unit: Literal["mm", "gwt"]


class DesignOutcomeJson(Output):
    """Simulated experiments of a design; shares with their Monte Carlo errors.

    An experiment fails if the truth is not in the 95 % set, or more than two candidates are.
    """

    design: Literal["designed", "21 positions of one shape", "a grid of depths", "random presses", "all presses"]
    session_s: float
    presses: int
    experiments: int
    failed: Ratio
    failed_error: Ratio
    truth_in_set: Ratio
    truth_in_set_error: Ratio
    right: Ratio
    right_error: Ratio


class ConfusionJson(Output):
    """Share of experiments (row: true, column: most probable) and its Monte Carlo error."""

    true: list[Candidate]
    share: list[list[Ratio]]
    error: list[list[Ratio]]


class NotSeparatedJson(Output):
    """Pair of candidates that all presses in an hour cannot separate."""

    one: Candidate
    other: Candidate
    right: Ratio


class SampleSizeJson(Output):
    """Experiments with several fibers: share in which the set is the truth alone, or the truth and one other."""

    session_s: float
    presses: int
    repeats: Ratio
    fibers: int
    few: Ratio
    few_error: Ratio
    one: Ratio
    one_error: Ratio


class DesignJson(Output):
    """A design of presses, its script and its page."""

    script: File
    report: File
    duration_s: float
    candidates: list[Candidate]
    shapes: list[Shape]
    session_s: float
    seed: int
    quick: bool
    possible_presses: int
    refused_presses: int
    fingers: int
    presses: list[DesignedPressJson]
    information_bits: float
    effective_draws: Ratio
    """Effective number of draws behind the evidence of the true candidate; nine of ten experiments have more."""
    outcomes: list[DesignOutcomeJson]
    confusion: ConfusionJson
    not_separated: list[NotSeparatedJson]
    separated_from: Ratio
    dependence: Ratio
    carried_over: Ratio | None
    power: list[SampleSizeJson]
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


class StudyJson(Output):
    """A parameter study."""

    table: File
    cases: int
    rows: int
    problems: int
    small_strain_text: str | None
    interpolated: int
    interpolation_text: str | None
    wall_s: float


class SkinJson(Output):
    """Fitted skin."""

    source: Literal["points", "published points", "sections"]
    count: int
    residual_rms_mm: float
    residual_max_mm: float
    worst_point_mm: NotRequired[list[float]]


class ApexJson(Output):
    """Highest point of the skin."""

    position_mm: list[float]
    lateral_radius_mm: float
    axial_radius_mm: float | None


class LayerJson(Output):
    """A layer under the apex; E over that of the epidermis."""

    name: Annotated[str, Field(json_schema_extra={"enum": list(LAYERS)})]
    thickness_mm: float
    elements: int
    e_ratio: Ratio


class MeshQualityJson(Output):
    """Quality of the mesh and where it is worst."""

    folded: int
    poor: int
    smallest_scaled_jacobian: Ratio
    smallest_scaled_jacobian_at_mm: list[float]
    largest_aspect_ratio: Ratio
    largest_aspect_ratio_at_mm: list[float]


class FingerJson(Output):
    """Finger of a configuration."""

    skin: SkinJson
    apex: ApexJson
    layers: list[LayerJson]
    nodes: int
    elements: int
    patch_nodes: int
    receptor_plane_mm: float
    quality: MeshQualityJson


class ServedPortsJson(Output):
    """Ports of the virtual devices."""

    stage: NotRequired[Port]
    force: NotRequired[Port]
    x_port: NotRequired[Port]
    """Second port of a stage with a controller for each axis."""
    http_port: NotRequired[int]
    """TCP port of the web page of a Net F/T."""


class TrueParameterJson(Output):
    """A parameter of a random finger, beside its 90 % band in a finger file."""

    name: Parameter
    unit: Unit
    truth: float
    low: NotRequired[float]
    high: NotRequired[float]
    inside: NotRequired[bool]


class RandomFingerJson(Output):
    """Parameters of a random finger."""

    parameters: list[TrueParameterJson]


# --- coding ---


class SkinPressureJson(Output):
    """Pressure at places along the skin."""

    place_mm: list[float]
    pseudo: list[float]


class AgainstFiniteElementsJson(Output):
    """Difference of the operator's SED from that of finite elements."""

    relative_l2: Ratio
    peak: Ratio
    lateral_share: Ratio


ReadingUnit = Literal["pseudo-unit", "impulses/s"]


class EncodeJson(Output):
    """Receptor readings. Without a receptor, `rate` is the noisy SED."""

    operator: OperatorName
    energy: Energy
    pressure: SkinPressureJson
    receptor_mm: list[float]
    sed_pseudo: list[float]
    rate: list[float]
    rate_unit: ReadingUnit
    samples: int
    noise_sd: float
    noise_sd_unit: ReadingUnit
    noise_share_of_peak: Ratio
    against_finite_elements: AgainstFiniteElementsJson | None
    small_strain: SmallStrainJson | None


class DecodingErrorsJson(Output):
    """Errors against the true pressures."""

    eq_6_8: Ratio
    relative_l2: Ratio
    rmse_over_peak: Ratio


class ReadingNoiseJson(Output):
    """Noise of the readings, and the SED that the pressures leave unexplained."""

    sd: list[float] | None
    unit: ReadingUnit
    known_text: str | None
    left_of_sed_pseudo: float


class PressureBandJson(Output):
    """90 % band of the pressures."""

    low_pseudo: list[float]
    high_pseudo: list[float]


class ShapeEstimateJson(Output):
    """Estimated shape of the indentor. size_mm: diameter, half a wavelength of a step, or width of a bar."""

    shape_class: SolidClass
    size_mm: float
    extent_mm: Range


class DecodeJson(Output):
    """Pressures from readings."""

    decoder: DecoderName
    operator: OperatorName
    energy: Energy
    place_mm: Places
    pressure_pseudo: list[float]
    pa_per_pseudo: float
    sd_pseudo: list[float] | None
    band_90: PressureBandJson | None
    true_pseudo: list[float] | None
    errors: DecodingErrorsJson | None
    receptor_mm: Places
    reading: list[float]
    reading_unit: ReadingUnit
    explained_sed_pseudo: list[float]
    samples: int
    noise: ReadingNoiseJson
    range_pseudo: Range | None
    moves: int
    converged: bool
    problems_text: list[str]
    felt: ShapeEstimateJson | None
    axial: Shape | None
    search_ms: float


class SpectraJson(Output):
    """Amplitudes of h, g and f."""

    cycles_per_mm: list[float]
    unit: Literal["1/pseudo-unit"]
    h: list[float]
    g: list[float]
    f: list[float]


class OppositeJson(Output):
    """Difference between −g and h."""

    relative_l2: Ratio
    largest: Ratio
    correlation: Ratio


class TailsJson(Output):
    """Amplitude at the ends over the peak."""

    h: Ratio
    g: Ratio
    f: Ratio


class ShiftErrorsJson(Output):
    """Relative L2 error of shifting the responses."""

    place_mm: list[float]
    e11: list[Ratio]
    e22: list[Ratio]
    e12: list[Ratio]
    sed: list[Ratio]


class ImpulseResponsesJson(Output):
    """Strains under one pseudo-unit on one sample."""

    place_mm: list[float]
    unit: Literal["1/pseudo-unit"]
    h: list[float]
    g: list[float]
    f: list[float]
    spectra: SpectraJson
    g_is_minus_h: OppositeJson
    tails_over_peak: TailsJson
    shift_errors_relative_l2: ShiftErrorsJson


class ImpulseJson(Output):
    """Impulse responses in the skin's axes and in Cartesian ones."""

    energy: Energy
    skin: ImpulseResponsesJson
    cartesian: ImpulseResponsesJson


class SampledSitesJson(Output):
    """Loads and receptor locations."""

    spacing_mm: float
    half_width_mm: float
    depth_mm: float
    force_gwt: float


class PowerLawJson(Output):
    """SED = A / r^m, r in mm. `a_pseudo`: SED at 1 mm."""

    a_pseudo: float
    m: Ratio
    r: Ratio
    r2: Ratio


class PrintedLawJson(Output):
    """Power law printed in the source, which does not state the unit of A."""

    a: Ratio
    m: Ratio
    r2: Ratio


class SiteJson(Output):
    """A site under a point load."""

    number: int
    x_mm: float
    z_mm: float
    on_pulp: bool
    receptors: int
    linear: PowerLawJson
    logarithmic: PowerLawJson
    by_azimuth: list[Ratio | None]
    moved_response_relative_l2: Ratio
    printed: PrintedLawJson


class MeanLawJson(Output):
    """Means over sites, and standard deviations over the means."""

    a_pseudo: float
    a_spread: Ratio
    m: Ratio
    m_spread: Ratio


class MeanPrintedLawJson(Output):
    """Means of the printed laws."""

    a: Ratio
    a_spread: Ratio
    m: Ratio
    m_spread: Ratio


class MeanLawsJson(Output):
    """Laws over the sites."""

    linear: MeanLawJson
    logarithmic: MeanLawJson
    printed: MeanPrintedLawJson


class ShiftInvarianceJson(Output):
    """Decay of SED around point loads. common_factor: from `a_pseudo` to the printed A."""

    sampled: SampledSitesJson
    common_factor: Ratio
    sites: list[SiteJson]
    pulp: MeanLawsJson
    all: MeanLawsJson


# --- bench ---


class HomedJson(ContactJson):
    """Position after homing, in machine coordinates, and contact."""

    state: Name
    x_mm: float
    y_mm: float
    z_mm: float


class ZeroedJson(Output):
    """Force sensor after zeroing."""

    identity: Name
    force_n: float


class StatusJson(Output):
    """Both devices, and contact: measured now where both can be relied on, else as recorded."""

    stage: StageLookJson
    force: ForceLookJson
    contact: ContactJson


class StoppedJson(Output):
    """A stop that was sent. state: as the controller names it; null where it has not answered."""

    stopped: list[Port]
    owner: int | None
    sent: bool
    state: Name | None


class NotStoppedJson(Output):
    """A stop that was not sent, or not confirmed."""

    error_text: str
    code: Code
    exit_code: Literal[1, 2]
    owner: NotRequired[int | None]
    sent: bool
    state: NotRequired[Name | None]


class JoggedJson(HomedJson):
    """Position after a manual move."""

    ended_by_text: str | None
    """Cause of the stop."""
    code: NotRequired[Code]


class CalibrationJson(Output):
    """A calibration; `toml` is for the configuration."""

    name: Literal["x_steps_per_mm", "y_steps_per_mm", "z_steps_per_mm", "force_scale", "compliance_mm_per_n"]
    value: float
    sd: float | None
    unit: Literal["steps/mm", "1", "mm/N"]
    toml: Toml


# --- system ---


class BenchmarkRowJson(Output):
    """Error and cost of a model. build_s: of the model and its first answer."""

    model: ModelName
    element: Literal["analytic", "bbar", "full", "incompatible", "quadratic"]
    refinement: Name
    nodes: int
    scene: Name
    family: Annotated[str, Field(json_schema_extra={"enum": list(FAMILIES)})]
    quantity: Quantity
    error: Ratio
    total_s: float
    contact_s: float
    memory_mb: float


class BenchmarkJson(Output):
    """All models on this machine."""

    rows: list[BenchmarkRowJson]
    page: File
    reference_s: float


class CacheEntryJson(Output):
    """A cached result."""

    name: Name
    kind: Annotated[str, Field(json_schema_extra={"enum": list(KINDS)})]
    bytes: int
    read_utc: Time


class CacheJson(Output):
    """Cached results."""

    folder: File
    entries: list[CacheEntryJson]
    bytes: int
    limit_gb: float
    removed: int
    removed_bytes: int


class ConfigKeyJson(Output):
    """A key of the configuration; value and default are null where it is not set."""

    key: Name
    value: Setting
    default: Setting
    unit: Unit
    allowed_text: str
    what_text: str


class ConfigurationJson(Output):
    """Keys of the configuration."""

    keys: list[ConfigKeyJson]


class SerialPortJson(Output):
    """A serial port of this machine."""

    port: Port
    description_text: str


class ConfiguredJson(Output):
    """A configured device."""

    kind: Name
    ports: list[Port]


class ConfiguredDevicesJson(Output):
    """Configured devices."""

    stage: ConfiguredJson
    force: ConfiguredJson


class DeviceKindJson(Output):
    """A kind of device. package: where it comes from; null if built in."""

    kind: Name
    role: Literal["stage", "force"]
    package: Name | None


class SpreadJson(Output):
    """Median, 99th percentile and worst of several times."""

    median_s: float
    p99_s: float
    worst_s: float


class MeasuredJson(Output):
    """Measurements of one kind of device on one wire of its virtual twin."""

    wire: Name
    samples: int
    rate_hz: float
    age: SpreadJson
    """Age of a reading when the program decides about a trip, or largest age of a position."""
    stops: int
    to_bytes: SpreadJson | None
    """Time from the call of a stop to its bytes; null for a force sensor."""
    to_rest: SpreadJson | None


class CataloguedDeviceJson(DeviceKindJson):
    """Kind of device and the evidence of its tests; a text without evidence is null."""

    device_text: str
    manual_text: str | None
    client_text: str | None
    firmware_text: str | None
    hardware_text: str | None
    measured: list[MeasuredJson]


class DeviceCatalogueJson(Output):
    """Every kind of device, with --devices."""

    devices: list[CataloguedDeviceJson]


class CalibrationOnRecordJson(Output):
    """A calibration of the configuration."""

    name: Name
    value: float
    unit: Unit
    expires: Day
    expired: bool


class CacheSizeJson(Output):
    """Size of the cache."""

    folder: File
    models: int
    answers: int
    bytes: int


class DoctorJson(Output):
    """Installation; with --config also the devices that answer on the ports."""

    python: Name
    system: Name
    machine: Name
    cores: int
    versions: list[PackageJson]
    ports: list[SerialPortJson]
    configured: ConfiguredDevicesJson
    devices: list[DeviceKindJson]
    limits: dict[Key, Setting]
    """Table [limits] of the configuration."""
    cache: CacheSizeJson
    protocols: list[Name]
    problems_text: NotRequired[list[str]]
    stage: NotRequired[StageLookJson]
    force: NotRequired[ForceLookJson]
    calibrated: NotRequired[list[CalibrationOnRecordJson]]
    contact: NotRequired[ContactJson]
    last_run_text: NotRequired[str]


class BugReportJson(Output):
    """A file for a bug report."""

    bundle: File
    holds: list[FileSizeJson]
    left_out_text: list[str]


class PortFoundJson(Output):
    """Reply on a port; role, kind and identity are null if no known device answered."""

    port: Port
    role: Literal["stage", "force"] | None
    kind: Name | None
    identity: Name | None
    owner: int | None
    """Process that uses the port, which was then not searched; null also if the system does not report it."""
    code: Code | None
    """Reason that the port was not searched, or that the device cannot be used."""
    found_text: str


class DeviceWrittenJson(Output):
    """A device in the new configuration; identity is null if it did not answer."""

    kind: Name
    port: Port
    identity: Name | None


class InitJson(Output):
    """A new configuration file."""

    config: File
    ports: list[PortFoundJson]
    stage: DeviceWrittenJson
    force: DeviceWrittenJson
    next: CommandLine
    """Command to enter next."""


OUTPUTS: Mapping[str, tuple[Any, ...]] = {
    "dry-run": (FinishedRunJson,),
    "run": (FinishedRunJson,),
    "identify": (IdentificationJson,),
    "check": (CheckJson,),
    "design": (DesignJson, SessionJson),
    "resume": (FinishedRunJson,),
    "nerve": (NerveJson,),
    "compare": (CompareJson, GroupJson),
    "runs": (RunsJson,),
    "show": (ShowJson, ColumnsJson),
    "watch": (WatchJson,),
    "panel": (PanelJson,),
    "export": (ExportJson,),
    "study": (StudyJson,),
    "indent": (IndentJson,),
    "impulse": (ImpulseJson,),
    "shift-invariance": (ShiftInvarianceJson,),
    "encode": (EncodeJson,),
    "decode": (DecodeJson,),
    "finger": (FingerJson,),
    "find": (FindJson,),
    "serve": (ServedPortsJson, RandomFingerJson),
    "init": (InitJson,),
    "home": (HomedJson,),
    "zero": (ZeroedJson,),
    "status": (StatusJson,),
    "stop": (StoppedJson, NotStoppedJson),
    "jog": (JoggedJson,),
    "calibrate": (CalibrationJson,),
    "bench": (BenchmarkJson,),
    "cache": (CacheJson,),
    "config": (ConfigurationJson, DeviceCatalogueJson),
    "doctor": (DoctorJson, BugReportJson),
}
"""Output of each command with --json that succeeds; any command may print a Failure instead."""


@cache
def schema_of(command: str) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of all that a command prints with `--json`."""
    kinds: Any = Union[(*OUTPUTS[command], FailureJson)]
    found = TypeAdapter(kinds).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"rig {command} --json"} | _plain(
        found
    )


def _plain(schema: Any) -> Any:
    """Return a schema without titles that only repeat keys, and with maps limited to the keys of their pattern."""
    if isinstance(schema, list):
        return [_plain(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    closed = {"additionalProperties": False} if "patternProperties" in schema else {}
    return closed | {key: _plain(one) for key, one in schema.items() if key != "title" or not isinstance(one, str)}
