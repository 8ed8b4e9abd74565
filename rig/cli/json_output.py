"""What each command prints with `--json`: a schema for each, the reference page and the tests are made from it.

Numbers are numbers. A quantity has its unit at the end of its key (`force_gwt`), or beside it in `unit`. Prose is in
keys that end in `_text`. Identifiers come from closed lists, or have a format that says whose names they are.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, NotRequired, Union

from pydantic import ConfigDict, Field, TypeAdapter
from typing_extensions import TypedDict

from rig.compare.stimuli import CONTROLS
from rig.compare.verdict import A_CONSTANT, Outcome
from rig.data.tables import STATES
from rig.engine.contact import ContactKind
from rig.plan.config import UNITS
from rig.records import Phase
from rig.session.early_ending import Left
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
    "mb": "MB",
    "bytes": "bytes",
}
"""Units by the end of a key."""

DIMENSIONLESS = "1"
UNIT_FIELDS = (
    "", DIMENSIONLESS, *dict.fromkeys(SUFFIXES.values()),
    "pseudo-unit³", "1/pseudo-unit", "impulses/s",
)  # fmt: skip
"""Values of `unit`; empty where a value has none."""

FORMATS = ("name", "shape", "path", "port", "uri", "date-time", "date", "command-line", "toml", "setting", "code")
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
State = Annotated[str, Field(json_schema_extra={"enum": list(STATES)})]
Parameter = Annotated[str, Field(json_schema_extra={"enum": [named(one.name) for one in PARAMETERS]})]
Quantity = Annotated[str, Field(json_schema_extra={"enum": list(QUANTITIES)})]
Level = Annotated[str, Field(json_schema_extra={"enum": list(LEVELS)})]
Key = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")]
SettingText = Annotated[str, Field(json_schema_extra={"format": "setting"})]
Value = float | bool | SettingText | None
Setting = Value | list[Value] | dict[str, Value | list[Value]] | list[dict[str, Value | list[Value]]]
Range = tuple[float, float]
Ends = tuple[Ratio, Ratio]
Limits = tuple[float | None, float | None]


# --- what several commands print ---


class IndentorAtEnd(Output):
    """Final position of the indentor."""

    left: Left
    x_mm: float | None
    height_mm: float | None
    trusted: bool
    may_touch: bool | None
    contact: ContactKind | None
    force_gwt: float | None


class Ending(Output):
    """Why a run ended early. A run whose journal has an end has no more than `reason_text` and `where_text`."""

    reason_text: str
    where_text: str | None
    indentor: NotRequired[IndentorAtEnd]
    next_text: NotRequired[str]
    resume: NotRequired[CommandLine | None]
    """Command that continues the run; null if it never began."""


class Failure(Output):
    """A command that failed."""

    error_text: str
    """The line on standard error. It may change; match `code`."""
    code: Code
    exit_code: Literal[1, 2, 130]
    ending: NotRequired[Ending]


class SmallStrain(Output):
    """Deviation of a linear answer from finite strain: least and most; null where nothing was compared."""

    note_text: str
    force: Ends | None
    sed: Ends | None


class Contact(Output):
    """State of contact between indentor and finger; null where nothing is on record."""

    contact: ContactKind | None
    may_touch: bool | None
    force_gwt: float | None
    where_text: str
    to_do_text: str | None


class DeviceLook(Output):
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


class StageLook(DeviceLook):
    """The stage; position in machine coordinates."""

    state: NotRequired[Name]
    x_mm: NotRequired[float]
    y_mm: NotRequired[float]
    z_mm: NotRequired[float]


class ForceLook(DeviceLook):
    """The force sensor."""

    force_n: NotRequired[float]
    stable: NotRequired[bool]


class FileSize(Output):
    """A file."""

    name: Name
    bytes: int


class Package(Output):
    """A package and its version."""

    package: Name
    version: Name


# --- experiment ---


class FinishedRun(Output):
    """A run that was carried out or resumed."""

    run: File
    complete: bool
    indentations: int
    duration_s: float
    wall_s: float
    report: File | None
    missing: NotRequired[int]
    repeated: NotRequired[int]
    restarted: NotRequired[int]
    code: NotRequired[Code]
    ending: NotRequired[Ending]


class Margins(Output):
    """What remains up to the limits."""

    force_gwt: float
    doi_mm: float
    mean_pressure_n_cm2: float
    contact_s: float


class PlannedStep(Output):
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
    mean_pressure_n_cm2: float
    peak_pressure_n_cm2: float
    overshoot_gwt: float


class Check(Output):
    """A protocol against the limits."""

    protocol: Name
    indentations: int
    other_presses: int
    duration_s: float
    contact_s: float
    peak_force_n: float
    peak_force_gwt: float
    small_strain: SmallStrain
    peak_pressure_n_cm2: float
    soft_trip_n: float
    hard_trip_n: float
    margins: Margins
    stop_distance_mm: float
    overshoot_gwt: float
    steps: list[PlannedStep]


class IdentifiedParameter(Output):
    """A parameter of the finger: mean, standard deviation and 90 % band; stiffness and moduli over the default's."""

    name: Parameter
    unit: Unit
    mean: float
    sd: float
    low: float
    high: float


