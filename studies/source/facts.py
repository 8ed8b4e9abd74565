"""The facts of Raju (1998) that a right model reproduces, measured as they come out. Nothing is tuned to them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from rig.compare.pressure_formula import Constants
from rig.compare.shape_test import shape_test
from rig.compare.stimuli import Stimulus
from rig.report.html import Section
from sim.contact.profiles import STEP_HALF_WAVELENGTH_MM
from sim.measures.measures import shown
from sim.models.fingertip import Fingertip
from sim.models.results.indentation import IndentationResult, median_of_four
from studies.source.facts_by_parameter import BAR_DOIS_MM, edges_touched
from studies.source.pressure_fits import PressureStudy, told

Array = NDArray[np.float64]

DEPTHS_MM = (0.75, 1.5)
"""Where SED is looked at below the skin: the source's 0.75 mm, and a deeper one of ours."""

FINE_X_MM = tuple(float(x) for x in (0.17 * np.arange(-14, 15)).round(2))
"""One receptor an element (170 µm, as the source's mesh and ours)."""

_MINUS = re.compile(r"(?<!\w)-(?=\d)")
_COUNTS = 0.05  # a maximum counts when it stands out by this part of the range
_LOW_GWT, _TABLE_X_MM = 2.33, -1.63


@dataclass(frozen=True)
class Fact:
    """One line of the table."""

    number: str
    source: str
    ours: str
    agrees: bool

    @property
    def row(self) -> tuple[str, ...]:
        """As cells."""
        cells = (_MINUS.sub("−", text) for text in (self.number, self.source, self.ours))
        return *cells, "agrees" if self.agrees else "differs"


def all_facts(
    finger: Fingertip, fine: dict[float, Fingertip], stimuli: dict[str, Stimulus], pressures: PressureStudy
) -> list[Fact]:
    """Facts 1–7; `fine` are fingers with a close row of receptors, by depth; `stimuli` by title."""
    return [
        *_bars(finger),
        *_step(finger, stimuli["step:1 at 2.33 gwt"]),
        *_long_step(finger, stimuli["step:5 at 2.33 gwt"]),
        *_sed_under_a_step(fine[DEPTHS_MM[0]]),
        *_ssrps(stimuli["step:1 at 2.33 gwt"]),
        *_ssrps_of_bars(stimuli, fine[DEPTHS_MM[0]]),
        _pressure(pressures.constants),
    ]


def facts_section(
    finger: Fingertip, fine: dict[float, Fingertip], stimuli: dict[str, Stimulus], pressures: PressureStudy
) -> Section:
    """The table of facts."""
    return Section(
        "Facts of the source",
        "What Raju (1998, ch. 4 and 5) reports of his model, and what this one gives. Nothing was tuned to it.",
        ("fact", "the source", "here", "verdict"),
        tuple(fact.row for fact in all_facts(finger, fine, stimuli, pressures)),
    )


def _bars(finger: Fingertip) -> Iterator[Fact]:
    expected = ("none", "left", "left fully, right slightly", "both")
    for doi, edges in zip(BAR_DOIS_MM, expected, strict=True):
        result = finger.indent("bar:3.0", 0.0, doi_mm=doi)
        found = edges_touched(result, 1.5)
        width = max((b - a for a, b in result.contact_regions_mm), default=0.0)
        agrees = found == edges if edges != expected[2] else found == "both"
        yield Fact(f"1, DOI {doi:g}", f"bar 3.0 touches at: {edges}", f"{found}; contact {width:.2f} mm wide", agrees)


def _step(finger: Fingertip, stimulus: Stimulus) -> Iterator[Fact]:
    results = [finger.indent("step:1", float(x), force_gwt=_LOW_GWT) for x in stimulus.x_mm[::-1]]
    raw = [float(r.pressure_profile[1].max()) for r in results]
    filtered = [float(median_of_four(*r.pressure_profile).max()) for r in results]
    best = int(np.argmax(raw))
    ours = f"{raw[best]:.0f} raw at x = {results[best].x_mm:g}, {max(filtered):.0f} filtered"
    yield Fact(
        "2, peak", "near 2000 near x = −1.6", ours, 1400 < raw[best] < 2600 and abs(results[best].x_mm + 1.6) < 0.3
    )
    two = [r.x_mm for r in results if len(r.contact_regions_mm) > 1]
    span = f"x = {max(two)} … {min(two)}" if two else "never"
    yield Fact("2, regions", "two regions from x = −1.63 on", span, bool(two) and abs(max(two) + 1.63) < 0.18)
    touched = any(_in_concave_part(r) for r in results)
    yield Fact("2, concave part", "never touches", "touches" if touched else "never touches", not touched)
    ours = f"{raw[0]:.0f} before, {raw[-1]:.0f} after"
    yield Fact("2, flats", "the same pressure before and after", ours, abs(raw[0] / raw[-1] - 1) < 0.02)


