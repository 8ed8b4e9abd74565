"""`rig dry-run`: a protocol on the virtual bench."""

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.carrying_out import carry_out, leave, new_run
from rig.cli.options import (
    FingerConfigOption,
    JsonOption,
    MetFingerOption,
    MoreArgument,
    OutOption,
    ProtocolArgument,
    SetOption,
    SubjectOption,
)
from rig.cli.output import Beginning, complain, told_in_one_line
from rig.cli.run_owner import owning
from rig.plan.config import load_config, with_finger
from rig.protocol.errors import BadInputError
from rig.protocol.script import load_script
from rig.session.calibration import expired_calibrations
from rig.session.session import dry_run
from rig.session.virtual.twins import refuse_twinless


def command(
    protocol: ProtocolArgument,
    more: MoreArgument = None,
    set_: SetOption = None,
    config: FingerConfigOption = None,
    finger_file: MetFingerOption = None,
    out_dir: OutOption = Path("runs"),
    speed: Annotated[str, typer.Option(metavar="max|N", help="Virtual seconds per real second.")] = "max",
    subject: SubjectOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check the script, run it on the virtual bench, write the run folder and its report."""
    beginning = Beginning(aloud=False)
    with told_in_one_line(as_json=as_json, beginning=beginning):
        settings = with_finger(load_config(config), finger_file)
        refuse_twinless(settings.stage, settings.force)
        for problem in expired_calibrations(settings):
            complain(f"warning: {problem}; `rig run` would refuse")
        script = load_script(protocol, [*(set_ or []), *(more or [])])
        faster = _times_real(speed)
        into = new_run(out_dir, subject)
        with owning(script, settings, into, config_file=config) as owner:
            done = carry_out(
                script,
                settings,
                into,
                lambda session: dry_run(session, faster),
                owner,
                as_json=as_json,
                pace=None if faster is None else 1 / faster,
                begins=beginning.begins,
            )
    leave(done)


def _times_real(text: str) -> float | None:
    if text == "max":
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e6:
        raise BadInputError(
            "{option} {value!r}: expected max or a positive number", code="bad_value", option="--speed", value=text
        )
    return value