class PredictedForce(Output):
    """Force of a press on the identified finger with its 90 % band, in gwt."""

    shape: Shape
    x_mm: float
    doi_mm: float
    force_gwt: float
    low: float
    high: float
    unit: Literal["gwt"]


class Identification(Output):
    """An identified finger. `consistent`: the presses agree with a finger of the prior, and the bands hold."""

    run: File
    finger: File | None
    presses: int
    bench_s: float
    consistent: bool
    parameters: list[IdentifiedParameter]
    predicted: list[PredictedForce]
    problems_text: list[str]
    code: NotRequired[Code]
    ending: NotRequired[Ending]


class Watch(Output):
    """The state of a run now."""

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
    ending: Ending | None


class Panel(Output):
    """Where the panel is."""

    url: Uri
    port: int
    pid: int


class FingerFrame(Output):
    """Where the finger lies."""

    pad_centre_x_mm: float
    apex_z_mm: float
    roll_deg: NotRequired[float]
    tilt_deg: NotRequired[float]


class Find(Output):
    """Position of the finger, fitted to touches; `toml` is for the configuration."""

    value: FingerFrame
    sd: FingerFrame
    correlation: list[list[Ratio]]
    residual_mm: float
    touches: int
    toml: Toml


# --- results ---


class RunSummary(Output):
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


class Unreadable(Output):
    """A folder that cannot be read."""

    name: Name
    problem_text: str


class Runs(Output):
    """All runs of a folder."""

    runs: list[RunSummary]
    unreadable: list[Unreadable]
    table: NotRequired[File]
    holds: NotRequired[int]


class Presses(Output):
    """Holds with one indentor to one target."""

    indentor: Shape
    target_doi_mm: float | None
    target_force_gwt: float | None
    holds: int
    from_x_mm: float
    to_x_mm: float
    mean_force_gwt: float
    mean_doi_mm: float
    peak_gwt: float


class RunDevices(Output):
    """Devices of a run, and the identities that they reported."""

    stage: NotRequired[Name]
    force: NotRequired[Name]
    controller: NotRequired[Name]
    sensor: NotRequired[Name]


class RunModel(Output):
    """The finger model of a run."""

    nodes: NotRequired[int]
    e_epidermis_mpa: NotRequired[float]
    from_cache: NotRequired[bool]


class Show(Output):
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
    ending: Ending | None
    presses: list[Presses]
    limits: dict[Key, Setting]
    """Table [limits] of the configuration, and the soft trip of the plan."""
    devices: RunDevices
    versions: list[Package]
    model: RunModel | None
    files: list[FileSize]


class Column(Output):
    """A column of a run's tables."""

    table: Name
    name: Name
    unit: Unit
    dtype: Literal["bool", "text (UTF-8)", "float64"]
    what_text: str


class Columns(Output):
    """Columns of all tables."""

    columns: list[Column]


class Export(Output):
    """Files that were written."""

    run: File
    files: list[File]


