"""`rig encode`, `rig impulse` and `rig shift-invariance`: from pressure on the skin to receptor responses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from rig.cli.coding_options import (
    INPUT,
    NOISE,
    SAMPLING,
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
    press_of,
    pressures_of,
    source_in_words,
)
from rig.cli.options import (
    FingertipOption,
    JsonOption,
    PictureOption,
    checked_picture,
    option,
    write_picture,
)
from rig.cli.output import busy, complain, err, out, print_json, say_now, writes_json
from rig.cli.request import ExactlyOne, Rule, takes
from rig.plan.config import load_config
from rig_shared.outputs import Output, Ratio
from sim.coding.encoding import RATE_UNIT, SED_UNIT, Noise, NoisePlace, ReadingUnit, Receptor
from sim.coding.operators import (
    NAMES,
    OPERATORS,
    ImpulseResponses,
    OperatorName,
    ShiftErrors,
    impulse_responses,
    shift_errors,
)
from sim.coding.point_spread import HALF_WIDTH_MM, Mean, mean_over
from sim.coding.point_spread import SPACING_MM as SITE_SPACING_MM
from sim.coding.power_law import PowerLaw
from sim.coding.raju_table_6_1 import DRAWN, AllSites, Sampled, Where, cached_sites
from sim.coding.section import AXES, HALF_LENGTH, SPACING_MM, Energy, Sampling, sampled_section
from sim.coding.task import AgainstFiniteElementsJson, EncodeResult, EncodeTask, SectionPress, encode_task
from sim.config import FingertipConfig
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.small_strain_error import SmallStrainJson

_ROWS = 25


class SkinPressureJson(Output):
    """Pressure at places along the skin."""

    place_mm: list[float]
    pseudo: list[float]


class EncodeJson(Output):
    """Receptor readings. Without a receptor, `rate` is the noisy SED."""

    operator: OperatorName
    energy: Energy
    source_text: str
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


@dataclass(frozen=True)
class EncodeRequest:
    """Arguments and options of `rig encode`."""

    pressure: Annotated[
        str | None, option("Skin pressures in pseudo-units: 20,14, or a CSV with a column pressure.", "P", INPUT)
    ] = None
    shape: Annotated[
        str | None, option("Indentor that lies along the finger, as in rig indent, e.g. bar:3.0.", "S", INPUT)
    ] = None
    x_mm: AcrossOption = 0.0
    doi_mm: DoiOption = None
    operator: Annotated[
        OperatorName,
        option(f"Operator from pressure to strain energy density (SED): {' or '.join(OPERATORS)}.", "O", SAMPLING),
    ] = "convolution"
    energy: EnergyOption = "finite"
    snr_db: SnrOption = None
    noise: NoisePlaceOption = "receptor"
    gain: Annotated[
        float, option("Gain k, rate = k (SED − threshold), per unit of SED.", "K", NOISE, within=(1e-9, 1e9))
    ] = 1.0
    threshold: Annotated[
        float | None,
        option(
            "Threshold S₀ of the receptor, in pseudo-units of SED. Default: no receptor.",
            "S0",
            NOISE,
            within=(0, 1e9),
        ),
    ] = None
    seed: SeedOption = 0
    spacing_mm: SpacingOption = SPACING_MM
    half_length: HalfLengthOption = HALF_LENGTH
    receptor_depth_mm: DepthOption = DEFAULT_DEPTH_MM
    config: FingertipOption = None
    picture: PictureOption = None
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (ExactlyOne(("--pressure", "--shape")), *SHARED_RULES)


@takes(EncodeRequest)
def encode_command(request: EncodeRequest) -> None:
    """Print SED and rates at the receptors; for a shape, also the operator's error against finite elements."""
    sampling = Sampling(request.spacing_mm, request.half_length, "skin", request.receptor_depth_mm)
    added = None if request.snr_db is None else Noise(request.snr_db, request.noise, request.seed)
    receptor = None if request.threshold is None else Receptor(request.gain, request.threshold)
    checked_picture(request.picture)
    if request.shape is not None:
        source: NDArray[np.float64] | SectionPress = press_of(request.shape, request.x_mm, request.doi_mm)
    else:
        assert request.pressure is not None
        source = pressures_of(request.pressure, sampling.spacing_mm)
    read_text = source_in_words(source, sampling.spacing_mm)
    with busy("plane-strain section: building it, then computing the readings …"):
        finger = load_config(request.config).finger
        found = encode_task(EncodeTask(source, request.operator, request.energy, receptor, added, sampling, finger))
    if request.picture is not None:
        with busy("drawing the figure …", quick=True):
            from rig.report import coding_figures as figures  # matplotlib is slow to import

            load, encoded = found
            drawn = figures.EncodingPlot(
                load.operator, load.pressure, encoded, load.true, receptor=receptor is not None
            )
            write_picture(figures.encoding_figure(drawn), request.picture)
    if writes_json():
        print_json(_as_json(found, read_text, receptor, request.noise))
    else:
        _print(found, read_text, added, receptor)


