"""A grating stepped across the pad over whole pitches, or over a range, pressed at each position to one force."""

from rig.protocol import Field, RangeParameters, Rig, about_the_centre
from rig.protocol.schedule import SPACING_MM

METADATA = {
    "title": "Grating stepped across the pad",
    "source": "Whole gratings, which Raju 1998 could not afford; ridge and pitch are free",
}


class Parameters(RangeParameters):
    """Parameters that `--set` can change."""

    ridge_mm: float = Field(0.75, ge=0.15, le=10)
    pitch_mm: float = Field(1.5, ge=0.2, le=20)
    periods: float = Field(
        3.0, gt=0, le=10, description="number of pitches about the center of the pad, if no range is given"
    )
    force_gwt: float = Field(8.0, gt=0, le=50)
    hold_s: float = Field(1.0, ge=0, le=60)


def run(rig: Rig) -> None:
    """Mount, home, zero; then make one force-controlled indentation at each position."""
    p = rig.parameters
    rig.mount(f"grating:{p.ridge_mm:g},{p.pitch_mm:g}")
    rig.home()
    rig.zero()
    for x_mm in p.positions(about_the_centre(round(p.periods * p.pitch_mm / SPACING_MM) + 1)):
        rig.move_to(x_mm=x_mm)
        rig.indent(force_gwt=p.force_gwt, hold_s=p.hold_s)