class Stimulus(Output):
    """A stimulus, and the number that was commanded."""

    stimulus: Name
    shape: Shape
    condition: Name
    target: Literal["doi_mm", "force_gwt"]
    value: float
    unit: Literal["mm", "gwt"]
    run: File


class ComparisonRow(Output):
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


class MeasuresOfGroup(Output):
    """Measures that pass the shape test under a group of stimuli."""

    group: Name
    measures: list[Measure]


class CollinearInGroup(Output):
    """Sets of measures that no recording of a group tells apart."""

    group: Name
    sets: list[list[Measure]]


class JointFit(Output):
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


class FitValues(Output):
    """The same fit on the run's own finger."""

    unit: Unit
    k: float | None
    k_interval: Limits | None
    eps0: float | None
    eps0_interval: Limits | None
    r2: Ratio | None


class NamedValue(Output):
    """A parameter of a finger, by its place in the configuration."""

    name: Name
    value: float
    unit: Unit


class NamedRange(Output):
    """The range of a parameter of a finger."""

    name: Name
    low: float
    high: float
    unit: Unit


class FitWithFinger(Output):
    """A measure with its best plausible finger."""

    shapes: list[Shape]
    condition: Name
    measure: Measure
    unit: Unit
    receptor_mm: float
    r2: Ratio | None
    best_finger: list[NamedValue]
    k: float | None
    k_interval: Limits | None
    eps0: float | None
    eps0_interval: Limits | None
    on_this_finger: FitValues


class PlausibleFingers(Output):
    """Fits over plausible fingers."""

    ranges: list[NamedRange]
    built: int
    interpolation_text: str | None
    joint: list[FitWithFinger]


class Chance(Output):
    """Correlation that chance alone exceeds in one of twenty cases."""

    shapes: list[Shape]
    condition: Name
    positions: int
    positions_recorded: int
    looked_at: int
    chance_r: Ratio


class MissingPositions(Output):
    """Positions that one receptor does not cover."""

    receptor_mm: float
    positions_mm: list[float]


class LeftOutOfRecording(Output):
    """What is left out of a recording."""

    shape: Shape
    condition: Name
    recording: File
    positions: int
    left_out: list[MissingPositions]
    range_needed_mm: Range


class ShapeTestChance(Output):
    """Share of random profiles that pass the shape test."""

    shape: Shape
    condition: Name
    positions: int
    smooth_over_mm: float | None
    passes_by_chance: Ratio | None
    draws: int


class Pair(Output):
    """A measure or control at a receptor; a constant rate has none."""

    measure: Candidate
    receptor_mm: float | None


class LeftOutOfAnswer(Output):
    """Positions of a stimulus that are not used."""

    stimulus: Name
    position_mm: list[float]


class RecordingNoise(Output):
    """Noise of a recording. dispersion: of counts and of rates with an sd relative, of rates alone (impulses/s)²."""

    kind: Literal["counts", "sd", "rates"]
    source: Literal["repeats", "sd", "neighbours"]
    dispersion: Ratio
    freedom: Ratio | None


class Ceiling(Output):
    """Share of the variance that a model can explain."""

    share: Ratio | None
    source: Literal["repeats", "monotone"]


class SeparateFit(Output):
    """The maximum-likelihood pair fitted to one stimulus."""

    stimulus: Name
    unit: Unit
    k: float | None
    eps0: float | None
    left_out: Ratio | None


class Together(Output):
    """F test of separate fits against one fit of all stimuli."""

    ratio: Ratio | None
    p: Ratio | None
    separate: list[SeparateFit]


class Mimic(Output):
    """Pair that imitates a control best, and the probability that it would be rejected."""

    control: Pair
    pair: Pair
    probability: Ratio


class Power(Output):
    """Power of the fit test."""

    detectable_misfit: Ratio | None
    mimics: list[Mimic]


class Interval(Output):
    """Limits of k and ε₀ over the receptors of the set."""

    measure: Measure
    unit: Unit
    k: Limits
    eps0: Limits


class PairRow(Output):
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
    finger: list[NamedValue] | None


