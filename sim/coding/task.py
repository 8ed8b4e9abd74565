"""Encoding of pressures and presses, and decoding of receptor readings, from a task to a result.

    found = decode_task(DecodeTask((20.0, 14.0)))
    found.pressure, found.errors

`rig encode` and `rig decode` do the same from a command line.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from rig_shared.outputs import Output, Ratio
from sim.coding.bayes import FEWEST_FOR_CONTACTS, FittedReceptor, ModelError, Profile, decode_profile, decode_through
from sim.coding.decoder_results import CodingError, Decoded, DecodingErrors, decoding_errors
from sim.coding.decoders_by_search import PressureRange, converged_search, global_search, grid_search, table_search
from sim.coding.encoding import Encoded, Noise, NoisePlace, Receptor, encode
from sim.coding.operators import (
    ForwardOperator,
    OperatorName,
    at_receptors,
    centred,
    convolution,
    impulse_responses,
    influence,
    normal_alone,
    normal_influence,
    weighted,
)
from sim.coding.pressure import contact_pressure, frictionless
from sim.coding.readings_file import FileReadings, checked_pressures
from sim.coding.receptor_readings import QUIET_SD, Readings, sd_at_rest
from sim.coding.section import SPACING_MM, Energy, SampledSection, Sampling, receptor_section, sampled_section, sed_of
from sim.coding.sheet import (
    FEWEST_PLACES,
    GRID_MM,
    ROW_ERROR,
    SHEET_SPACING_MM,
    AxialShape,
    Grid,
    SheetOperator,
    decode_sheet,
    pressed_skin,
    receptor_row,
    sheet_operator,
)
from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.patch import X, Z
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import points_below
from sim.models.small_strain_error import SmallStrain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SectionPress:
    """Indentor pressed into the plane-strain section.

    Parameters
    ----------
    shape : Indentor or str
        A shape prismatic along the finger, or its name as `sim.parse_shape` takes it.
    x_mm : float
        Position of the indentor's reference point.
    doi_mm : float
        Depth of indentation.
    """

    shape: Indentor | str
    x_mm: float
    doi_mm: float


# --- encoding ---


@dataclass(frozen=True)
class EncodeTask:
    """Pressures or a press to be encoded.

    Parameters
    ----------
    source : sequence of float, or SectionPress
        Normal pressures (pseudo-units) on adjacent samples of skin about the middle of the pad, 1 to 400 of them; or
        a press of the section.
    operator : {"convolution", "influence"}
        Fold the impulse responses of the pad's middle, or use finite elements for each place of the skin.
    energy : {"incompressible", "finite"}
        The definition of strain energy density (SED).
    receptor : Receptor, optional
        Gain and threshold of all receptors. Without one, rates are SED.
    noise : Noise, optional
        Noise to add.
    sampling : Sampling
        Spacing and depth of samples and receptors (mm).
    finger : FingertipConfig
        Parameters of the finger.
    """

    source: Sequence[float] | Array | SectionPress
    operator: OperatorName = "convolution"
    energy: Energy = "finite"
    receptor: Receptor | None = None
    noise: Noise | None = None
    sampling: Sampling = field(default_factory=Sampling)
    finger: FingertipConfig = field(default_factory=FingertipConfig)


class AgainstFiniteElementsJson(Output):
    """Difference of the operator's SED from that of finite elements."""

    relative_l2: Ratio
    peak: Ratio
    lateral_share: Ratio


@dataclass(frozen=True)
class SkinLoad:
    """Pressures on the skin (n,) in pseudo-units, and the operator that encodes them.

    Under `influence` the normal pressures are followed by the lateral ones. For a press, `true` has locations of
    receptors (mm) and their SED by finite elements (pseudo-units), `missed` the operator's `relative_l2` and `peak`
    errors against it and `lateral_share` of the force, and `small_strain` the deviation from finite strain at its
    depth.
    """

    operator: ForwardOperator
    pressure: Array
    true: tuple[Array, Array] | None = None
    missed: AgainstFiniteElementsJson | None = None
    small_strain: SmallStrain | None = None


