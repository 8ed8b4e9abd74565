"""A sphere's touch, then a bar by force and by depth, in two blocks with all that a schedule has."""

from rig.protocol import Field, ScheduledParameters

METADATA = {"title": "Everything a script may ask for", "source": "tests/data/runs"}


class Parameters(ScheduledParameters):
    force_gwt: float = Field(1.0, gt=0, le=5)


def run(rig):
    p = rig.parameters
    rig.mount("sphere:2")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.5, along_mm=0.5)
    rig.note(f"contact at {rig.touch():.3f} mm")
    rig.mount("bar:3.0")
    for block in p.schedule((-0.5, 0.5)).on(rig):
        if p.precondition:
            rig.move_to(x_mm=0.0)
            rig.precondition(presses=p.precondition, force_gwt=p.force_gwt, hold_s=0.1)
        for x_mm in block:
            rig.move_to(x_mm=x_mm)
            found = rig.indent(force_gwt=p.force_gwt, hold_s=0.2)
            rig.indent(doi_mm=round(0.8 * found.holds[-1].doi_mm, 3), increments=2, speed_mm_s=0.5, hold_s=0.1)
            rig.retract()
    rig.note("finished")