class Answer(Output):
    """The verdict on one afferent; rows are likeliest first."""

    stimuli: list[Name]
    recordings: list[File]
    positions: int
    positions_recorded: int
    left_out: list[LeftOutOfAnswer]
    noise: RecordingNoise
    outcome: Outcome
    answer_text: str
    besides_text: list[str]
    set: list[Pair]
    controls_in_set: list[Pair]
    headline: Pair | None
    next: Pair | None
    next_is_worse_by: Ratio | None
    ceiling: Ceiling
    together: Together | None
    power: Power
    intervals: list[Interval]
    rows: list[PairRow]
    fingers: int
    methods_text: str


class PlaceRow(Output):
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


class Place(Output):
    """Location of one afferent's receptor."""

    stimuli: list[Name]
    recordings: list[File]
    positions: int
    positions_recorded: int
    x_range_mm: Range
    depth_range_mm: Range
    offset_range_mm: Range | None
    frame_text: str
    rows: list[PlaceRow]


class Compare(Output):
    """Runs against recordings; k and ε₀ in the signs in which profiles are shown."""

    stimuli: list[Stimulus]
    rows: list[ComparisonRow]
    candidates: list[Measure]
    candidates_by_condition: list[MeasuresOfGroup]
    collinear: list[CollinearInGroup]
    joint: list[JointFit]
    chance: list[Chance]
    small_strain: SmallStrain
    report: File
    left_out: list[LeftOutOfRecording]
    shape_test: list[ShapeTestChance]
    answers: list[Answer]
    places: list[Place]
    fingers: NotRequired[PlausibleFingers]


# --- simulation ---


class LoadingPath(Output):
    """Whether the result depends on the loading path."""

    may_depend: bool
    spread: Ratio | None
    others_over_force: list[Ratio]


class PressureProfile(Output):
    """Contact pressure in the receptor plane."""

    x_mm: list[float]
    pseudo: list[float]


class Receptors(Output):
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


class Solver(Output):
    """The model and how its contact was solved."""

    model: Name
    nodes: int
    iterations: int
    kkt_residual: Ratio
    converged: bool
    contact_s: float
    build_s: float


class ExpectedErrors(Output):
    """Largest measured relative error of each quantity that was asked for."""

    force: NotRequired[Ratio]
    width: NotRequired[Ratio]
    sed: NotRequired[Ratio]
    ep1: NotRequired[Ratio]


class ExpectedCost(Output):
    """Measured cost."""

    from_nothing_s: float
    press_s: float
    memory_mb: float


class Choice(Output):
    """How the model was chosen; a model that was named has no more than the first three keys."""

    level: Level | None
    promised_error: Ratio | None
    why_text: str
    tolerance: NotRequired[Ratio]
    outputs: NotRequired[list[Literal["force", "contact", "receptors"]]]
    mesh: NotRequired[dict[Key, Setting]]
    """Table [finger.mesh] of the configuration."""
    patch_mm: NotRequired[Range]
    expected_error: NotRequired[ExpectedErrors]
    expected_cost: NotRequired[ExpectedCost]


class Deflection(Output):
    """Measured skin deflection beside the model's."""

    points: int
    beside_the_patch: int
    mean_mm: float | None
    rms_mm: float | None
    x_mm: list[float]
    z_mm: list[float]
    measured_mm: list[float]
    model_mm: list[float | None]


class Indent(Output):
    """An indentation. A section without --length-mm has its force per mm only; a point load has no depth."""

    force_n: float | None
    force_gwt: float | None
    force_n_per_mm: NotRequired[float]
    effective_length_mm: NotRequired[float | None]
    doi_mm: float | None
    peak_pressure_pseudo: float | None
    small_strain: NotRequired[SmallStrain]
    path: NotRequired[LoadingPath]
    contact_regions_mm: list[Range]
    pressure: PressureProfile
    receptors: Receptors
    solver: Solver
    choice: Choice
    deflection: NotRequired[Deflection]
    code: NotRequired[Code]


class Study(Output):
    """A parameter study."""

    table: File
    cases: int
    rows: int
    problems: int
    small_strain_text: str | None
    interpolated: int
    interpolation_text: str | None
    wall_s: float


