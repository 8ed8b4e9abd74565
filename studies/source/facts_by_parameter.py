"""How the facts of Raju (1998, ch. 4) come out, and how they move with the free parameters.

    .venv/bin/python -m studies.source.facts_by_parameter    # docs/validation/model_facts.md; some minutes

Peaks are nodal pressures in the receptor plane, raw and after the source's 4×1 median filter (values resampled
linearly to 170 µm, mean of the middle two of four). Fact 4 is read at receptors 0.15 mm apart, 0.75 mm deep. Nothing
here is tuned: it prints what comes out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from rig.compare.shape_test import shape_test
from sim.config import MESH_LEVELS, FingertipConfig, MeshSpec, Tissue
from sim.contact.profiles import BAR_EDGE_RADIUS_MM, Bar
from sim.models.fingertip import Fingertip
from sim.models.result import median_of_four
from studies.source.printed.bars import edge_ratios, in_words
from studies.source.simulated_stimuli import bars as simulated_bars

STEP_POSITIONS_MM = (2.0, 1.5, 1.0, 0.5, *np.arange(0.17, -2.6, -0.17).round(2), -2.75, -3.0, -3.25, -3.5, -3.69)
BAR_DOIS_MM = (0.33, 0.67, 1.0, 1.33)
FACT_4_X_MM = np.arange(-2.4, 1.3, 0.15).round(2).tolist()
FACT_4_DEPTH_MM = 0.75
DIPPING = ("ep1", "ep3", "sed")
"""Of which the source sees a dip under bars; it blames its mesh for the shallow one under the narrow bar."""

PROMINENT = 0.05
"""Peaks count when they stand out by this share of the range, as in the source's bars."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Facts:
    """What the facts turn on, for one model."""

    bar_edges: tuple[str, ...]  # which edges are touched at the four DOIs
    step1_peak: tuple[float, float, float]  # raw, at x, filtered
    step1_two_regions: tuple[float, float]  # first and last x with two regions
    step1_start_end: tuple[float, float]  # peak on the flat, before and after
    step5_peak: float
    step5_regions: int
    sed_peaks: tuple[str, str]  # under step 1 at −1.63: DOI 0.73, 2.33 gwt
    s33_peaks: tuple[str, str]


def peaks(values: Array) -> Array:
    """Prominences of the peaks of a curve over its range, the highest first."""
    prominence = find_peaks(values, prominence=0)[1]["prominences"] / np.ptp(values)
    return np.sort(prominence)[::-1]


def counted(values: Array) -> str:
    """How many peaks are prominent, and how prominent the second one is."""
    found = peaks(values)
    second = f" ({found[1]:.0%})" if len(found) > 1 else ""
    return f"{(found > PROMINENT).sum()}{second}"


def load(config: FingertipConfig) -> Fingertip:
    """A fingertip with the receptors of fact 4."""
    return Fingertip.load(config, receptor_x_mm=FACT_4_X_MM, receptor_depth_mm=FACT_4_DEPTH_MM)


def collect(finger: Fingertip, edge_radius_mm: float = BAR_EDGE_RADIUS_MM) -> Facts:
    """Run the source's scenes."""
    bars = [finger.indent(Bar(3.0, edge_radius_mm), 0.0, doi_mm=doi) for doi in BAR_DOIS_MM]
    steps = {n: [finger.indent(f"step:{n}", x, force_gwt=2.33) for x in STEP_POSITIONS_MM] for n in "15"}
    deep, light = finger.indent("step:1", -1.63, doi_mm=0.73), finger.indent("step:1", -1.63, force_gwt=2.33)
    everything = (*bars, *steps["1"], *steps["5"], deep, light)
    if not all(r.state.converged for r in everything):
        raise RuntimeError("a contact did not converge")
    raw = [float(r.pressure_profile[1].max()) for r in steps["1"]]
    filtered = [float(median_of_four(*r.pressure_profile).max()) for r in steps["1"]]
    two = [r.x_mm for r in steps["1"] if len(r.contact_regions_mm) > 1]
    best = int(np.argmax(raw))
    return Facts(
        tuple(in_words(*edge_ratios(r, 1.5)) for r in bars),
        (raw[best], STEP_POSITIONS_MM[best], max(filtered)),
        (max(two, default=np.nan), min(two, default=np.nan)),
        (raw[0], raw[-1]),
        max(float(r.pressure_profile[1].max()) for r in steps["5"]),
        max(len(r.contact_regions_mm) for r in steps["5"]),
        (counted(deep.receptor_measures["sed"]), counted(light.receptor_measures["sed"])),
        (counted(-deep.receptor_measures["s33"]), counted(-light.receptor_measures["s33"])),
    )