class EncodeResult(NamedTuple):
    """Load on the skin, and the receptors' responses."""

    load: SkinLoad
    encoded: Encoded


def encode_task(task: EncodeTask) -> EncodeResult:
    """Encode pressures or a press.

    Parameters
    ----------
    task : EncodeTask

    Returns
    -------
    EncodeResult
        `load.operator.receptor_mm` has the (m,) receptor locations, `encoded.sed` and `encoded.rate` their (m,)
        responses.

    Raises
    ------
    CodingError
        For pressures that are too many, negative or not finite.
    ModelRangeError, ReceptorError, ShapeError
        For a section that cannot be sampled or pressed like this.
    """
    section = sampled_section(task.finger, task.sampling)
    if isinstance(task.source, SectionPress):
        load = load_of_press(section, task.operator, task.energy, task.source)
    else:
        load = load_of_pressures(section, task.operator, task.energy, checked_pressures(task.source))
    return EncodeResult(load, encode(load.operator, load.pressure, task.receptor, task.noise))


def load_of_pressures(section: SampledSection, name: OperatorName, energy: Energy, pressure: Array) -> SkinLoad:
    """Return (n,) equally spaced normal pressures about the middle of the pad, with their operator."""
    if name == "convolution":
        return SkinLoad(convolution(impulse_responses(section), len(pressure), energy), pressure)
    spacing = section.sampling.spacing_mm
    location = centred(len(pressure), spacing)
    operator = influence(section, location, np.full(len(location), spacing), energy)
    return SkinLoad(operator, np.concatenate([pressure, np.zeros(len(location))]))


def load_of_press(section: SampledSection, name: OperatorName, energy: Energy, press: SectionPress) -> SkinLoad:
    """Return the pressures of a press: normal ones at samples for convolution, all at the nodes for influence."""
    found = section.finger.indent(press.shape, press.x_mm, doi_mm=press.doi_mm)
    contact = contact_pressure(section, found)
    angle = section.line.angles(section.sampling.place_mm)
    true = sed_of(section.line.in_axes(found.receptor_strain, angle), section.material, energy)
    if name == "influence":
        operator, pressure = influence(section, contact.place_mm, contact.width_mm, energy), contact.stacked
    else:
        half = int(min(-contact.place_mm[0], contact.place_mm[-1]) / section.sampling.spacing_mm)
        operator = convolution(impulse_responses(section), 2 * half + 1, energy)
        pressure = contact.at(operator.place_mm)
    encoded = np.interp(section.sampling.place_mm, operator.receptor_mm, operator.sed(pressure))
    missed: AgainstFiniteElementsJson = {
        "relative_l2": float(np.linalg.norm(encoded - true) / np.linalg.norm(true)),
        "peak": float(encoded.max() / true.max() - 1),
        "lateral_share": contact.lateral_share,
    }
    return SkinLoad(operator, pressure, (section.sampling.place_mm, true), missed, found.small_strain)


# --- decoding ---

DecoderName = Literal["bayes", "univariate", "grid", "table", "global"]
DECODERS: tuple[DecoderName, ...] = get_args(DecoderName)

TABLE_ENTRIES = 1000
SURPRISING = 5.0  # standard deviations of chi-squared beyond which readings are not explained
CUT_OFF = "the search was cut off before it converged"
NO_NOISE = 1e-3
"""Share of the highest reading that serves as the sd without noise, since a likelihood requires one."""

_HELD = 0.95  # least share of a press's force within the estimated pressures
_SOUGHT = 0.8  # of the receptors' half-length: beyond it too few receptors respond


class SearchOptions(NamedTuple):
    """Search settings of the decoders, in pseudo-units.

    `start`, for `univariate` and `grid`: one for all, or (n,); default: the even pressure that explains the readings
    best. `bounds`, except for `bayes`; default: from 0 to twice what the highest reading needs from the one pressure
    with the largest effect on it. `grid_step`; default: a 30th of the bounds.
    """

    start: tuple[float, ...] | None = None
    bounds: tuple[float, float] | None = None
    grid_step: float | None = None
    seed: int = 0