class Skin(Output):
    """The skin that was fitted."""

    source: Literal["points", "published points", "sections"]
    count: int
    residual_rms_mm: float
    residual_max_mm: float
    worst_point_mm: NotRequired[list[float]]


class Apex(Output):
    """The highest point of the skin."""

    position_mm: list[float]
    lateral_radius_mm: float
    axial_radius_mm: float | None


class Layer(Output):
    """A layer under the apex; E over that of the epidermis."""

    name: Annotated[str, Field(json_schema_extra={"enum": list(LAYERS)})]
    thickness_mm: float
    elements: int
    e_ratio: Ratio


class MeshQuality(Output):
    """Quality of the mesh and where it is worst."""

    folded: int
    poor: int
    smallest_scaled_jacobian: Ratio
    smallest_scaled_jacobian_at_mm: list[float]
    largest_aspect_ratio: Ratio
    largest_aspect_ratio_at_mm: list[float]


class Finger(Output):
    """The finger of a configuration."""

    skin: Skin
    apex: Apex
    layers: list[Layer]
    nodes: int
    elements: int
    patch_nodes: int
    receptor_plane_mm: float
    quality: MeshQuality


class ServedPorts(Output):
    """Ports of the virtual devices."""

    stage: NotRequired[Port]
    force: NotRequired[Port]


class TrueParameter(Output):
    """A parameter of a random finger, beside its 90 % band in a finger file."""

    name: Parameter
    unit: Unit
    truth: float
    low: NotRequired[float]
    high: NotRequired[float]
    inside: NotRequired[bool]


class RandomFinger(Output):
    """Parameters of a random finger."""

    parameters: list[TrueParameter]


# --- coding ---


class SkinPressure(Output):
    """Pressure at places along the skin."""

    place_mm: list[float]
    pseudo: list[float]


class AgainstFiniteElements(Output):
    """Difference of the operator's SED from that of finite elements."""

    relative_l2: Ratio
    peak: Ratio
    lateral_share: Ratio


ReadingUnit = Literal["pseudo-unit", "impulses/s"]


class Encode(Output):
    """Receptor readings. Without a receptor, `rate` is the noisy SED."""

    operator: OperatorName
    energy: Energy
    pressure: SkinPressure
    receptor_mm: list[float]
    sed_pseudo: list[float]
    rate: list[float]
    rate_unit: ReadingUnit
    samples: int
    noise_sd: float
    noise_sd_unit: ReadingUnit
    noise_share_of_peak: Ratio
    against_finite_elements: AgainstFiniteElements | None
    small_strain: SmallStrain | None


class DecodingErrors(Output):
    """Errors against the true pressures."""

    eq_6_8: Ratio
    relative_l2: Ratio
    rmse_over_peak: Ratio


class ReadingNoise(Output):
    """Noise of the readings, and the SED that the pressures leave unexplained."""

    sd: list[float] | None
    unit: ReadingUnit
    known_text: str | None
    left_of_sed_pseudo: float


class PressureBand(Output):
    """90 % band of the pressures."""

    low_pseudo: list[float]
    high_pseudo: list[float]


class FeltShape(Output):
    """What touches the skin. size_mm: diameter, half a wavelength of a step, or width of a bar."""

    shape_class: SolidClass
    size_mm: float
    extent_mm: Range


class Decode(Output):
    """Pressures from readings."""

    decoder: DecoderName
    operator: OperatorName
    energy: Energy
    place_mm: list[float]
    pressure_pseudo: list[float]
    pa_per_pseudo: float
    sd_pseudo: list[float] | None
    band_90: PressureBand | None
    true_pseudo: list[float] | None
    errors: DecodingErrors | None
    receptor_mm: list[float]
    reading: list[float]
    reading_unit: ReadingUnit
    explained_sed_pseudo: list[float]
    samples: int
    noise: ReadingNoise
    range_pseudo: Range | None
    moves: int
    converged: bool
    problems_text: list[str]
    felt: FeltShape | None
    axial: Shape | None
    search_ms: float


