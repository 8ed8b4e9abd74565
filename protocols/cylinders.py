"""A cylinder along the finger, pressed at one position or over a range, to a series of depths or to one force."""

from typing import Literal

from rig.protocol import Field, RangeParameters, Rig

METADATA = {
    "title": "Cylinder on the center of the pad",
    "source": "Raju 1998, ch. 4: cylinders 3 and 9 mm in diameter at DOI 0.33, 1.0 and 1.33, and at equal force",
}

DEPTHS_MM = (0.33, 1.0, 1.33)


class Parameters(RangeParameters):
    """Parameters that `--set` can change."""

    diameter_mm: Literal["3", "9"] = "9"
    x_mm: float = Field(0.0, ge=-3, le=3, description="position if no range is given, in mm")
    force_gwt: float | None = Field(None, gt=0, le=50, description="force that replaces the depths, in gwt")
    hold_s: float = Field(1.0, ge=0, le=60)


def run(rig: Rig) -> None:
    """Mount, home, zero; then press at each position to every depth, or once to a force."""
    p = rig.parameters
    rig.mount(f"cylinder:{p.diameter_mm}")
    rig.home()
    rig.zero()
    for x_mm in p.positions((p.x_mm,)):
        rig.move_to(x_mm=x_mm)
        press(rig, p)


def press(rig: Rig, p: Parameters) -> None:
    """Press to the force if one is given, else to each depth."""
    if p.force_gwt is not None:
        rig.indent(force_gwt=p.force_gwt, hold_s=p.hold_s)
        return
    for doi_mm in DEPTHS_MM:
        rig.indent(doi_mm=doi_mm, hold_s=p.hold_s)
