"""`rig study`: the same presses on many fingers, over processes or a cluster."""

import csv
import io
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import track

from rig.cli.options import JsonOption, checked_file
from rig.cli.output import err, out, print_json, told_in_one_line
from rig.data.folder import replace_text
from rig.parameter_study.cases import Row, columns, read_study, solve
from rig.parameter_study.workers import spread


def command(
    study: Annotated[Path, typer.Argument(metavar="TOML", help="What is varied and what is pressed.")],
    out_file: Annotated[Path | None, typer.Option("--out", metavar="CSV", help="The table; beside the TOML.")] = None,
    processes: Annotated[
        int | None, typer.Option(metavar="N", help="On this machine; as many as cores.", min=1)
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a dask.distributed cluster; needs the extra cluster.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Solve every case and write one tidy table."""
    with told_in_one_line(as_json=as_json):
        began = time.perf_counter()
        cases = read_study(study)
        table = study.with_suffix(".csv") if out_file is None else out_file
        checked_file("--out", table)
        answers = track(
            spread(solve, cases, processes, scheduler), "cases", len(cases), console=err, disable=not err.is_terminal
        )
        rows = [row for answer in answers for row in answer]
        replace_text(table, _as_csv(columns(cases), rows))
        problems = sum(bool(row["problem"]) for row in rows)
        seconds = time.perf_counter() - began
        if as_json:
            print_json({"table": str(table), "cases": len(cases), "rows": len(rows), "problems": problems,
                        "seconds": seconds})  # fmt: skip
        else:
            out.print(f"{len(cases)} cases, {len(rows)} rows, {problems} without an answer, {seconds:.1f} s\n{table}")


def _as_csv(names: list[str], rows: list[Row]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
