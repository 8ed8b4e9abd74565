"""What the eighteen measures are, as a section of the report."""

import numpy as np

from rig.compare.comparison import Comparison
from rig.report.html import Section
from rig.report.labels import as_number, label, unit
from sim.measures.measures import MEASURES, PLOTTED_AS_MAGNITUDE
from sim.units import PSEUDO_E_EPIDERMIS

WHAT = {
    "e11": "normal strain across the finger (x)",
    "e22": "normal strain along the normal of the pulp (y)",
    "e33": "normal strain along the finger (z)",
    "e12": "shear strain between x and y, engineering (γ = s12 / G)",
    "e23": "shear strain between y and z, engineering",
    "e13": "shear strain between x and z, engineering",
    "ep1": "smallest principal strain: the largest compression in any direction",
    "ep2": "middle principal strain",
    "ep3": "largest principal strain: the largest extension in any direction",
    "s11": "normal stress across the finger (x)",
    "s22": "normal stress along the normal of the pulp (y)",
    "s33": "normal stress along the finger (z)",
    "sp1": "smallest principal stress: the most compressive",
    "sp2": "middle principal stress",
    "sp3": "largest principal stress: the least compressive",
    "mean": "mean normal stress, (s11 + s22 + s33) / 3: minus the hydrostatic pressure",
    "sed": "strain energy density, ½ σ:ε, of shape and volume together; never negative",
    "third": "third invariant of stress, det σ: the product of the principal stresses",
}
_HEADER = ("measure", "what it is", "unit", "drawn as", "here from … to, as drawn", "of the other sign")


def measures_section(comparison: Comparison, young_mpa: float) -> Section:
    """Each with its unit and sign, and its range over all receptors and positions; E of the epidermis in MPa."""
    pseudo_unit = as_number(young_mpa / PSEUDO_E_EPIDERMIS)
    return Section(
        "What the measures are",
        "At a receptor in the receptor plane: x across the finger, y out of the pulp, z along the finger, small "
        "strains. Raw values have tension (and extension) positive. Those that are compressive at almost every "
        "receptor are drawn with their sign changed, so that more compression is more; where one is not, it stays "
        "negative and is not folded over. k and ε₀ are in the sign and unit that is drawn. Stresses and energy are "
        f"in pseudo-units, of which the epidermis' E is 10 000; one pseudo-unit is {pseudo_unit} MPa here.",
        _HEADER,
        tuple(_row(comparison, m, name) for m, name in enumerate(MEASURES)),
    )


def _row(comparison: Comparison, number: int, name: str) -> tuple[str, ...]:
    values = np.concatenate([stimulus.measures[number].ravel() for stimulus in comparison.stimuli])
    turned = name in PLOTTED_AS_MAGNITUDE
    return (
        name,
        WHAT.get(name, "–"),
        unit(name),
        f"{label(name)}, as magnitude" if turned else f"{label(name)}, as it is",
        f"{as_number(float(values.min()))} … {as_number(float(values.max()))}",
        f"{100 * np.mean(values < 0):.0f} %" if turned else "",
    )