def _in_concave_part(result: IndentationResult) -> bool:
    half_wave = STEP_HALF_WAVELENGTH_MM["1"]
    s = result.model.patch.x + result.state.displacement[0] - result.x_mm
    return bool((result.state.active & (s > 0.5 * half_wave) & (s < half_wave)).any())


def _long_step(finger: Fingertip, stimulus: Stimulus) -> Iterator[Fact]:
    peak = float(stimulus.pressure.max())
    regions = max(len(stimulus.contact_regions_mm(k)) for k in range(len(stimulus.x_mm)))
    yield Fact(
        "3", "step 5: peak below 1000, one region", f"{peak:.0f}, {regions} region(s)", peak < 1000 and regions == 1
    )


def _sed_under_a_step(finger: Fingertip) -> Iterator[Fact]:
    deep = finger.indent("step:1", _TABLE_X_MM, doi_mm=0.73)
    light = finger.indent("step:1", _TABLE_X_MM, force_gwt=_LOW_GWT)
    for name, result, sed in (("DOI 0.73", deep, 2), (f"{_LOW_GWT} gwt", light, 1)):
        n = maxima(shown("sed", result.receptor_measures["sed"]))
        yield Fact(f"4, {name}", f"SED at 0.75 mm: {sed} peak(s)", f"{n}", n == sed)
        n = maxima(shown("s33", result.receptor_measures["s33"]))
        yield Fact(f"4, {name}", "−s33 at 0.75 mm: 1 peak", f"{n}", n == 1)


def _ssrps(stimulus: Stimulus) -> Iterator[Fact]:
    """ep1 under step 1 at 2.33 gwt, receptor by receptor."""
    expected = {
        -2.0: "no dip",
        -1.5: "passes",
        -1.25: "passes",
        -1.0: "passes",
        -0.5: "dip exceeds peak",
        0.0: "dip exceeds peak",
    }
    for k, x in enumerate(stimulus.receptor_mm):
        source = expected.get(float(x), "only a dip")
        verdict = shape_test(stimulus.indentor, stimulus.x_mm, stimulus.ssrp("ep1", k))
        assert verdict is not None
        p, q = verdict.judged_by["peak"], verdict.judged_by["dip"]
        if source == "only a dip":  # it comes before the highest value where there is no peak
            q = verdict.judged_by["baseline"] - float(stimulus.ssrp("ep1", k).min())
        agrees = {
            "passes": verdict.passed,
            "no dip": q < _COUNTS * p,
            "dip exceeds peak": q > p > _COUNTS * q,
            "only a dip": p < _COUNTS * q,
        }[source]
        yield Fact(f"5, receptor {x:g}", source, f"dip / peak = {q:.4f} / {p:.4f}", agrees)


def _ssrps_of_bars(stimuli: dict[str, Stimulus], fine: Fingertip) -> Iterator[Fact]:
    for title in ("bar:3.0 at 1 mm", "bar:1.5 at 1 mm"):
        stimulus = stimuli[title]
        centre = int(np.argmin(np.abs(stimulus.receptor_mm)))
        for measure, wanted in (("ep1", True), ("ep3", True), ("sed", True), ("e13", False)):
            verdict = shape_test(stimulus.indentor, stimulus.x_mm, stimulus.ssrp(measure, centre))
            assert verdict is not None
            size = verdict.judged_by["second"] / verdict.judged_by["range"]
            source = f"{measure} at 0: {'peak, dip, peak' if wanted else 'not peak, dip, peak'}"
            ours = f"second prominence {100 * size:.0f} % of the range"
            yield Fact(f"6, {title}", source, ours, verdict.passed == wanted)
    for shape, expected in (("bar:3.0", 2), ("cylinder:3", 1), ("cylinder:9", 1)):
        n = maxima(fine.indent(shape, 0.0, doi_mm=1.33).receptor_measures["sed"])
        yield Fact(f"6, {shape} at 1.33 mm", f"SED: {expected} peak(s)", f"{n}", n == expected)


def _pressure(k: Constants) -> Fact:
    agrees = min(k) > 0
    return Fact("7", "P = K2·(d − d0) + K3·C inside the contact, all K > 0", told(k), agrees)


def maxima(profile: Array) -> int:
    """How many maxima stand out."""
    return len(find_peaks(profile, prominence=_COUNTS * float(np.ptp(profile)))[0])