class Spectra(Output):
    """Amplitudes of h, g and f."""

    cycles_per_mm: list[float]
    unit: Literal["1/pseudo-unit"]
    h: list[float]
    g: list[float]
    f: list[float]


class Opposite(Output):
    """How nearly g is −h."""

    relative_l2: Ratio
    largest: Ratio
    correlation: Ratio


class Tails(Output):
    """Amplitude at the ends over the peak."""

    h: Ratio
    g: Ratio
    f: Ratio


class ShiftErrors(Output):
    """Relative L2 error of shifting the responses."""

    place_mm: list[float]
    e11: list[Ratio]
    e22: list[Ratio]
    e12: list[Ratio]
    sed: list[Ratio]


class ImpulseResponses(Output):
    """Strains under one pseudo-unit on one sample."""

    place_mm: list[float]
    unit: Literal["1/pseudo-unit"]
    h: list[float]
    g: list[float]
    f: list[float]
    spectra: Spectra
    g_is_minus_h: Opposite
    tails_over_peak: Tails
    shift_errors_relative_l2: ShiftErrors


class Impulse(Output):
    """Impulse responses in the skin's axes and in Cartesian ones."""

    energy: Energy
    skin: ImpulseResponses
    cartesian: ImpulseResponses


class SampledSites(Output):
    """The loads, and where receptors lie."""

    spacing_mm: float
    half_width_mm: float
    depth_mm: float
    force_gwt: float


class PowerLaw(Output):
    """SED = A / r^m, r in mm. `a_pseudo`: SED at 1 mm."""

    a_pseudo: float
    m: Ratio
    r: Ratio
    r2: Ratio


class PrintedLaw(Output):
    """The law that the source prints; the unit of its A is not printed."""

    a: Ratio
    m: Ratio
    r2: Ratio


class Site(Output):
    """A site under a point load."""

    number: int
    x_mm: float
    z_mm: float
    on_pulp: bool
    receptors: int
    linear: PowerLaw
    logarithmic: PowerLaw
    by_azimuth: list[Ratio | None]
    moved_response_relative_l2: Ratio
    printed: PrintedLaw


class MeanLaw(Output):
    """Means over sites, and standard deviations over the means."""

    a_pseudo: float
    a_spread: Ratio
    m: Ratio
    m_spread: Ratio


class MeanPrintedLaw(Output):
    """Means of the printed laws."""

    a: Ratio
    a_spread: Ratio
    m: Ratio
    m_spread: Ratio


class MeanLaws(Output):
    """Laws over the sites."""

    linear: MeanLaw
    logarithmic: MeanLaw
    printed: MeanPrintedLaw


class ShiftInvariance(Output):
    """Decay of SED around point loads. common_factor: from `a_pseudo` to the printed A."""

    sampled: SampledSites
    common_factor: Ratio
    sites: list[Site]
    pulp: MeanLaws
    all: MeanLaws


# --- bench ---


class Homed(Contact):
    """Position after homing, in machine coordinates, and contact."""

    state: Name
    x_mm: float
    y_mm: float
    z_mm: float


class Zeroed(Output):
    """The force sensor after zeroing."""

    identity: Name
    force_n: float


class Status(Output):
    """Both devices, and contact on record."""

    stage: StageLook
    force: ForceLook
    contact: Contact


class Stopped(Output):
    """A stop that was sent. state: as the controller names it; null where it has not answered."""

    stopped: list[Port]
    owner: int | None
    sent: bool
    state: Name | None


class NotStopped(Output):
    """A stop that was not sent, or not confirmed."""

    error_text: str
    code: Code
    exit_code: Literal[1, 2]
    owner: NotRequired[int | None]
    sent: bool
    state: NotRequired[Name | None]


class Jogged(Homed):
    """Position after a manual move."""

    ended_by_text: str | None
    """What stopped the stage."""
    code: NotRequired[Code]


class Calibration(Output):
    """A calibration; `toml` is for the configuration."""

    name: Literal["x_steps_per_mm", "y_steps_per_mm", "z_steps_per_mm", "force_scale", "compliance_mm_per_n"]
    value: float
    sd: float | None
    unit: Literal["steps/mm", "1", "mm/N"]
    toml: Toml


