"""A rectangular bar stepped across the pad, pressed in four increments to a depth."""

from typing import Literal

from rig.protocol import Field, RangeParameters, Rig, about_the_centre

METADATA = {
    "title": "Bar stepped across the pad",
    "source": "Raju 1998, ch. 5: increments of 0.25 mm to DOI 1.0; 25 positions for 1.5 mm, 34 for 3.0 mm",
}

POSITIONS = {"1.5": 25, "3.0": 34}


class Parameters(RangeParameters):
    """Parameters that `--set` can change."""

    width_mm: Literal["1.5", "3.0"] = "3.0"
    doi_mm: float = Field(1.0, gt=0, le=1.5)
    increments: int = Field(4, ge=1, le=20)
    hold_s: float = Field(1.0, ge=0, le=60)


def run(rig: Rig) -> None:
    """Mount, home, zero; then make four recorded holds at each position, 170 µm apart or over a range."""
    p = rig.parameters
    rig.mount(f"bar:{p.width_mm}")
    rig.home()
    rig.zero()
    for x_mm in p.positions(about_the_centre(POSITIONS[p.width_mm])):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=p.doi_mm, increments=p.increments, hold_s=p.hold_s)
