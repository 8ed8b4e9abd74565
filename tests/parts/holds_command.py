"""A command that is not there, `rig holds`: what a run held."""

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.options import JsonOption
from rig.cli.output import out, print_json, reporting_errors, writes_json
from rig.data import read_run


@reporting_errors
def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The run's folder.")], as_json: JsonOption = False
) -> None:
    """Print the forces, gwt."""
    force_gwt = [hold["force_gwt"] for hold in read_run(run).stream("hold_end")]
    if writes_json():
        print_json({"force_gwt": force_gwt})
    else:
        out.print(" ".join(f"{force:.2f}" for force in force_gwt))
