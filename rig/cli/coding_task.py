"""The task of `rig encode` and `rig decode`: operator, pressures, readings, receptors and decoder."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from rig.cli.readings_file import GivenReadings
from rig.errors import BadInputError
from sim.coding.bayes import FEWEST_FOR_CONTACTS, FittedReceptor, ModelError, Profile, decode_profile, decode_through
from sim.coding.encoding import QUIET_SD, Encoded, Noise, NoisePlace, Readings, Receptor, encode, sd_at_rest
from sim.coding.operators import (
    Operator,
    OperatorName,
    centred,
    convolution,
    felt_where,
    impulse_responses,
    influence,
    normal_alone,
    normal_influence,
    weighted,
)
from sim.coding.pressure import borne_by, frictionless
from sim.coding.search import Decoded, Range, converged_search, global_search, grid_search, table_search
from sim.coding.section import SPACING_MM, Energy, SampledSection, Sampling, felt_section, sampled_section, sed_of
from sim.coding.sheet import (
    FEWEST_PLACES,
    GRID_MM,
    ROW_ERROR,
    SHEET_SPACING_MM,
    AxialShape,
    Grid,
    SheetOperator,
    decode_sheet,
    felt_row,
    felt_skin,
    sheet_operator,
)
from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.patch import X, Z
from sim.contact.shapes import parse_shape
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import points_below
from sim.models.small_strain import SmallStrain

Array = NDArray[np.float64]


class Scene(NamedTuple):
    """One press of the section."""

    indentor: Indentor
    x_mm: float
    doi_mm: float


@dataclass(frozen=True)
class Told:
    """What is encoded; of a press also SED by finite elements and how far the operator is from it."""

    operator: Operator
    pressure: Array
    true: tuple[Array, Array] | None = None  # places of receptors in mm, SED
    missed: dict[str, float] | None = None
    small_strain: SmallStrain | None = None


def pressed(shape: str, x_mm: float, doi_mm: float | None) -> Scene:
    """Raises BadInputError without a depth, ShapeError for no shape."""
    if doi_mm is None:
        raise BadInputError(
            "{option}: expected {needs} beside it", code="needs_option", option="--shape", needs="--doi-mm"
        )
    return Scene(parse_shape(shape), x_mm, doi_mm)


def told(section: SampledSection, name: OperatorName, energy: Energy, pressure: Array) -> Told:
    """Equally spaced normal pressures about the middle of the pad."""
    if name == "convolution":
        return Told(convolution(impulse_responses(section), len(pressure), energy), pressure)
    spacing = section.sampling.spacing_mm
    place = centred(len(pressure), spacing)
    operator = influence(section, place, np.full(len(place), spacing), energy)
    return Told(operator, np.concatenate([pressure, np.zeros(len(place))]))


def told_of_press(section: SampledSection, name: OperatorName, energy: Energy, scene: Scene) -> Told:
    """What a press bears on the skin: for convolution normal pressures at samples, for influence all at the nodes."""
    found = section.finger.indent(scene.indentor, scene.x_mm, doi_mm=scene.doi_mm)
    borne = borne_by(section, found)
    angle = section.line.angles(section.sampling.place_mm)
    true = sed_of(section.line.in_axes(found.receptor_strain, angle), section.material, energy)
    if name == "influence":
        operator, pressure = influence(section, borne.place_mm, borne.width_mm, energy), borne.stacked
    else:
        half = int(min(-borne.place_mm[0], borne.place_mm[-1]) / section.sampling.spacing_mm)
        operator = convolution(impulse_responses(section), 2 * half + 1, energy)
        pressure = borne.at(operator.place_mm)
    said = np.interp(section.sampling.place_mm, operator.receptor_mm, operator.sed(pressure))
    missed = {
        "relative_l2": float(np.linalg.norm(said - true) / np.linalg.norm(true)),
        "peak": float(said.max() / true.max() - 1),
        "lateral_share": borne.lateral_share,
    }
    return Told(operator, pressure, (section.sampling.place_mm, true), missed, found.small_strain)


DecoderName = Literal["ours", "univariate", "grid", "table", "global"]
DECODERS: tuple[DecoderName, ...] = get_args(DecoderName)

TABLE_ENTRIES = 1000
SURPRISING = 5.0  # standard deviations of chi-squared beyond which readings are not explained
CUT_OFF = "the search was cut off before it stood still"
NO_NOISE = 1e-3
"""Of the highest reading: the sd that stands for no noise, since a likelihood needs one."""


@dataclass(frozen=True)
class Noisy:
    """What is known of the readings' noise, in their own unit."""

    sd: Array  # (m,)
    known: str  # how: told, measured at rest, assumed
    at: NoisePlace = "receptor"