@dataclass(frozen=True)
class DecodeTask:
    """Readings to be decoded, or pressures or a press to be encoded and read back.

    Parameters
    ----------
    source : sequence of float, SectionPress or FileReadings
        Pressures (pseudo-units) or a press, as for `EncodeTask`; or readings, from `read_readings`.
    decoder : {"bayes", "univariate", "grid", "table", "global"}
        Only `bayes` gives standard deviations and bands, and only it decodes sheets and axial shapes.
    operator : {"convolution", "influence"}, optional
        Operator that encodes and decodes. Default: convolution for pressures, influence for a press.
        Readings always go by influence.
    energy : {"incompressible", "finite"}
        The definition of strain energy density (SED).
    receptor : FittedReceptor, optional
        Gain and threshold with their standard errors; for rates, and only for these.
    noise : Noise, optional
        Noise to add to encoded pressures.
    noise_at : {"receptor", "output"}
        Where the noise of `FileReadings` enters.
    sampling : Sampling
        Spacing of the pressures (mm), and of the receptors that encode.
    axial_mm : tuple of float
        For a row of readings in the whole finger: half-lengths (mm) of pressure ellipses along it, of which the
        readings choose one. Empty: the row is read back by the plane-strain section.
    search : SearchOptions
        Search settings of the decoder.
    finger : FingertipConfig
        Parameters of the finger.
    """

    source: Sequence[float] | Array | SectionPress | FileReadings
    decoder: DecoderName = "bayes"
    operator: OperatorName | None = None
    energy: Energy = "finite"
    receptor: FittedReceptor | None = None
    noise: Noise | None = None
    noise_at: NoisePlace = "receptor"
    sampling: Sampling = field(default_factory=Sampling)
    axial_mm: tuple[float, ...] = ()
    search: SearchOptions = field(default_factory=SearchOptions)
    finger: FingertipConfig = field(default_factory=FingertipConfig)


@dataclass(frozen=True)
class ReadingNoise:
    """Noise of m readings: standard deviations (m,) in their unit, their source, and where the noise enters."""

    sd: Array
    known: str
    at: NoisePlace = "receptor"


@dataclass(frozen=True)
class Observation:
    """Readings of m receptors, and the operator of n pressures that explains them.

    Readings are rates where there is a receptor, else SED (pseudo-units); `true` has the (n,) encoded pressures. The
    default `error` of the operator is the difference between meshes; `axial` names the shape along the finger under
    which a row is decoded.
    """

    operator: ForwardOperator
    reading: Array
    receptor: FittedReceptor | None
    noise: ReadingNoise | None
    true: Array | None = None
    error: ModelError | None = None
    axial: str | None = None

    @property
    def sed(self) -> Array:
        """(m,) SED of the readings; for a silent receptor its threshold."""
        receptor = None if self.receptor is None else self.receptor.receptor
        return self.reading if receptor is None else self.reading / receptor.gain + receptor.threshold

    @property
    def responding(self) -> NDArray[np.bool_]:
        """(m,) receptors whose reading is a number, not only a bound."""
        if self.receptor is None:
            return np.ones(len(self.reading), np.bool_)
        return self.reading > (QUIET_SD * self.noise.sd if self.noise and self.noise.at == "output" else 0)

    def unexplained(self, pressure: Array, share: float = 0.0) -> tuple[str, ...]:
        """Return a message if SED under (n,) pressures deviates from readings by more than noise and model error."""
        if self.noise is None:
            return ()
        noise, sed = self.noise.sd / (1.0 if self.receptor is None else self.receptor.receptor.gain), self.sed
        off = (self.operator.sed(pressure) - sed) / np.hypot(noise, share * sed)
        expected, misfit = int(self.responding.sum()), float((off[self.responding] ** 2).sum())
        if misfit <= expected + SURPRISING * np.sqrt(2 * expected):
            return ()
        return (
            (f"the decoded pressures do not explain the readings: misfit {misfit:.3g}, expected about {expected}"),
        )


