"""A few light presses at the center of the pad, for the first run of a new rig on a rubber ball."""

from rig.protocol import Field, ProtocolParameters, Rig

METADATA = {"title": "First presses", "source": "docs/first_light.md"}


class Parameters(ProtocolParameters):
    """Parameters that `--set` can change."""

    indentor: str = Field("bar:3.0", description="mounted indentor, as in `rig indent`")
    force_gwt: float = Field(1.0, gt=0, le=5)
    presses: int = Field(3, ge=1, le=20)
    hold_s: float = Field(0.5, ge=0, le=60)


def run(rig: Rig) -> None:
    """Mount, home, zero; then press repeatedly to the same force at the same position."""
    p = rig.parameters
    rig.mount(p.indentor)
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    for _ in range(p.presses):
        rig.indent(force_gwt=p.force_gwt, hold_s=p.hold_s)