# --- system ---


class BenchmarkRow(Output):
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


class Benchmark(Output):
    """All models on this machine."""

    rows: list[BenchmarkRow]
    page: File
    reference_s: float


class CacheEntry(Output):
    """A cached result."""

    name: Name
    kind: Annotated[str, Field(json_schema_extra={"enum": list(KINDS)})]
    bytes: int
    read_utc: Time


class Cache(Output):
    """Cached results."""

    folder: File
    entries: list[CacheEntry]
    bytes: int
    limit_gb: float
    removed: int
    removed_bytes: int


class ConfigKey(Output):
    """A key of the configuration; value and default are null where it is not set."""

    key: Name
    value: Setting
    default: Setting
    unit: Unit
    allowed_text: str
    what_text: str


class Configuration(Output):
    """Keys of the configuration."""

    keys: list[ConfigKey]


class SerialPort(Output):
    """A serial port of this machine."""

    port: Port
    description_text: str


class Configured(Output):
    """A configured device."""

    kind: Name
    ports: list[Port]


class ConfiguredDevices(Output):
    """The configured devices."""

    stage: Configured
    force: Configured


class DeviceKind(Output):
    """A kind of device. package: where it comes from; null if built in."""

    kind: Name
    role: Literal["stage", "force"]
    package: Name | None


class CalibrationOnRecord(Output):
    """A calibration of the configuration."""

    name: Name
    value: float
    unit: Unit
    expires: Day
    expired: bool


class CacheSize(Output):
    """Size of the cache."""

    folder: File
    models: int
    answers: int
    bytes: int


class Doctor(Output):
    """This installation; with --config also what answers on the ports."""

    python: Name
    system: Name
    machine: Name
    cores: int
    versions: list[Package]
    ports: list[SerialPort]
    configured: ConfiguredDevices
    devices: list[DeviceKind]
    limits: dict[Key, Setting]
    """Table [limits] of the configuration."""
    solver: Literal["mkl_pardiso", "nested_dissection"]
    cache: CacheSize
    protocols: list[Name]
    problems_text: NotRequired[list[str]]
    stage: NotRequired[StageLook]
    force: NotRequired[ForceLook]
    calibrated: NotRequired[list[CalibrationOnRecord]]
    contact: NotRequired[Contact]
    last_run_text: NotRequired[str]


class BugReport(Output):
    """A file for a bug report."""

    bundle: File
    holds: list[FileSize]
    left_out_text: list[str]


OUTPUTS: Mapping[str, tuple[Any, ...]] = {
    "dry-run": (FinishedRun,),
    "run": (FinishedRun,),
    "meet": (Identification,),
    "check": (Check,),
    "resume": (FinishedRun,),
    "compare": (Compare,),
    "runs": (Runs,),
    "show": (Show, Columns),
    "watch": (Watch,),
    "panel": (Panel,),
    "export": (Export,),
    "study": (Study,),
    "indent": (Indent,),
    "impulse": (Impulse,),
    "shift-invariance": (ShiftInvariance,),
    "encode": (Encode,),
    "decode": (Decode,),
    "finger": (Finger,),
    "find": (Find,),
    "serve": (ServedPorts, RandomFinger),
    "stranger": (RandomFinger,),
    "home": (Homed,),
    "zero": (Zeroed,),
    "status": (Status,),
    "stop": (Stopped, NotStopped),
    "jog": (Jogged,),
    "calibrate": (Calibration,),
    "bench": (Benchmark,),
    "cache": (Cache,),
    "config": (Configuration,),
    "doctor": (Doctor, BugReport),
}
"""What a command with --json prints if it ends in a result; any of them may print a Failure instead."""


def schema_of(command: str) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of all that a command prints with `--json`."""
    found = TypeAdapter(Union[(*OUTPUTS[command], Failure)]).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"rig {command} --json"} | _plain(
        found
    )


def _plain(schema: Any) -> Any:
    """The schema without titles that only repeat keys."""
    if isinstance(schema, list):
        return [_plain(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    return {key: _plain(one) for key, one in schema.items() if key != "title" or not isinstance(one, str)}