@dataclass(frozen=True)
class DecodeResult:
    """Decoded pressures (n,) in pseudo-units, how they were found, and problems.

    `observation.operator.place_mm` has their (n,) locations, (n, 2) for a sheet. `profile`, for `bayes`, has standard
    deviations and bands; `path` (moves + 1, n) is the trajectory of `univariate` and `grid`. `ms` is the time of the
    decoder alone; a search that reached its limit has not converged.
    """

    observation: Observation
    pressure: Array
    converged: bool
    ms: float
    profile: Profile | None = None
    path: Array = field(default_factory=lambda: np.zeros((0, 0)))
    bounds: PressureRange | None = None
    problems: tuple[str, ...] = ()

    @property
    def left_of_sed(self) -> float:
        """Root mean square of SED (pseudo-units) that the pressures do not explain, without silent receptors."""
        seen = self.observation
        return float(np.sqrt(np.mean((seen.operator.sed(self.pressure) - seen.sed)[seen.responding] ** 2)))

    @property
    def errors(self) -> DecodingErrors | None:
        """Errors against the true pressures, if these are known."""
        true = self.observation.true
        return None if true is None else decoding_errors(true, self.pressure)


def decode_task(task: DecodeTask) -> DecodeResult:
    """Decode readings, or encode and read back.

    Parameters
    ----------
    task : DecodeTask

    Returns
    -------
    DecodeResult

    Raises
    ------
    CodingError
        For what cannot be encoded, sought or decoded; `arguments` are those that its sentence names.
    ModelRangeError, ReceptorError, ShapeError
        For a finger that cannot be sampled or pressed like this.
    """
    found = decode_observation(observe(task), task.decoder, task.search)
    unread = task.source.unread_text if isinstance(task.source, FileReadings) else ""
    return replace(found, problems=(*found.problems, f"readings: {unread}")) if unread else found


def observe(task: DecodeTask) -> Observation:
    """Encode a load or take the readings, and make the operator that explains them. Raises as `decode_task`."""
    if isinstance(task.source, FileReadings):
        if task.axial_mm:
            return best_explained(_of_row(task, task.source))
        return _of_readings(task, task.source)
    if isinstance(task.source, SectionPress):
        return _of_press(task, task.source)
    return _of_pressures(task, checked_pressures(task.source))


def decode_observation(observation: Observation, decoder: DecoderName, search: SearchOptions) -> DecodeResult:
    """Find the pressures. Raises CodingError for an invalid start, bounds or readings."""
    if not observation.responding.any():
        raise CodingError("no reading exceeds its noise; at least one receptor must respond", "all_noise")
    if decoder == "bayes":
        return _bayes(observation, search.seed)
    upright = observation.operator.leaning(
        np.zeros(len(observation.operator.place_mm))
    )  # these decoders know normal forces only
    observation = replace(observation, operator=upright)
    within = _bounds(observation, search)
    start = _start(observation, search, within)
    step = (within.high - within.low) / 30 if search.grid_step is None else search.grid_step
    run: Mapping[str, Callable[[], Decoded]] = {
        "univariate": lambda: converged_search(upright, observation.sed, start, within),
        "grid": lambda: grid_search(upright, observation.sed, start, within, step),
        "table": lambda: table_search(upright, observation.sed, within, TABLE_ENTRIES, search.seed),
        "global": lambda: global_search(upright, observation.sed, within, search.seed),
    }
    began = time.perf_counter()
    found = run[decoder]()
    ms = 1e3 * (time.perf_counter() - began)
    ends = int(np.isclose(found.pressure, within.high, rtol=1e-9).sum())
    problems = [] if found.converged else [CUT_OFF]
    if ends:
        problems.append(
            f"{ends} of {len(found.pressure)} pressures are at the upper end of the range, {within.high:g}"
        )
    problems += observation.unexplained(found.pressure)
    return DecodeResult(observation, found.pressure, found.converged, ms, None, found.path, within, tuple(problems))


