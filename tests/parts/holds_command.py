"""A command that is not there, `rig holds`: what a run held."""

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.options import JsonOption
from rig.cli.output import one_line_errors, out, print_json
from rig.data import read_run


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The run's folder.")], as_json: JsonOption = False
) -> None:
    """Print the forces, gwt."""
    with one_line_errors(as_json=as_json):
        force_gwt = [hold["force_gwt"] for hold in read_run(run).stream("hold_end")]
        if as_json:
            print_json({"force_gwt": force_gwt})
        else:
            out.print(" ".join(f"{force:.2f}" for force in force_gwt))