def _as_json(found: EncodeResult, read_text: str, receptor: Receptor | None, at: NoisePlace) -> EncodeJson:
    load, encoded = found
    return {
        "operator": load.operator.name,
        "energy": load.operator.energy,
        "source_text": read_text,
        "pressure": {"place_mm": load.operator.place_mm.tolist(), "pseudo": load.pressure.tolist()},
        "receptor_mm": load.operator.receptor_mm.tolist(),
        "sed_pseudo": encoded.sed.tolist(),
        "rate": encoded.rate.tolist(),
        "rate_unit": SED_UNIT if receptor is None else RATE_UNIT,
        "samples": encoded.samples,
        "noise_sd": encoded.noise_sd,
        "noise_sd_unit": SED_UNIT if receptor is None or at == "receptor" else RATE_UNIT,
        "noise_share_of_peak": encoded.share_of_peak,
        "against_finite_elements": load.missed,
        "small_strain": None if load.small_strain is None else load.small_strain.as_json(),
    }


def _print(found: EncodeResult, read_text: str, added: Noise | None, receptor: Receptor | None) -> None:
    load, encoded = found
    operator = load.operator
    out.print(
        f"{operator.name}, SED {operator.energy}: {len(load.pressure)} pressures, M = {encoded.samples} receptors"
    )
    out.print(f"  read: {read_text}")
    if added is not None:
        out.print(
            f"  noise added to the {added.at}: {added.snr_db:g} dB over M = {encoded.samples} samples, sd "
            f"{encoded.noise_sd:.3g} = {encoded.share_of_peak:.2%} of the peak, seed {added.seed}"
        )
    if load.missed is not None:
        out.print(
            f"  difference from finite elements: relative L2 {load.missed['relative_l2']:.1%}, peak "
            f"{load.missed['peak']:+.1%}; {load.missed['lateral_share']:.0%} of the force is lateral"
        )
    if load.small_strain is not None:
        out.print(f"  {load.small_strain.note}")
    noisy = [] if added is None or added.at == "receptor" else ["SED + noise (pseudo)"]
    last = noisy if receptor is None else [f"rate ({RATE_UNIT})"]
    table = Table("receptor at (mm)", "SED (pseudo)", *last, box=None, padding=(0, 2))
    for k in np.unique(np.linspace(0, encoded.samples - 1, _ROWS).round().astype(int)).tolist():
        cells = [f"{operator.receptor_mm[k]:.2f}", f"{encoded.sed[k]:.4g}", f"{encoded.rate[k]:.4g}"]
        table.add_row(*cells[: 2 + len(last)])
    out.print(table)
    if not (encoded.rate > 0).any():
        complain(f"warning: no receptor responds: the highest SED, {encoded.sed.max():.4g}, is below the threshold")


STRAIN_UNIT: Literal["1/pseudo-unit"] = "1/pseudo-unit"
_FARTHEST = 0.75  # share of the half length, beyond which few receptors are left to compare
Found = tuple[ImpulseResponses, ShiftErrors]


@dataclass(frozen=True)
class ImpulseRequest:
    """Options of `rig impulse`."""

    spacing_mm: SpacingOption = SPACING_MM
    half_length: HalfLengthOption = HALF_LENGTH
    receptor_depth_mm: DepthOption = DEFAULT_DEPTH_MM
    energy: EnergyOption = "finite"
    config: FingertipOption = None
    picture: PictureOption = None
    as_json: JsonOption = False


@takes(ImpulseRequest)
def impulse_command(request: ImpulseRequest) -> None:
    """Print h, g, f, the difference of h from −g, and the error of shifting them, in skin and Cartesian axes."""
    kind = request.energy
    sampling = Sampling(request.spacing_mm, request.half_length, "skin", request.receptor_depth_mm)
    checked_picture(request.picture)
    finger = load_config(request.config).finger
    with busy("two plane-strain sections: building them, then computing the responses …"):
        found = {axes: _found(finger, replace(sampling, axes=axes), kind) for axes in AXES}
    if request.picture is not None:
        with busy("drawing the figure …", quick=True):
            from rig.report import coding_figures as figures  # matplotlib is slow to import

            plots = {str(axes): figures.ImpulsePlot(*both) for axes, both in found.items()}
            write_picture(figures.impulse_figure(plots), request.picture)
    if writes_json():
        result: ImpulseJson = {
            "energy": kind,
            "skin": _as_json_impulse(*found["skin"]),
            "cartesian": _as_json_impulse(*found["cartesian"]),
        }
        print_json(result)
    else:
        _print_impulse(found, kind)