@dataclass(frozen=True)
class Task:
    """Readings, SED where there is no receptor and rates where there is one, and what they are to be explained by."""

    operator: Operator
    reading: Array  # (m,)
    receptor: FittedReceptor | None
    noise: Noisy | None  # None: nothing is known of it
    true: Array | None = None  # (n,) pressures
    error: ModelError | None = None  # None: as meshes differ
    axial: str | None = None  # the shape along the finger under which a row is decoded, by name

    @property
    def sed(self) -> Array:
        """(m,) SED that the readings stand for; of a silent receptor its threshold."""
        receptor = None if self.receptor is None else self.receptor.receptor
        return self.reading if receptor is None else self.reading / receptor.gain + receptor.threshold

    @property
    def heard(self) -> NDArray[np.bool_]:
        """(m,) receptors whose reading is a number, not only a bound."""
        if self.receptor is None:
            return np.ones(len(self.reading), np.bool_)
        return self.reading > (QUIET_SD * self.noise.sd if self.noise and self.noise.at == "output" else 0)

    def unexplained(self, pressure: Array, share: float = 0.0) -> tuple[str, ...]:
        """A complaint where SED under (n,) pressures is farther from the readings than noise and a share of it."""
        if self.noise is None:
            return ()
        noise, sed = self.noise.sd / (1.0 if self.receptor is None else self.receptor.receptor.gain), self.sed
        off = (self.operator.sed(pressure) - sed) / np.hypot(noise, share * sed)
        expected, misfit = int(self.heard.sum()), float((off[self.heard] ** 2).sum())
        if misfit <= expected + SURPRISING * np.sqrt(2 * expected):
            return ()
        return (f"the readings are not explained: misfit {misfit:.3g}, expected about {expected}",)


class Search(NamedTuple):
    """How the decoders that search within a range do so; None: by the readings' size."""

    start: tuple[float, ...] | None = None
    within: tuple[float, float] | None = None
    grid_step: float | None = None
    seed: int = 0


@dataclass(frozen=True)
class Answer:
    """Pressures, how they were found, and what is to be said against them."""

    pressure: Array
    converged: bool
    ms: float
    profile: Profile | None = None  # of ours
    path: Array = field(default_factory=lambda: np.zeros((0, 0)))
    within: Range | None = None
    problems: tuple[str, ...] = ()


def noise_of(encoded: Encoded, receptor: Receptor | None, at: NoisePlace, seed: int) -> Noisy:
    """Measured, as it would be, from the same receptors at rest; where those are silent, told."""
    m = encoded.samples
    if not encoded.noise_sd:
        return Noisy(np.full(m, NO_NOISE * float(encoded.rate.max())), "assumed, there is none")
    if receptor is None:
        rest = encoded.noise_sd * np.random.default_rng((seed, 1)).normal(size=m)
        return Noisy(np.full(m, sd_at_rest(rest)), f"measured at rest of {m} receptors")
    unit = receptor.gain if at == "receptor" else 1.0
    return Noisy(np.full(m, unit * encoded.noise_sd), "told", at)


def decode(task: Task, decoder: DecoderName, search: Search) -> Answer:
    """Raises BadInputError for a start or a range that cannot be meant, DecodingError for such readings."""
    if not task.heard.any():
        raise BadInputError("no reading is above its noise: expected some that are", code="all_noise")
    if decoder == "ours":
        return _ours(task, search.seed)
    operator = task.operator.leaning(np.zeros(len(task.operator.place_mm)))  # upright: they know no other forces
    task = replace(task, operator=operator)
    within = _range(task, search)
    start = _start(task, search, within)
    step = (within.high - within.low) / 30 if search.grid_step is None else search.grid_step
    run: Mapping[str, Callable[[], Decoded]] = {
        "univariate": lambda: converged_search(operator, task.sed, start, within),
        "grid": lambda: grid_search(operator, task.sed, start, within, step),
        "table": lambda: table_search(operator, task.sed, within, TABLE_ENTRIES, search.seed),
        "global": lambda: global_search(operator, task.sed, within, search.seed),
    }
    began = time.perf_counter()
    found = run[decoder]()
    ms = 1e3 * (time.perf_counter() - began)
    ends = int(np.isclose(found.pressure, within.high, rtol=1e-9).sum())
    problems = [] if found.converged else [CUT_OFF]
    if ends:
        problems.append(f"{ends} of {len(found.pressure)} pressures stand at the end of the range, {within.high:g}")
    problems += task.unexplained(found.pressure)
    return Answer(found.pressure, found.converged, ms, None, found.path, within, tuple(problems))


