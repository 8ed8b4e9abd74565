"""A line load across the finger, pressed in the receptor plane to a series of depths."""

from rig.protocol import Field, ProtocolParameters, Rig

METADATA = {
    "title": "Line load across the finger",
    "source": "Raju 1998, ch. 4: a thin bar across the finger at 0.5, 1, 1.5 and 2 mm, for the skin's deflection",
}

DEPTHS_MM = (0.5, 1.0, 1.5, 2.0)


class Parameters(ProtocolParameters):
    """Parameters that `--set` can change."""

    deepest_mm: float = Field(
        1.5, ge=0.5, le=2.0, description="largest depth, in mm; 2.0 also requires limits.max_doi_mm = 2.0"
    )
    hold_s: float = Field(1.0, ge=0, le=60)


def run(rig: Rig) -> None:
    """Mount, home, zero; then make one indentation to each depth."""
    p = rig.parameters
    rig.mount("line")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    for doi_mm in DEPTHS_MM:
        if doi_mm <= p.deepest_mm:
            rig.indent(doi_mm=doi_mm, hold_s=p.hold_s)
