"""`rig study`: the same presses on many fingers, over processes or a cluster."""

import csv
import io
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from rig.cli.options import ExactOption, JsonOption, checked_file
from rig.cli.output import one_line_errors, out, print_json
from rig.cli.progress import counted
from rig.data.folder import replace_text
from rig.study.parallel import spread
from rig.study.parameter_study import Case, Row, columns, interpolated, nodes_to_build, read_study, solve
from rig_shared.outputs import File, Output
from rig_shared.plural import number_of
from sim.config import FingertipConfig
from sim.models.default_finger import is_default_finger
from sim.models.interpolation import HOW_MADE, INTERPOLATED, make_node
from sim.models.small_strain_error import small_strain


class StudyJson(Output):
    """A parameter study."""

    table: File
    cases: int
    rows: int
    problems: int
    small_strain_text: str | None
    interpolated: int
    interpolation_text: str | None
    wall_s: float


def command(
    study: Annotated[
        Path, typer.Argument(metavar="TOML", help="Study file: the parameters to vary and the presses.")
    ],
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="CSV", help="Table to write. Default: beside the study file.")
    ] = None,
    processes: Annotated[
        int | None,
        typer.Option(metavar="N", help="Number of processes on this machine. Default: number of cores.", min=1),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Address of a dask.distributed scheduler (needs the extra cluster). Default: this machine.",
        ),
    ] = None,
    exact: ExactOption = False,
    as_json: JsonOption = False,
) -> None:
    """Solve every case and write one tidy table."""
    with one_line_errors(as_json=as_json):
        began = time.perf_counter()
        cases = read_study(study)
        table = study.with_suffix(".csv") if out_file is None else out_file
        checked_file("--out", table, ".csv")
        if not exact:
            cases = interpolated(cases)
        nodes = nodes_to_build(cases)
        for _ in counted(spread(make_node, nodes, processes, scheduler), len(nodes), "full builds", quiet=as_json):
            pass
        answers = list(counted(spread(solve, cases, processes, scheduler), len(cases), "cases", quiet=as_json))
        rows = [row for answer in answers for row in answer]
        replace_text(table, _as_csv(columns(cases), rows))
        problems = sum(bool(row["problem"]) for row in rows)
        between = sum(row.get("model") == INTERPOLATED for row in rows)
        small = _small_strain(cases, answers)
        seconds = time.perf_counter() - began
        if as_json:
            found: StudyJson = {
                "table": str(table), "cases": len(cases), "rows": len(rows), "problems": problems,
                "small_strain_text": small, "interpolated": between,
                "interpolation_text": HOW_MADE if between else None, "wall_s": seconds,
            }  # fmt: skip
            print_json(found)
        else:
            out.print(
                f"{number_of(len(cases), 'cases')}, {number_of(len(rows), 'rows')}, {problems} without a result, "
                f"{seconds:.1f} s\n{table}"
            )
            if small:
                out.print(small)
            if between:
                out.print(f"{number_of(between, 'rows')}: fingers {HOW_MADE}; --exact builds a full model of each")


def _small_strain(cases: Sequence[Case], answers: Sequence[Sequence[Row]]) -> str | None:
    """Return the note on small strain for the deepest result; None without a result."""
    rows = [(row, case) for case, found in zip(cases, answers, strict=True) for row in found if "doi_mm" in row]
    if not rows:
        return None
    row, case = max(rows, key=lambda one: one[0]["doi_mm"])
    finger = FingertipConfig.model_validate_json(case.config_json)
    stiffening, compared = finger.tissue.finite_stiffening, is_default_finger(finger)
    return small_strain(row["model"], row["doi_mm"], stiffening, compared=compared).note


def _as_csv(names: list[str], rows: list[Row]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