def best_explained(tasks: Sequence[Task]) -> Task:
    """Of the same readings under several axial shapes: the one whose pressures explain them best, at a quick look."""
    return min(tasks, key=lambda task: _profile(task, _noise_of_ours(task), 0, table=False).misfit)


def _noise_of_ours(task: Task) -> Noisy:
    if task.noise is None:
        raise BadInputError(
            "--readings: expected a column sd or at_rest, decoder ours goes by the readings' noise",
            code="noise_unknown",
        )
    return task.noise


def _ours(task: Task, seed: int) -> Answer:
    noise = _noise_of_ours(task)
    began = time.perf_counter()
    profile = _profile(task, noise, seed)
    ms = 1e3 * (time.perf_counter() - began)
    share = (task.error or ModelError()).share
    problems = (() if profile.converged else (CUT_OFF,)) + task.unexplained(profile.pressure, share)
    return Answer(profile.pressure, profile.converged, ms, profile, problems=problems)


def _profile(task: Task, noise: Noisy, seed: int, *, table: bool = True) -> Profile:
    """Readings whose noise differs are weighted until it does not."""
    sd = float(np.median(noise.sd))
    weight = sd / noise.sd
    operator, reading = weighted(task.operator, weight), weight * task.reading

    def decoded(readings: Readings) -> Profile:
        if isinstance(operator, SheetOperator):
            return decode_sheet(operator, readings, operator.skin.grid.shape, task.error)
        return decode_profile(operator, readings, task.error, seed, table=table)

    def through(receptor: Receptor) -> Profile:
        of_rates = Readings.of_rates if noise.at == "receptor" else Readings.of_noisy_rates
        unit = receptor.gain if noise.at == "receptor" else 1.0
        mine = Receptor(receptor.gain, weight * receptor.threshold)
        return decoded(of_rates(reading, mine, sd / unit))

    if task.receptor is None:
        return decoded(Readings.of_sed(reading, sd))
    return decode_through(task.receptor, through)


def _range(task: Task, search: Search) -> Range:
    """By default from 0 to twice what the highest reading needs of the one pressure that it feels most."""
    if search.within is None:
        most = (task.operator.parts**2).sum(axis=0).max()
        return Range(0.0, 2 * float(np.sqrt(task.sed.max() / most)))
    return Range(*search.within)


def _start(task: Task, search: Search, within: Range) -> Array:
    """By default the even pressure that explains the readings best."""
    n = task.operator.parts.shape[2]
    if search.start is None:
        even = task.operator.sed(np.ones(n))
        size = np.sqrt(max(0.0, float(even @ task.sed)) / float(even @ even))
        return np.full(n, float(np.clip(size, *within)))
    given = np.array(search.start)
    if len(given) not in (1, n):
        raise BadInputError(
            "{option}: {numbers} numbers, expected 1 or {expected}",
            code="wrong_count", option="--start", numbers=len(given), expected=n,
        )  # fmt: skip
    if not ((given >= within.low) & (given <= within.high)).all():
        raise BadInputError(
            "{option}: expected numbers within --range {low:g} … {high:g}",
            code="outside_range", option="--start", low=within.low, high=within.high,
        )  # fmt: skip
    return np.full(n, given[0]) if len(given) == 1 else given


_HELD = 0.95  # of a press's force under the pressures that are sought
_SOUGHT = 0.8  # of the receptors' half length: beyond, too few of them feel a pressure


class Encoding(NamedTuple):
    """How pressures are encoded first."""

    energy: Energy
    receptor: FittedReceptor | None
    noise: Noise | None
    at: NoisePlace  # where noise enters: that of readings too