def best_explained(observations: Sequence[Observation]) -> Observation:
    """Return the observation, of several axial shapes, whose pressures explain the readings best in a quick fit."""
    return min(
        observations,
        key=lambda observation: _profile(observation, _noise_of_readings(observation), 0, table=False).misfit,
    )


def _noise_of_readings(observation: Observation) -> ReadingNoise:
    if observation.noise is None:
        raise CodingError(
            "readings requires a column sd or at_rest, since the decoder bayes uses the noise of the readings",
            "noise_unknown",
            ("readings",),
        )
    return observation.noise


def _bayes(observation: Observation, seed: int) -> DecodeResult:
    noise = _noise_of_readings(observation)
    began = time.perf_counter()
    profile = _profile(observation, noise, seed)
    ms = 1e3 * (time.perf_counter() - began)
    share = (observation.error or ModelError()).share
    problems = (() if profile.converged else (CUT_OFF,)) + observation.unexplained(profile.pressure, share)
    return DecodeResult(observation, profile.pressure, profile.converged, ms, profile, problems=problems)


def _profile(observation: Observation, noise: ReadingNoise, seed: int, *, table: bool = True) -> Profile:
    """Decode readings, weighted to equal noise."""
    sd = float(np.median(noise.sd))
    weight = sd / noise.sd
    operator, reading = weighted(observation.operator, weight), weight * observation.reading

    def decoded(readings: Readings) -> Profile:
        if isinstance(operator, SheetOperator):
            return decode_sheet(operator, readings, operator.skin.grid.shape, observation.error)
        return decode_profile(operator, readings, observation.error, seed, table=table)

    def through(receptor: Receptor) -> Profile:
        of_rates = Readings.of_rates if noise.at == "receptor" else Readings.of_noisy_rates
        unit = receptor.gain if noise.at == "receptor" else 1.0
        mine = Receptor(receptor.gain, weight * receptor.threshold)
        return decoded(of_rates(reading, mine, sd / unit))

    if observation.receptor is None:
        return decoded(Readings.of_sed(reading, sd))
    return decode_through(observation.receptor, through)


def _bounds(observation: Observation, search: SearchOptions) -> PressureRange:
    if search.bounds is None:
        most = (observation.operator.parts**2).sum(axis=0).max()
        return PressureRange(0.0, 2 * float(np.sqrt(observation.sed.max() / most)))
    return PressureRange(*search.bounds)


def _start(observation: Observation, search: SearchOptions, within: PressureRange) -> Array:
    n = observation.operator.parts.shape[2]
    if search.start is None:
        even = observation.operator.sed(np.ones(n))
        size = np.sqrt(max(0.0, float(even @ observation.sed)) / float(even @ even))
        return np.full(n, float(np.clip(size, *within)))
    start = np.array(search.start)
    if len(start) not in (1, n):
        raise CodingError(f"start: {len(start)} numbers; must be 1 or {n}", "wrong_count", ("start",))
    if not ((start >= within.low) & (start <= within.high)).all():
        raise CodingError(
            f"start: must lie within bounds, {within.low:g} to {within.high:g}", "outside_range", ("start", "bounds")
        )
    return np.full(n, start[0]) if len(start) == 1 else start


# --- observations ---


def _of_pressures(task: DecodeTask, pressure: Array) -> Observation:
    """Encode pressures and explain them by the same operator."""
    by = task.operator or "convolution"
    load = load_of_pressures(sampled_section(task.finger, task.sampling), by, task.energy, pressure)
    operator = load.operator if by == "convolution" else normal_alone(load.operator)
    return _encoded(task, load.operator, load.pressure, operator, pressure)


