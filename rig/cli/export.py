"""`rig export`: a run's journal as tables."""

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.options import JsonOption
from rig.cli.output import out, print_json, told_in_one_line
from rig.data import export_nwb, export_run, read_run
from rig.protocol.errors import BadInputError


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    as_csv: Annotated[bool, typer.Option("--csv", help="HDF5 and tidy CSV.")] = False,
    as_nwb: Annotated[bool, typer.Option("--nwb", help="Neurodata Without Borders; needs the extra nwb.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Export again what the journal holds, also of a run that crashed, and renew the checksums."""
    with told_in_one_line(as_json=as_json):
        if not (as_csv or as_nwb):
            raise BadInputError("export: no format given, expected --csv or --nwb", code="no_format")
        found = read_run(run)
        written = []
        if as_csv:
            export_run(found)
            tables = (f"{stream}.csv" for stream in found.units if found.stream(stream))
            written += [str(found.folder.data), *(str(run / name) for name in tables)]
        if as_nwb:
            written.append(str(export_nwb(found)))
        found.folder.write_checksums()
        if as_json:
            print_json({"run": str(run), "files": written})
        else:
            out.print("\n".join(written))