def task_of_pressures(
    config: FingertipConfig, sampling: Sampling, by: OperatorName, how: Encoding, pressure: Array
) -> Task:
    """Encoded and read back by the same operator."""
    section = sampled_section(config, sampling)
    mine = told(section, by, how.energy, pressure)
    operator = mine.operator if by == "convolution" else normal_alone(mine.operator)
    return _task(operator, _encoded(mine.operator, mine.pressure, how), how, pressure)


def task_of_press(config: FingertipConfig, sampling: Sampling, by: OperatorName, how: Encoding, scene: Scene) -> Task:
    """Felt as finite elements have it; read back as pressures without friction, or folded ones, about the middle."""
    section = sampled_section(config, sampling)
    borne = borne_by(section, section.finger.indent(scene.indentor, scene.x_mm, doi_mm=scene.doi_mm))
    felt = influence(section, borne.place_mm, borne.width_mm, how.energy)
    half = int(_SOUGHT * section.sampling.half_length)
    operator = _sought(section, by, how.energy, half)
    true = borne.means(operator.place_mm)
    held = float(true.sum() * section.sampling.spacing_mm / (borne.normal * borne.width_mm).sum())
    if held < _HELD:
        raise BadInputError(
            "--shape at x = {x_mm:g} mm: {held:.0%} of its force is between {low_mm:.2f} and {high_mm:.2f} mm, where "
            "pressures are sought, expected {least:.0%} or more",
            code="beside_the_search",
            x_mm=scene.x_mm,
            held=held,
            low_mm=float(operator.place_mm[0]),
            high_mm=float(operator.place_mm[-1]),
            least=_HELD,
        )
    return _task(operator, _encoded(felt, borne.stacked, how), how, true)


def task_of_readings(
    config: FingertipConfig, how: Encoding, given: GivenReadings, spacing_mm: float, *, contacts: bool
) -> Task:
    """Pressures between the outermost receptors, so far apart; where they are not sought within contacts no more than
    there are readings, with straight lines between them.
    """
    _refuse_kind(given, how)
    if given.z_mm is not None:
        if not contacts:
            raise BadInputError(
                "--readings with a column z_mm: expected --decoder ours, the only one of sheets",
                code="sheet_not_decoded",
            )
        return Task(
            _over_sheet(config, given, spacing_mm, how.energy), given.reading, how.receptor, _noise(given, how)
        )
    section = felt_section(config, given.place_mm, given.depth_mm)
    low, high = _on_patch(given, section.line.places(section.model.patch.x))
    n = round((high - low) / spacing_mm)
    if n < 1:
        raise BadInputError(
            "{option} over {length_mm:g} mm of skin: expected more than {least_mm:g} mm",
            code="too_short", option="--readings", length_mm=high - low, least_mm=spacing_mm,
        )  # fmt: skip
    if contacts and n >= FEWEST_FOR_CONTACTS:
        operator: Operator = frictionless(section, np.linspace(low, high, n + 1), how.energy)
    else:
        few = np.linspace(low, high, min(n + 1, len(given.place_mm)))
        operator = normal_influence(section, few, SPACING_MM, how.energy)
    return Task(operator, given.reading, how.receptor, _noise(given, how))


def tasks_of_row(
    config: FingertipConfig, how: Encoding, given: GivenReadings, spacing_mm: float, half_lengths_mm: Sequence[float]
) -> list[Task]:
    """Pressures in the receptor plane of the whole finger, one task for each ellipse along it."""
    _refuse_kind(given, how)
    if given.z_mm is not None:
        raise BadInputError(
            "--axial beside a column z_mm: expected a row of receptors, a sheet needs no axial shape",
            code="axial_of_sheet",
        )
    row = felt_row(config, given.place_mm, given.depth_mm)
    low, high = _on_patch(given, row.line.places(row.felt.nodes_mm[:, X]))
    n = round((high - low) / spacing_mm)
    if n < FEWEST_FOR_CONTACTS:
        least_mm = FEWEST_FOR_CONTACTS * spacing_mm
        raise BadInputError(
            "{option} with a row over {length_mm:.2f} mm of skin: expected {least_mm:.2f} mm or more",
            code="too_short", option="--axial", length_mm=high - low, least_mm=least_mm,
        )  # fmt: skip
    centre_mm = row.line.surface.apex.position_mm[Z]
    shapes = [AxialShape(half, centre_mm) for half in half_lengths_mm]
    operators = row.under_each(shapes, np.linspace(low, high, n + 1), how.energy)
    return [
        Task(operator, given.reading, how.receptor, _noise(given, how), error=ROW_ERROR, axial=shape.name)
        for shape, operator in zip(shapes, operators, strict=True)
    ]