def _found(finger: FingertipConfig, sampling: Sampling, energy: Energy) -> Found:
    section = sampled_section(finger, sampling)
    return impulse_responses(section), shift_errors(section, energy, int(_FARTHEST * sampling.half_length))


def _as_json_impulse(responses: ImpulseResponses, errors: ShiftErrors) -> ImpulseResponsesJson:
    frequency, (h, g, f) = responses.spectra()
    opposite, tails, (e11, e22, e12) = responses.opposite, responses.tails.tolist(), errors.strain
    return {
        "place_mm": responses.sampling.place_mm.tolist(),
        "unit": STRAIN_UNIT,
        "h": responses.strain[0].tolist(),
        "g": responses.strain[1].tolist(),
        "f": responses.strain[2].tolist(),
        "spectra": {
            "cycles_per_mm": frequency.tolist(),
            "unit": STRAIN_UNIT,
            "h": h.tolist(),
            "g": g.tolist(),
            "f": f.tolist(),
        },
        "g_is_minus_h": {
            "relative_l2": opposite.relative_l2,
            "largest": opposite.largest,
            "correlation": opposite.correlation,
        },
        "tails_over_peak": {"h": tails[0], "g": tails[1], "f": tails[2]},
        "shift_errors_relative_l2": {
            "place_mm": errors.place_mm.tolist(),
            "e11": e11.tolist(),
            "e22": e22.tolist(),
            "e12": e12.tolist(),
            "sed": errors.sed.tolist(),
        },
    }


def _print_impulse(found: dict[Any, Found], energy: Energy) -> None:
    for axes, (responses, errors) in found.items():
        opposite = responses.opposite
        peaks = ", ".join(f"{name} {abs(v).max():.3g}" for name, v in zip(NAMES, responses.strain, strict=True))
        tails = ", ".join(f"{name} {v:.1%}" for name, v in zip(NAMES, responses.tails, strict=True))
        out.print(f"{axes} axes, {responses.strain.shape[1]} samples {responses.sampling.spacing_mm:g} mm apart")
        out.print(f"  peaks, per pseudo-unit on one sample    {peaks}")
        out.print(f"  amplitude at the ends over the peak     {tails}")
        out.print(
            f"  (h + g) compared with h                 relative L2 {opposite.relative_l2:.1%}, at most "
            f"{opposite.largest:.1%} of the peak, r = {opposite.correlation:.4f}"
        )
        _print_errors(errors, energy)


