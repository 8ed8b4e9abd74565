"""`rig bench`: speed against error on this machine, as one page."""

import os
import platform
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from rig.cli.options import JsonOption, checked_file
from rig.cli.output import err, out, print_json, told_in_one_line
from rig.report.speed_page import page
from sim import benchmark
from sim.benchmark import QUANTITIES, QUICK, QUICK_SCENES, SCENES, WHOLE, Measured, measure, reference_s, rows, stored

_STEPS = ("mesh", "assembly", "condensation", "inverse", "receptors")


def command(
    quick: Annotated[bool, typer.Option("--quick", help="Coarse meshes only: about a minute.")] = False,
    page_file: Annotated[Path, typer.Option("--out", metavar="HTML", help="The page to write.")] = Path("bench.html"),
    as_json: JsonOption = False,
) -> None:
    """Measure every model, element and refinement in a process of its own, and write the page."""
    with told_in_one_line(as_json=as_json):
        checked_file("--out", page_file)
        start = time.perf_counter()
        reference = stored()
        measured = []
        for found in measure(QUICK if quick else WHOLE, QUICK_SCENES if quick else SCENES):
            measured.append(found)
            err.print(f"{_name(found)}: {found.nodes} nodes, {found.build_s:.1f} s, {found.memory_mb:.0f} MB")
        table, unit_s = list(rows(measured, reference)), reference_s()
        text = page(
            table,
            machine=f"{platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}",
            wall_s=time.perf_counter() - start,
            quick=quick,
            quantities=QUANTITIES,
            reference=reference,
            reference_s=unit_s,
            steps=_STEPS,
            breakdown=[_breakdown(found) for found in measured if found.candidate.model == "finger"],
            **_calculix(quick=quick),
        )
        page_file.write_text(text, encoding="utf-8")
        if as_json:
            print_json({"rows": table, "page": str(page_file), "reference_s": unit_s})
        else:
            out.print(f"{page_file}: {len(measured)} candidates, {time.perf_counter() - start:.0f} s")
            out.print(f"the reference computation: {unit_s:.3f} processor seconds")


def _name(found: Measured) -> str:
    return f"{found.candidate.model} {found.candidate.element} {found.candidate.refinement}"


def _breakdown(found: Measured) -> dict[str, Any]:
    return {
        "name": _name(found),
        "timing": found.timing_s,
        "factor_s": found.factor_s,
        "contact_s": found.contact_s,
        "limit_s": found.limit_s,
    }


def _calculix(*, quick: bool) -> dict[str, Any]:
    if quick:
        return {"calculix": None, "no_calculix": "Left out by --quick."}
    if not benchmark.available():
        return {"calculix": None, "no_calculix": "There is no ccx here (Debian: apt-get install calculix-ccx)."}
    return {"calculix": asdict(benchmark.compare()), "no_calculix": ""}
