"""A step moved across the pad."""

from rig.protocol import Field, ProtocolParameters, Rig

METADATA = {"title": "My first experiment", "source": "the tutorial"}


class Parameters(ProtocolParameters):
    force_gwt: float = Field(4.0, gt=0, le=20)


def run(rig: Rig) -> None:
    rig.mount("step:1")
    rig.home()
    rig.zero()
    for x_mm in (1.0, 0.5, 0.0, -0.5, -0.75, -1.0, -1.25, -1.5, -2.0, -2.5, -3.0):
        rig.move_to(x_mm=x_mm)
        rig.indent(force_gwt=rig.parameters.force_gwt, hold_s=1.0)