def _of_press(task: DecodeTask, press: SectionPress) -> Observation:
    """Encode a press by finite elements; explain it by frictionless pressures, or by convolution."""
    section = sampled_section(task.finger, task.sampling)
    contact = contact_pressure(section, section.finger.indent(press.shape, press.x_mm, doi_mm=press.doi_mm))
    encoder = influence(section, contact.place_mm, contact.width_mm, task.energy)
    half = int(_SOUGHT * section.sampling.half_length)
    operator = _sought(section, task.operator or "influence", task.energy, half)
    true = contact.means(operator.place_mm)
    share = float(true.sum() * section.sampling.spacing_mm / (contact.normal * contact.width_mm).sum())
    if share < _HELD:
        raise CodingError(
            f"shape at x = {press.x_mm:g} mm: {share:.0%} of the force lies between "
            f"{float(operator.place_mm[0]):.2f} and {float(operator.place_mm[-1]):.2f} mm, where pressures are "
            f"estimated; at least {_HELD:.0%} is required; move the indentor towards x = 0",
            "beside_the_search",
            ("shape",),
        )
    return _encoded(task, encoder, contact.stacked, operator, true)


def _sought(section: SampledSection, by: OperatorName, energy: Energy, half: int) -> ForwardOperator:
    """Return SED at the section's own receptors under 2 half + 1 pressures."""
    n, spacing = 2 * half + 1, section.sampling.spacing_mm
    if by == "influence":
        return frictionless(section, centred(n + 1, spacing), energy)
    full = convolution(impulse_responses(section), n, energy)
    return at_receptors(full, slice(half, half + len(section.place_mm)))


def _encoded(
    task: DecodeTask, encoder: ForwardOperator, load: Array, operator: ForwardOperator, true: Array
) -> Observation:
    """Encode by one operator for decoding by another."""
    receptor = None if task.receptor is None else task.receptor.receptor
    encoded = encode(encoder, load, receptor, task.noise)
    if not encoded.rate.max() > 0:
        raise CodingError(
            "no receptor responds; raise the pressure, or lower threshold below the SED of the receptors",
            "all_silent",
            ("threshold",),
        )
    return Observation(operator, encoded.rate, task.receptor, noise_of(encoded, receptor, task.noise), true)


def noise_of(encoded: Encoded, receptor: Receptor | None, noise: Noise | None) -> ReadingNoise:
    """Return the noise, measured from the same receptors at rest, or as given if receptors can be silent."""
    m = encoded.samples
    if noise is None or not encoded.noise_sd:
        return ReadingNoise(np.full(m, NO_NOISE * float(encoded.rate.max())), "none; a small sd is assumed")
    if receptor is None:
        rest = encoded.noise_sd * np.random.default_rng((noise.seed, 1)).normal(size=m)
        return ReadingNoise(np.full(m, sd_at_rest(rest)), f"measured from {m} receptors at rest")
    unit = receptor.gain if noise.at == "receptor" else 1.0
    return ReadingNoise(np.full(m, unit * encoded.noise_sd), "given", noise.at)


def _of_readings(task: DecodeTask, readings: FileReadings) -> Observation:
    """Return readings with pressures between the outermost receptors at the sampling's spacing.

    Unless the decoder finds contacts, there are no more pressures than readings, linear in between.
    """
    _refuse_kind(task, readings)
    if readings.z_mm is not None:
        if task.decoder != "bayes":
            raise CodingError(
                "readings with a column z_mm requires decoder bayes", "sheet_not_decoded", ("readings", "decoder")
            )
        return Observation(
            _over_sheet(task, readings, readings.z_mm), readings.reading, task.receptor, _noise(task, readings)
        )
    section = receptor_section(task.finger, readings.place_mm, readings.depth_mm)
    low, high = _on_patch(readings, section.line.places(section.model.patch.x))
    n = round((high - low) / task.sampling.spacing_mm)
    if n < 1:
        raise CodingError(
            f"readings over {high - low:g} mm of skin: must span more than {task.sampling.spacing_mm:g} mm",
            "too_short",
            ("readings",),
        )
    if task.decoder == "bayes" and n >= FEWEST_FOR_CONTACTS:
        operator: ForwardOperator = frictionless(section, np.linspace(low, high, n + 1), task.energy)
    else:
        few = np.linspace(low, high, min(n + 1, len(readings.place_mm)))
        operator = normal_influence(section, few, SPACING_MM, task.energy)
    return Observation(operator, readings.reading, task.receptor, _noise(task, readings))