def row(name: str, f: Facts) -> str:
    """One line of the Markdown table."""
    return (
        f"| {name} | {'; '.join(f.bar_edges)} | {f.step1_peak[0]:.0f} at {f.step1_peak[1]:.2f} "
        f"({f.step1_peak[2]:.0f}) | {f.step1_two_regions[0]:.2f} … {f.step1_two_regions[1]:.2f} | "
        f"{f.step1_start_end[0]:.1f}, {f.step1_start_end[1]:.1f} | {f.step5_peak:.0f}, {f.step5_regions} | "
        f"{', '.join(f.sed_peaks)} | {', '.join(f.s33_peaks)} |"
    )


def dips(level: str) -> list[tuple[str, ...]]:
    """Mesh, bar, and how far the second maximum stands out at receptor 0 under bars, as a part of the range."""
    found = []
    for stimulus in simulated_bars(Fingertip.load(FingertipConfig.model_validate({"mesh": {"level": level}}))):
        centre = int(np.argmin(np.abs(stimulus.receptor_mm)))
        verdicts = [shape_test(stimulus.indentor, stimulus.x_mm, stimulus.ssrp(m, centre)) for m in DIPPING]
        parts = [v.judged_by["second"] / v.judged_by["range"] for v in verdicts if v is not None]
        found.append((level, stimulus.indentor, *(f"{part:.0%}" for part in parts)))
    return found


def main() -> None:
    """Print the tables."""
    columns = ("model", "bar 3.0 edges at DOI 0.33, 0.67, 1.0, 1.33", "step 1 peak at x (filtered)",
               "step 1 two regions, x", "flat before, after", "step 5 peak, regions",
               "SED peaks (second), DOI 0.73, 2.33 gwt", "s33 peaks (second)")  # fmt: skip
    print(f"| {' | '.join(columns)} |")
    print("|---|---|---|---|---|---|---|---|")
    default = load(FingertipConfig())
    print(row("default", collect(default)), flush=True)
    print(row("bar edge radius × ½", collect(default, 0.5 * BAR_EDGE_RADIUS_MM)), flush=True)
    tissue = Tissue()
    for name, config in {
        "epidermis − 25 %": FingertipConfig(tissue=Tissue(epidermis_mm=0.75 * tissue.epidermis_mm)),
        "epidermis + 25 %": FingertipConfig(tissue=Tissue(epidermis_mm=1.25 * tissue.epidermis_mm)),
        "bone − 20 %": FingertipConfig(tissue=Tissue(bone_fraction=0.8 * tissue.bone_fraction)),
        "bone + 20 %": FingertipConfig(tissue=Tissue(bone_fraction=1.2 * tissue.bone_fraction)),
        "bone elastic, held at z = 0": FingertipConfig(tissue=Tissue(bone="elastic")),
        "mesh 0.22 mm": FingertipConfig(mesh=MeshSpec(spacing_mm=0.22)),
        "mesh 0.14 mm": FingertipConfig(mesh=MeshSpec(spacing_mm=0.14)),
    }.items():
        print(row(name, collect(load(config))), flush=True)
    print(f"\n| mesh | bar | {' | '.join(DIPPING)} |\n|{'---|' * (2 + len(DIPPING))}")
    for level in MESH_LEVELS:
        for cells in dips(level):
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