def _print_errors(errors: ShiftErrors, energy: Energy) -> None:
    out.print("  error of shifting the responses, relative L2")
    table = Table("  position of the load (mm)", "e11", "e22", "e12", f"SED ({energy})", box=None, padding=(0, 2))
    every = max(1, len(errors.place_mm) // 12)
    for k in range(0, len(errors.place_mm), every):
        table.add_row(f"{errors.place_mm[k]:.2f}", *(f"{v:.1%}" for v in errors.strain[:, k]), f"{errors.sed[k]:.1%}")
    out.print(table)


_WHERE: dict[Where, str] = {"pulp": "18 pulp sites", "all": "all 24 sites"}


_BUSY = "24 point loads on the whole finger: loading from the cache, or computing them …"
_LINE_EVERY = 1000  # receptors between two lines without a spinner


@dataclass(frozen=True)
class ShiftInvarianceRequest:
    """Options of `rig shift-invariance`."""

    force_gwt: Annotated[
        float, option("Force of each point load, {within} gwt.", "F", SAMPLING, within=(1e-3, 100.0))
    ] = 1.0
    half_width_mm: Annotated[
        float, option("Half-width of the area around each site, {within} mm.", "MM", SAMPLING, within=(0.5, 4.0))
    ] = HALF_WIDTH_MM
    spacing_mm: SpacingOption = SITE_SPACING_MM
    receptor_depth_mm: DepthOption = DEFAULT_DEPTH_MM
    config: FingertipOption = None
    picture: PictureOption = None
    as_json: JsonOption = False


@takes(ShiftInvarianceRequest)
def shift_invariance_command(request: ShiftInvarianceRequest) -> None:
    """Fit SED = A / r^m under 24 equal point loads, and print A and m beside the source's Table 6.1."""
    sampled = Sampled(request.spacing_mm, request.half_width_mm, request.receptor_depth_mm, request.force_gwt)
    checked_picture(request.picture)
    settings = load_config(request.config).finger
    with busy(_BUSY):
        found, deformed = cached_sites(settings, sampled, None if writes_json() else _report_progress)
        if request.picture is not None:
            from rig.report import coding_figures as figures  # matplotlib is slow to import

            drawn = figures.PointSpreadPlot(deformed, found.sites[DRAWN])
            write_picture(figures.point_spread_figure(drawn), request.picture)
    if writes_json():
        print_json(_as_json_shift_invariance(found, sampled))
    else:
        _print_shift_invariance(found, sampled)


def _report_progress(done: int, of: int) -> None:
    """Report progress over the receptors; the factorization that follows takes as long."""
    if err.is_terminal or done % _LINE_EVERY == 0:
        say_now(f"computing strain at {done} of {of} receptors …")
    if done == of >= _LINE_EVERY:
        say_now("factorizing the stiffness, then solving 24 point loads …")


def _as_json_shift_invariance(found: AllSites, sampled: Sampled) -> ShiftInvarianceJson:
    return {
        "sampled": {
            "spacing_mm": sampled.spacing_mm,
            "half_width_mm": sampled.half_width_mm,
            "depth_mm": sampled.depth_mm,
            "force_gwt": sampled.force_gwt,
        },
        "common_factor": found.common_factor,
        "sites": [
            {
                "number": site.spread.site.number,
                "x_mm": site.spread.site.x_mm,
                "z_mm": site.spread.site.z_mm,
                "on_pulp": site.spread.site.on_pulp,
                "receptors": len(site.spread.sed),
                "linear": _law(site.linear),
                "logarithmic": _law(site.logarithmic),
                "by_azimuth": [None if np.isnan(v) else v for v in site.spread.by_azimuth(site.linear).tolist()],
                "moved_response_relative_l2": missed,
                "printed": {"a": printed.a, "m": printed.m, "r2": printed.r2},
            }
            for site, missed, printed in zip(found.sites, found.missed, found.printed, strict=True)
        ],
        "pulp": _means(found, "pulp"),
        "all": _means(found, "all"),
    }


def _law(law: PowerLaw) -> PowerLawJson:
    return {"a_pseudo": law.a, "m": law.m, "r": law.r, "r2": law.r2}


def _means(found: AllSites, where: Where) -> MeanLawsJson:
    printed = mean_over(found.published(where))
    return {
        "linear": _mean(mean_over(found.laws(where))),
        "logarithmic": _mean(mean_over(found.laws(where, "logarithmic"))),
        "printed": {"a": printed.a, "a_spread": printed.a_spread, "m": printed.m, "m_spread": printed.m_spread},
    }


def _mean(mean: Mean) -> MeanLawJson:
    return {"a_pseudo": mean.a, "a_spread": mean.a_spread, "m": mean.m, "m_spread": mean.m_spread}


def _print_shift_invariance(found: AllSites, sampled: Sampled) -> None:
    factor = found.common_factor
    out.print(
        f"SED {sampled.depth_mm:g} mm below the skin = A / r^m, under {sampled.force_gwt:g} gwt along the "
        f"inward normal,\nreceptors {sampled.spacing_mm:g} mm apart within ± {sampled.half_width_mm:g} mm of "
        f"each site in x and in z; A × {factor:.4g}, so that its mean over the\npulp equals the printed mean"
    )
    header = (
        "site",
        "A",
        "m",
        "r",
        "R²",
        "m by\nlogs",
        "round\nto",
        "moved",
        "A\nprinted",
        "m\nprinted",
        "R²\nprinted",
    )
    table = Table(*header, box=None, padding=(0, 1))
    for site, missed, printed in zip(found.sites, found.missed, found.printed, strict=True):
        law, log = site.linear, site.logarithmic
        table.add_row(
            f"{printed.number}{'' if site.spread.site.on_pulp else ' tip'}",
            f"{factor * law.a:.2f}", f"{law.m:.2f}", f"{law.r:.3f}", f"{law.r2:.3f}", f"{log.m:.2f}",
            f"{site.asymmetry:.0%}", f"{missed:.0%}", f"{printed.a:.2f}", f"{printed.m:.2f}", f"{printed.r2:.3f}",
        )  # fmt: skip
    out.print(table)
    for where, name in _WHERE.items():
        for kind, laws in (
            ("linear", found.laws(where)),
            ("logarithmic", found.laws(where, "logarithmic")),
            ("printed", found.published(where)),
        ):
            mean, times = mean_over(laws), 1.0 if kind == "printed" else factor
            said = f"m {mean.m:.3f} ± {mean.m_spread:.1%}, A {times * mean.a:.2f} ± {mean.a_spread:.1%}"
            out.print(f"{name}, {kind:<12}{said}")
