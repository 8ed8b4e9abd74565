"""A sinusoidal step moved across the finger pad from +x to −x, pressed at each position to one force."""

from typing import Literal

from rig.protocol import Field, RangeParameters, Rig, ScheduledParameters

METADATA = {
    "title": "Step moved laterally across the pad",
    "source": "Raju 1998, ch. 5: about 20 positions, 170 µm apart while the flank is near the pad's center",
}

# Fine where the flank passes under the pad, wide outside; step 5 is long, so its schedule is wider.
POSITIONS_MM = {
    "1": (2.0, 1.5, 1.0, 0.5, 0.17, 0.0, -0.17, -0.34, -0.51, -0.68, -0.85, -1.02, -1.19, -1.36, -1.63, -1.8,
          -1.97, -2.25, -2.75, -3.25, -3.69),
    "3": (2.0, 1.5, 1.0, 0.5, 0.17, 0.0, -0.17, -0.34, -0.51, -0.68, -0.85, -1.02, -1.19, -1.36, -1.63, -1.8,
          -1.97, -2.25, -2.75, -3.25, -3.69, -4.2),
    "5": (2.5, 2.0, 1.5, 1.0, 0.5, 0.0, -0.34, -0.68, -1.02, -1.36, -1.63, -1.97, -2.31, -2.65, -2.99, -3.33,
          -3.69, -4.2, -4.7, -5.2, -5.7),
}  # fmt: skip


class Parameters(ScheduledParameters, RangeParameters):
    """Parameters that `--set` can change."""

    step: Literal["1", "3", "5"] = "1"
    force_gwt: float = Field(2.33, gt=0, le=50, description="in gwt: 2.33 as simulated in the source, 8 as recorded")
    hold_s: float = Field(1.0, ge=0, le=60)


def run(rig: Rig) -> None:
    """Mount, home; then make one force-controlled indentation at each position of the schedule."""
    p = rig.parameters
    rig.mount(f"step:{p.step}")
    rig.home()
    for block in p.schedule(p.positions(POSITIONS_MM[p.step])).on(rig):
        if p.precondition:
            rig.move_to(x_mm=block.items[0])
            rig.precondition(presses=p.precondition, force_gwt=p.force_gwt, hold_s=p.hold_s)
        for x_mm in block:
            rig.move_to(x_mm=x_mm)
            rig.indent(force_gwt=p.force_gwt, hold_s=p.hold_s)
    rig.note("schedule finished")