def _refuse_kind(given: GivenReadings, how: Encoding) -> None:
    if (given.kind == "rate") != (how.receptor is not None):
        expected = "--gain and --threshold beside rates" if given.kind == "rate" else "no --threshold beside SED"
        raise BadInputError(
            "--readings with a column {column}: expected {expected}",
            code="receptor_mismatch", column=given.kind, expected=expected,
        )  # fmt: skip


def _on_patch(given: GivenReadings, place_mm: Array) -> tuple[float, float]:
    """From the first to the last receptor, as far as places of the patch go."""
    low, high = np.clip(given.place_mm[[0, -1]], place_mm.min(), place_mm.max()).tolist()
    return low, high


def _over_sheet(config: FingertipConfig, given: GivenReadings, spacing_mm: float, energy: Energy) -> Operator:
    """Pressures over x and z between the outermost receptors, as far as the finger's patch goes."""
    assert given.z_mm is not None
    apart = max(spacing_mm, SHEET_SPACING_MM)
    sides = [_places(name, v, middle, apart) for name, v, middle in (
        ("x_mm", given.place_mm, 0.0), ("z_mm", given.z_mm, config.receptor_plane_mm))]  # fmt: skip
    points = points_below(config, FingertipSurface.fit(config.geometry), given.place_mm, given.depth_mm, given.z_mm)
    return sheet_operator(felt_skin(config, points, given.depth_mm), Grid(*sides), energy)


def _places(name: str, receptors_mm: Array, middle_mm: float, apart_mm: float) -> Array:
    low, high = np.clip([receptors_mm.min(), receptors_mm.max()], middle_mm - GRID_MM, middle_mm + GRID_MM)
    n = int((high - low) / apart_mm + 1e-9) + 1
    if n < FEWEST_PLACES:
        raise BadInputError(
            "{option}, {column}: a sheet over {length_mm:.2f} mm, expected {least_mm:g} mm or more within "
            "± {half_mm:g} mm of {middle_mm:.2f}",
            code="too_short",
            option="--readings",
            column=name,
            length_mm=high - low,
            least_mm=(FEWEST_PLACES - 1) * apart_mm,
            half_mm=GRID_MM,
            middle_mm=middle_mm,
        )
    return np.asarray(0.5 * (low + high) + centred(n, apart_mm))


def _sought(section: SampledSection, by: OperatorName, energy: Energy, half: int) -> Operator:
    """SED at the section's own receptors under 2 half + 1 pressures."""
    n, spacing = 2 * half + 1, section.sampling.spacing_mm
    if by == "influence":
        return frictionless(section, centred(n + 1, spacing), energy)
    full = convolution(impulse_responses(section), n, energy)
    return felt_where(full, slice(half, half + len(section.place_mm)))


def _encoded(operator: Operator, pressure: Array, how: Encoding) -> Encoded:
    encoded = encode(operator, pressure, None if how.receptor is None else how.receptor.receptor, how.noise)
    if not encoded.rate.max() > 0:
        raise BadInputError(
            "no receptor says anything: expected pressure, and a --threshold below its SED", code="all_silent"
        )
    return encoded


def _task(operator: Operator, encoded: Encoded, how: Encoding, true: Array) -> Task:
    receptor = None if how.receptor is None else how.receptor.receptor
    seed = 0 if how.noise is None else how.noise.seed
    return Task(operator, encoded.rate, how.receptor, noise_of(encoded, receptor, how.at, seed), true)


def _noise(given: GivenReadings, how: Encoding) -> Noisy | None:
    if given.sd is not None:
        return Noisy(given.sd, "told by the file", how.at)
    if given.at_rest is not None:
        m = len(given.reading)
        return Noisy(np.full(m, sd_at_rest(given.at_rest)), f"measured at rest of {m} receptors", how.at)
    return None
