"""Step 1 at four positions, each pressed to a low and to a high force."""

from rig.protocol import Field, ProtocolParameters, Rig

METADATA = {
    "title": "Step 1 at two forces",
    "source": "Raju 1998, ch. 5: 2.33 gwt as simulated and 8 gwt as recorded, at four positions",
}

POSITIONS_MM = (2.0, -1.63, -2.25, -3.69)


class Parameters(ProtocolParameters):
    """Parameters that `--set` can change."""

    low_gwt: float = Field(2.33, gt=0, le=50)
    high_gwt: float = Field(8.0, gt=0, le=50)
    hold_s: float = Field(1.0, ge=0, le=60)


def run(rig: Rig) -> None:
    """Mount, home, zero; then press to the low and the high force at each position."""
    p = rig.parameters
    rig.mount("step:1")
    rig.home()
    rig.zero()
    for x_mm in POSITIONS_MM:
        rig.move_to(x_mm=x_mm)
        for force_gwt in (p.low_gwt, p.high_gwt):
            rig.indent(force_gwt=force_gwt, hold_s=p.hold_s)
