"""`rig study`: the same presses on many fingers, over processes or a cluster."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from rig.cli.options import ExactOption, JsonOption, checked_file, option
from rig.cli.output import out, print_json, writes_json
from rig.cli.progress import counted
from rig.cli.request import takes
from rig.data.folder import replace_table
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


@dataclass(frozen=True)
class StudyRequest:
    """Arguments and options of `rig study`."""

    study: Annotated[Path, typer.Argument(metavar="TOML", help="Study file: the parameters to vary and the presses.")]
    out_file: Annotated[
        Path | None, option("Table to write. Default: beside the study file.", "CSV", name="--out")
    ] = None
    processes: Annotated[
        int | None, option("Number of processes on this machine. Default: number of cores.", "N", min=1)
    ] = None
    scheduler: Annotated[
        str | None,
        option(
            "Address of a dask.distributed scheduler (needs the extra cluster). Default: this machine.", "ADDRESS"
        ),
    ] = None
    exact: ExactOption = False
    as_json: JsonOption = False


@takes(StudyRequest)
def command(request: StudyRequest) -> None:
    """Solve every case and write one tidy table."""
    began = time.perf_counter()
    cases = read_study(request.study)
    table = request.study.with_suffix(".csv") if request.out_file is None else request.out_file
    checked_file("--out", table, ".csv")
    if not request.exact:
        cases = interpolated(cases)
    nodes = nodes_to_build(cases)
    workers = (request.processes, request.scheduler)
    for _ in counted(spread(make_node, nodes, *workers), len(nodes), "full builds"):
        pass
    answers = list(counted(spread(solve, cases, *workers), len(cases), "cases"))
    rows = [row for answer in answers for row in answer]
    names = columns(cases)
    replace_table(table, names, ([row.get(name) for name in names] for row in rows))
    problems = sum(bool(row["problem"]) for row in rows)
    between = sum(row.get("model") == INTERPOLATED for row in rows)
    small = _small_strain(cases, answers)
    seconds = time.perf_counter() - began
    if writes_json():
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
