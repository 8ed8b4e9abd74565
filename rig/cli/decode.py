"""`rig decode`: estimate pressure on the skin from the readings of receptors under it."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from rig.cli.coding_options import (
    INPUT,
    NOISE,
    SHARED_RULES,
    AcrossOption,
    DepthOption,
    DoiOption,
    EnergyOption,
    HalfLengthOption,
    NoisePlaceOption,
    SeedOption,
    SnrOption,
    SpacingOption,
    in_options,
    press_of,
    pressures_of,
)
from rig.cli.options import (
    FingertipOption,
    JsonOption,
    PictureOption,
    bounded,
    checked_picture,
    numbers,
    option,
    write_picture,
)
from rig.cli.output import busy, out, print_json, writes_json
from rig.cli.request import ExactlyOne, Excludes, Needs, Rule, takes
from rig.errors import BadInputError
from rig.plan.config import load_config
from rig_shared.number_text import read_number
from rig_shared.outputs import Output, Places, Range, Ratio, Shape
from sim.coding.bayes import FittedReceptor
from sim.coding.decoder_results import CodingError
from sim.coding.decoders_by_search import error_surface
from sim.coding.encoding import RATE_UNIT, SED_UNIT, Noise, ReadingUnit, Receptor
from sim.coding.operators import OPERATORS, ForwardOperator, OperatorName
from sim.coding.readings_file import FileReadings, pa_per_pseudo, read_readings
from sim.coding.section import HALF_LENGTH, SPACING_MM, Energy, Sampling
from sim.coding.shape_class import SolidClass, classify_solid
from sim.coding.sheet import HALF_LENGTHS_MM, SheetOperator
from sim.coding.task import DECODERS, DecodeResult, DecoderName, DecodeTask, SearchOptions, SectionPress, decode_task
from sim.config import FingertipConfig
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.tables import TableError

_PLUS_MINUS = re.compile(r"±|\+/?-")
_LARGEST = 1e9
LEAST_MM, MOST_MM = 0.3, 10.0
"""Shortest and longest half-length of a contact along the finger (mm)."""


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


def receptor_of(gain: str | None, threshold: str | None) -> FittedReceptor | None:
    """Return R = k (S − S₀) with standard errors of k and S₀, None without a threshold; raise BadInputError."""
    if threshold is None:
        return None
    k, k_se = _with_error("--gain", "1" if gain is None else gain)
    s0, s0_se = _with_error("--threshold", threshold)
    bounded("--gain", k, 1e-9, _LARGEST)
    if k_se >= k:
        raise BadInputError(f"--gain {gain}: the standard error must be smaller than the gain", "error_too_large")
    return FittedReceptor(Receptor(k, bounded("--threshold", s0, -_LARGEST, _LARGEST)), k_se, s0_se)


def _with_error(option: str, text: str) -> tuple[float, float]:
    """Return a number and its standard error if stated: 30, 30±2, 30+-2."""
    try:
        parts = [*_PLUS_MINUS.split(text), "0"][:2]
        value, error = map(read_number, parts) if text.count("±") < 2 else (math.nan, 0.0)
    except ValueError:
        value = error = math.nan
    if not (math.isfinite(value) and math.isfinite(error) and error >= 0):
        raise BadInputError(
            f"{option} {text!r}: must be a number such as 30, or a number and its standard error, 30±2",
            "not_a_number",
        )
    return value, error


def search_of(start: str | None, within: str | None, step: float | None, seed: int) -> SearchOptions:
    """Return the search options; raise BadInputError for numbers out of bounds."""
    places = None if start is None else numbers("--start", start)
    ends = None if within is None else numbers("--range", within)
    if ends is not None and not (len(ends) == 2 and 0 <= ends[0] < ends[1] <= _LARGEST):
        raise BadInputError(
            f"--range {within}: must be two ascending numbers that are not negative, e.g. 0,30", "not_ascending"
        )
    return SearchOptions(places, ends and (ends[0], ends[1]), step, seed)


def axial_of(axial: str | None) -> tuple[float, ...]:
    """Return candidate half-lengths of the contact along the finger (mm); empty if no shape is named."""
    if axial is None:
        return ()
    word, named, length = axial.partition(":")
    if word == "ellipse" and not named:
        return HALF_LENGTHS_MM
    try:
        half = read_number(length) if word == "ellipse" else math.nan
    except ValueError:
        half = math.nan
    if not LEAST_MM <= half <= MOST_MM:
        raise BadInputError(
            f"--axial {axial}: must be ellipse, or ellipse:HALF-LENGTH with a half-length of {LEAST_MM:g} to "
            f"{MOST_MM:g} mm",
            "bad_value",
        )
    return (half,)


Array = NDArray[np.float64]

_DECODER = "Decoder"
_ROWS = 25
_FINE = 121  # values of a pressure across a plot of the error surface


def as_json_object(name: DecoderName, finger: FingertipConfig, found: DecodeResult) -> DecodeJson:
    """Return arrays and numbers for JSON; unknown values are null."""
    seen, profile, errors = found.observation, found.profile, found.errors
    operator, noise = seen.operator, seen.noise
    unit = SED_UNIT if seen.receptor is None else RATE_UNIT
    band: PressureBandJson | None = None
    if profile is not None:
        low, high = profile.band()
        band = {"low_pseudo": low.tolist(), "high_pseudo": high.tolist()}
    return {
        "decoder": name,
        "operator": operator.name,
        "energy": operator.energy,
        "place_mm": operator.place_mm.tolist(),
        "pressure_pseudo": found.pressure.tolist(),
        "pa_per_pseudo": pa_per_pseudo(finger),
        "sd_pseudo": None if profile is None else profile.sd.tolist(),
        "band_90": band,
        "true_pseudo": None if seen.true is None else seen.true.tolist(),
        "errors": None
        if errors is None
        else {"eq_6_8": errors.eq_6_8, "relative_l2": errors.relative_l2, "rmse_over_peak": errors.rmse_over_peak},
        "receptor_mm": operator.receptor_mm.tolist(),
        "reading": seen.reading.tolist(),
        "reading_unit": unit,
        "explained_sed_pseudo": operator.sed(found.pressure).tolist(),
        "samples": len(seen.reading),
        "noise": {
            "sd": None if noise is None else noise.sd.tolist(),
            "unit": unit,
            "known_text": None if noise is None else noise.known,
            "left_of_sed_pseudo": found.left_of_sed,
        },
        "range_pseudo": found.bounds,
        "moves": max(0, len(found.path) - 1),
        "converged": found.converged,
        "problems_text": list(found.problems),
        "felt": _solid_as_json(operator, found),
        "axial": seen.axial,
        "search_ms": found.ms,
    }


def print_decoded(finger: FingertipConfig, decoder: DecoderName, found: DecodeResult) -> None:
    """Print the result as text, with a warning if the search was cut off or the readings are not explained."""
    seen, operator, errors = found.observation, found.observation.operator, found.errors
    moves = f", {len(found.path) - 1} moves" if len(found.path) else ""
    ended = "converged" if found.converged else "not converged"
    out.print(
        f"{decoder}, {operator.name}, SED {operator.energy}: {len(found.pressure)} pressures from "
        f"M = {len(seen.reading)} readings in {found.ms:.0f} ms, {ended}{moves}"
    )
    if seen.axial is not None:
        out.print(f"  receptor plane of the whole finger; contact along the finger: {seen.axial}")
    if seen.noise is not None and found.profile is not None:
        out.print(f"  noise: sd {np.median(seen.noise.sd):.3g} per reading, {seen.noise.known}")
    share = found.left_of_sed / float(seen.sed.max())
    out.print(f"  residual SED: root mean square {found.left_of_sed:.3g}, {share:.2%} of the largest")
    if errors is not None:
        out.print(
            f"  Eq. 6.8 {errors.eq_6_8:.3g} (squared), relative L2 {errors.relative_l2:.1%}, "
            f"RMSE over the peak {errors.rmse_over_peak:.1%}"
        )
    else:
        out.print(f"  1 pseudo-unit = {pa_per_pseudo(finger):.4g} Pa")
    for problem in found.problems:
        out.print(f"  warning: {problem}")
    if isinstance(operator, SheetOperator):
        solid = classify_solid(operator.skin, found.pressure)
        out.print(
            f"  estimated shape: {solid.name}, {solid.size_mm:.2g} mm; contact spans {solid.extent_mm[0]:.2f} mm "
            f"along x, {solid.extent_mm[1]:.2f} mm along z"
        )
        out.print(_map(operator, found))
    else:
        out.print(_table(found))


def _solid_as_json(operator: ForwardOperator, found: DecodeResult) -> ShapeEstimateJson | None:
    """Return class and size of the object on a sheet."""
    if not isinstance(operator, SheetOperator):
        return None
    solid = classify_solid(operator.skin, found.pressure)
    return {"shape_class": solid.name, "size_mm": solid.size_mm, "extent_mm": solid.extent_mm}


def _map(operator: SheetOperator, found: DecodeResult) -> Table:
    """Return the table of pressures (pseudo-units), x downwards and z to the right."""
    grid = operator.skin.grid
    table = Table("x \\ z (mm)", *(f"{z:.1f}" for z in grid.z_mm), box=None, padding=(0, 1))
    for x, row in zip(grid.x_mm, found.pressure.reshape(grid.shape), strict=True):
        table.add_row(f"{x:.1f}", *(f"{v:.0f}" for v in row))
    return table


def _table(found: DecodeResult) -> Table:
    seen = found.observation
    digits = max(0, 2 - int(np.floor(np.log10(max(float(found.pressure.max()), 1e-6)))))
    columns = {"place (mm)": [f"{v:.2f}" for v in seen.operator.place_mm]}
    if seen.true is not None:
        columns["true"] = [f"{v:.{digits}f}" for v in seen.true]
    columns["found (pseudo)"] = [f"{v:.{digits}f}" for v in found.pressure]
    if found.profile is not None:
        band = zip(*found.profile.band(), strict=True)
        columns["90 % band"] = [f"{low:.{digits}f} … {high:.{digits}f}" for low, high in band]
    table = Table(*columns, box=None, padding=(0, 2))
    rows = list(zip(*columns.values(), strict=True))
    for k in np.unique(np.linspace(0, len(rows) - 1, _ROWS).round().astype(int)).tolist():
        table.add_row(*rows[k])
    return table


def draw(found: DecodeResult, picture: Path) -> None:
    """Plot the path over the error surface of two pressures, or else the pressures with their band."""
    from rig.report import coding_figures as figures  # matplotlib is slow to import

    seen, operator = found.observation, found.observation.operator
    if isinstance(operator, SheetOperator):
        grid = operator.skin.grid
        assert found.profile is not None
        pressure, sd = (values.reshape(grid.shape) for values in (found.pressure, found.profile.sd))
        plot = figures.sheet_figure(figures.SheetPlot(grid.x_mm, grid.z_mm, pressure, sd, operator.receptor_mm))
    elif len(found.pressure) == 2 and len(found.path) > 1:
        assert found.bounds is not None
        ends = {"error surface": (np.full(2, found.bounds.low), np.full(2, found.bounds.high))}
        surfaces = {}
        for title, (low, high) in (ends | figures.extents(found.path)).items():
            first, second = np.linspace(low, high, _FINE).T
            error = error_surface(seen.operator, seen.sed, first, second)
            surfaces[title] = figures.ErrorSurface(first, second, error)
        plot = figures.search_figure(surfaces, {"path of the search": found.path}, seen.true)
    else:
        band, explained = None if found.profile is None else found.profile.band(), operator.sed(found.pressure)
        places = operator.place_mm, found.pressure, band, seen.true, operator.receptor_mm, seen.sed, explained
        plot = figures.decoded_figure(figures.DecodingPlot(*places))
    write_picture(plot, picture)


@dataclass(frozen=True)
class DecodeRequest:
    """Arguments and options of `rig decode`."""

    pressure: Annotated[
        str | None,
        option("Pressures to encode first, in pseudo-units: 20,14, or a CSV (column pressure).", "P", INPUT),
    ] = None
    shape: Annotated[str | None, option("Indentor along the finger, as in rig indent.", "S", INPUT)] = None
    readings: Annotated[
        Path | None, option("Receptor readings with locations, depths and noise (docs/coding.md).", "FILE.csv", INPUT)
    ] = None
    axial: Annotated[
        str | None,
        option(
            "Contact along the finger, with --readings: ellipse:HALF-LENGTH in mm, 0.3 to 10; ellipse fits it.",
            "A",
            INPUT,
        ),
    ] = None
    x_mm: AcrossOption = 0.0
    doi_mm: DoiOption = None
    decoder: Annotated[DecoderName, option(f"Decoder: {', '.join(DECODERS)}.", "NAME", _DECODER)] = "bayes"
    operator: Annotated[
        OperatorName | None,
        option(
            f"Operator: {' or '.join(OPERATORS)}. Default: convolution with --pressure, else influence.",
            "O",
            _DECODER,
        ),
    ] = None
    energy: EnergyOption = "finite"
    snr_db: SnrOption = None
    noise: NoisePlaceOption = "receptor"
    gain: Annotated[str | None, option("Gain k, rate = k (SED − threshold), e.g. 30±2. Default: 1.", "K", NOISE)] = (
        None
    )
    threshold: Annotated[
        str | None, option("Threshold S₀ of SED, in pseudo-units, e.g. 1.5±0.2. Default: no receptor.", "S0", NOISE)
    ] = None
    start: Annotated[
        str | None,
        option(
            "Starting pressures for univariate and grid, e.g. 10,10. Default: best uniform pressure.", "P", _DECODER
        ),
    ] = None
    within: Annotated[
        str | None,
        option(
            "Pressure range, in pseudo-units, not for bayes. Default: set by the readings.",
            "LOW,HIGH",
            _DECODER,
            name="--range",
        ),
    ] = None
    grid_step: Annotated[
        float | None,
        option(
            "Grid spacing for the grid decoder, in pseudo-units. Default: range / 30.",
            "P",
            _DECODER,
            within=(1e-6, _LARGEST),
        ),
    ] = None
    seed: SeedOption = 0
    spacing_mm: SpacingOption = SPACING_MM
    half_length: HalfLengthOption = HALF_LENGTH
    receptor_depth_mm: DepthOption = DEFAULT_DEPTH_MM
    config: FingertipOption = None
    picture: PictureOption = None
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (
        ExactlyOne(("--pressure", "--shape", "--readings")),
        Excludes("--readings", ("--snr-db", "--operator", "--doi-mm"), "not_together"),
        *SHARED_RULES,
        Needs("--axial", ("--readings",)),
        Needs("--start", ("--decoder univariate", "--decoder grid"), "not_this_decoder"),
        Needs(
            "--range",
            ("--decoder univariate", "--decoder grid", "--decoder table", "--decoder global"),
            "not_this_decoder",
        ),
        Needs("--grid-step", ("--decoder grid",), "not_this_decoder"),
        Needs("--axial", ("--decoder bayes",), "not_this_decoder"),
    )


@takes(DecodeRequest)
def decode_command(request: DecodeRequest) -> None:
    """Print the decoded pressures, their uncertainty and, if the true pressures are known, their error."""
    name, at = request.decoder, request.noise
    receptor = receptor_of(request.gain, request.threshold)
    added = None if request.snr_db is None else Noise(request.snr_db, at, request.seed)
    search = search_of(request.start, request.within, request.grid_step, request.seed)
    sampling = Sampling(request.spacing_mm, request.half_length, "skin", request.receptor_depth_mm)
    half_lengths = axial_of(request.axial)
    checked_picture(request.picture)
    finger = load_config(request.config).finger
    source = _source(request, finger)
    whole = isinstance(source, FileReadings) and (source.z_mm is not None or request.axial is not None)
    task = DecodeTask(
        source, name, request.operator, request.energy, receptor, added, at, sampling, half_lengths, search, finger
    )
    model = "fingertip: loading or building it" if whole else "plane-strain section: building it"
    with busy(f"{model}, then estimating the pressures …"):
        found = _decoded(task)
    if request.picture is not None:
        with busy("drawing the figure …", quick=True):
            draw(found, request.picture)
    if writes_json():
        print_json(as_json_object(name, finger, found))
    else:
        print_decoded(finger, name, found)


def _source(request: DecodeRequest, finger: FingertipConfig) -> Array | SectionPress | FileReadings:
    if request.pressure is not None:
        return pressures_of(request.pressure, request.spacing_mm)
    if request.shape is not None:
        return press_of(request.shape, request.x_mm, request.doi_mm)
    assert request.readings is not None
    try:
        return read_readings(request.readings, finger)
    except TableError as error:
        raise BadInputError(f"--readings {error}", error.code) from None


def _decoded(task: DecodeTask) -> DecodeResult:
    try:
        return decode_task(task)
    except CodingError as error:
        raise in_options(error) from None