def _of_row(task: DecodeTask, readings: FileReadings) -> list[Observation]:
    """Return one observation for each axial ellipse, with pressures in the receptor plane of the whole finger."""
    _refuse_kind(task, readings)
    if readings.z_mm is not None:
        raise CodingError(
            "axial applies to a row of receptors; remove it, or the column z_mm", "axial_of_sheet", ("axial",)
        )
    row = receptor_row(task.finger, readings.place_mm, readings.depth_mm)
    low, high = _on_patch(readings, row.line.places(row.skin.nodes_mm[:, X]))
    n = round((high - low) / task.sampling.spacing_mm)
    if n < FEWEST_FOR_CONTACTS:
        least_mm = FEWEST_FOR_CONTACTS * task.sampling.spacing_mm
        raise CodingError(
            f"axial with a row over {high - low:.2f} mm of skin: the row must span at least {least_mm:.2f} mm",
            "too_short",
            ("axial",),
        )
    centre_mm = row.line.surface.apex.position_mm[Z]
    shapes = [AxialShape(half, centre_mm) for half in task.axial_mm]
    operators = row.under_each(shapes, np.linspace(low, high, n + 1), task.energy)
    noise = _noise(task, readings)
    return [
        Observation(operator, readings.reading, task.receptor, noise, error=ROW_ERROR, axial=shape.name)
        for shape, operator in zip(shapes, operators, strict=True)
    ]


def _refuse_kind(task: DecodeTask, readings: FileReadings) -> None:
    if readings.kind == "rate" and task.receptor is None:
        raise CodingError(
            f"readings with a column {readings.kind} requires gain and threshold; add them",
            "receptor_mismatch",
            ("readings", "gain", "threshold"),
        )
    if readings.kind != "rate" and task.receptor is not None:
        raise CodingError(
            f"readings with a column {readings.kind} contains SED, which takes no threshold; remove it",
            "receptor_mismatch",
            ("readings", "threshold"),
        )


def _on_patch(readings: FileReadings, place_mm: Array) -> tuple[float, float]:
    """Return the range from the first to the last receptor, limited to the patch."""
    low, high = np.clip(readings.place_mm[[0, -1]], place_mm.min(), place_mm.max()).tolist()
    return low, high


def _over_sheet(task: DecodeTask, readings: FileReadings, z_mm: Array) -> ForwardOperator:
    """Return the operator of pressures over x and z between the outermost receptors, limited to the patch."""
    apart = max(task.sampling.spacing_mm, SHEET_SPACING_MM)
    along_x = _places("x_mm", readings.place_mm, 0.0, apart)
    along_z = _places("z_mm", z_mm, task.finger.receptor_plane_mm, apart)
    surface = FingertipSurface.fit(task.finger.geometry)
    points = points_below(task.finger, surface, readings.place_mm, readings.depth_mm, z_mm)
    return sheet_operator(pressed_skin(task.finger, points, readings.depth_mm), Grid(along_x, along_z), task.energy)


def _places(name: str, receptors_mm: Array, middle_mm: float, apart_mm: float) -> Array:
    low, high = np.clip([receptors_mm.min(), receptors_mm.max()], middle_mm - GRID_MM, middle_mm + GRID_MM)
    n = int((high - low) / apart_mm + 1e-9) + 1
    if n < FEWEST_PLACES:
        raise CodingError(
            f"readings, {name}: the sheet spans {high - low:.2f} mm; it must span at least "
            f"{(FEWEST_PLACES - 1) * apart_mm:g} mm within ± {GRID_MM:g} mm of {middle_mm:.2f} mm",
            "too_short",
            ("readings",),
        )
    return np.asarray(0.5 * (low + high) + centred(n, apart_mm))


def _noise(task: DecodeTask, readings: FileReadings) -> ReadingNoise | None:
    if readings.sd is not None:
        return ReadingNoise(readings.sd, "given in the file", task.noise_at)
    if readings.at_rest is not None:
        m = len(readings.reading)
        sd = np.full(m, sd_at_rest(readings.at_rest))
        return ReadingNoise(sd, f"measured from {m} receptors at rest", task.noise_at)
    return None
