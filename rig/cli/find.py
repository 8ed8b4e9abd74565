"""`rig find`: where the finger lies, from the touches of a run."""

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.options import JsonOption
from rig.cli.output import complain, loading_the_finger, out, print_json, told_in_one_line
from rig.data import read_run
from rig.plan.config import load_config
from rig.plan.find import find
from sim.models.fingertip import Fingertip

_LARGEST_TURN_DEG = 3.0


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run that touched at several places.")],
    as_json: JsonOption = False,
) -> None:
    """Fit pad centre, height, roll and tilt to the touches; print [frame] for the configuration."""
    with told_in_one_line(as_json=as_json):
        recorded, settings = read_run(run), load_config(run / "config.toml")
        with loading_the_finger():
            finger = Fingertip.load(settings.finger)
        lie = find(recorded, settings, finger)
        if as_json:
            found = {"value": lie.value, "sd": lie.sd, "correlation": lie.correlation.tolist()}
            print_json({**found, "residual_mm": lie.residual_mm, "touches": lie.touches, "toml": lie.as_toml()})
        else:
            out.print(f"{lie.touches} touches, {1000 * lie.residual_mm:.1f} µm off the finger\n\n{lie.as_toml()}")
        for name in ("roll_deg", "tilt_deg"):
            turned, sd = lie.value.get(name, 0.0), lie.sd.get(name, 0.0)
            if abs(turned) > max(_LARGEST_TURN_DEG, 2 * sd):
                complain(f"{name} = {turned:.1f}: the stage cannot turn the finger, turn its holder by that")
