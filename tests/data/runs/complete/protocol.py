"""A bar pressed to a depth at five positions."""

from rig.protocol import Field, ProtocolParameters

METADATA = {"title": "Bar at five positions", "source": "tests/data/runs"}


class Parameters(ProtocolParameters):
    doi_mm: float = Field(0.4, gt=0, le=1.5)


def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (3.0, 1.5, 0.0, -1.5, -3.0):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=rig.parameters.doi_mm, hold_s=0.2)
