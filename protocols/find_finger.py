"""Touches of a sphere at several positions, from which `rig find` locates the finger; then a light press."""

from rig.protocol import Field, ProtocolParameters, Rig

METADATA = {"title": "Finding the finger", "source": "docs/first_light.md"}


class Parameters(ProtocolParameters):
    """Parameters that `--set` can change."""

    radius_mm: float = Field(2.0, ge=0.25, le=5)
    across: int = Field(5, ge=3, le=15, description="number of positions across the finger")
    along: int = Field(5, ge=1, le=15, description="number of positions along it; 1 if the stage has no such axis")
    half_width_mm: float = Field(2.0, gt=0, le=4)
    half_length_mm: float = Field(2.0, gt=0, le=3)
    force_gwt: float = Field(1.0, gt=0, le=5)


def run(rig: Rig) -> None:
    """Mount, home, zero; touch a grid of positions, then press at the expected center of the pad."""
    p = rig.parameters
    rig.mount(f"sphere:{p.radius_mm:g}")
    rig.home()
    rig.zero()
    for i in range(p.along):
        along_mm = p.half_length_mm * (2 * i / (p.along - 1) - 1) if p.along > 1 else 0.0
        for k in range(p.across):
            rig.move_to(x_mm=p.half_width_mm * (2 * k / (p.across - 1) - 1), along_mm=along_mm)
            rig.touch()
    rig.move_to(x_mm=0.0)
    rig.indent(force_gwt=p.force_gwt, hold_s=0.5)
