"""Make the tables and the figure of `docs/validation/small_strain.md`, and `sim/data/small_strain.json`.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.finite_strain.tables [FOLDER]    # default: study/finite_strain

Presses what FOLDER has not yet (an hour of processor time from nothing, each press written when it is done), has
CalculiX confirm it where that is installed, and writes what is small enough to keep beside this module in `kept/`.
"""

import csv
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rig.data.folder import replace_text
from studies.finite_strain import confirmed, states, worlds
from studies.finite_strain.curves_figure import write_figure
from studies.finite_strain.judged import Profiles, WorldVerdicts, among, profiles, ranks, verdicts
from studies.finite_strain.ratios import COLUMNS, Ratio, envelope, ratios

KEPT = Path(__file__).parent / "kept"
NOTE = Path(__file__).parents[2] / "sim" / "data" / "small_strain.json"
FIGURE = Path(__file__).parents[2] / "docs" / "figures" / "small_strain.svg"
COMMAND = "python -m studies.finite_strain.tables"

SAID = {"finger": ("finger 0.35", 5), "section": ("section 0.17", 4)}
"""The mesh behind the note of each kind, and how many shapes must have reached a depth for it to be said."""

_TARGETS = tuple(f"{force:g} gwt" for force in worlds.FORCES_GWT)


def main(folder: str = "study/finite_strain") -> None:
    """Press, confirm, keep and print."""
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    states.main(str(place / "states.jsonl"))
    worlds.main(str(place / "worlds.jsonl"))
    confirmed.main(str(KEPT / "calculix.jsonl"))
    keep(list(ratios(states.read(place / "states.jsonl"))), worlds.read(place / "worlds.jsonl"))
    found = kept_ratios()
    write_figure(found, FIGURE)
    for line in markdown(found, json.loads((KEPT / "verdicts.json").read_text("utf-8"))):
        print(line)


def keep(found: Sequence[Ratio], rows: Sequence[Mapping[str, Any]]) -> None:
    """Ratios as CSV, verdicts as JSON, and the note's curves."""
    lines = [",".join(COLUMNS), *(",".join(one.row) for one in found)]
    replace_text(KEPT / "ratios.csv", "\n".join(lines) + "\n")
    replace_text(KEPT / "verdicts.json", json.dumps(judged(rows), ensure_ascii=False, indent=1) + "\n")
    curves = {kind: envelope(kept_ratios(), mesh, fewest) for kind, (mesh, fewest) in SAID.items()}
    provenance = {
        "command": COMMAND,
        "force, sed": "linear over finite strain, less one; least and most of the shapes; sed the highest receptor's",
        "shapes": "cylinder:9, flat, step:1 and bar:3.0 at x = 0, of a finger sphere:3 too; nu 0.48",
        "tissue": "neo-Hookean layers with the model's small-strain moduli",
        "meshes": {mesh: states.MESHES[mesh] for mesh, _ in SAID.values()},
        "equilibria confirmed by": "CalculiX 2.20: studies/finite_strain/kept/calculix.jsonl",
    }
    replace_text(NOTE, as_lines({"provenance": provenance, "curves": curves}))


def as_lines(kept: Mapping[str, Any]) -> str:
    """JSON with a line for each depth."""
    parts = [
        f' "{kind}": [\n' + ",\n".join(f"  {json.dumps(row)}" for row in rows) + "\n ]"
        for kind, rows in kept["curves"].items()
    ]
    provenance = json.dumps(kept["provenance"], ensure_ascii=False)
    return f'{{\n"provenance": {provenance},\n"curves": {{\n' + ",\n".join(parts) + "\n}\n}\n"


def kept_ratios() -> list[Ratio]:
    """Those in the repository."""
    with (KEPT / "ratios.csv").open(encoding="utf-8", newline="") as file:
        return [Ratio.of(row) for row in csv.DictReader(file)]


def judged(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each world's verdicts at each force beside those of the default of its kind, where all was pressed."""
    names = [name for name in worlds.WORLDS if any(row["world"] == name for row in rows)]
    found = {name: profiles(rows, name) for name in names}
    return [_judged(name, found, target) for name in names for target in _TARGETS if _complete(found[name], target)]


def _complete(found: Profiles, target: str) -> bool:
    try:
        verdicts(found, target)
    except KeyError:
        return False
    return True


def _judged(name: str, found: Mapping[str, Profiles], target: str) -> dict[str, Any]:
    base = among(found[name.partition(",")[0]], found[name])
    here, there = verdicts(found[name], target), verdicts(base, target)
    same, cells = _alike(here, there)
    placed = [one._asdict() for one in ranks(found[name], base, target)]
    return {
        "world": name, "force": target, "survivors": here.survivors, "candidates": here.candidates,
        "cells_alike": same, "cells": cells, "presses": {s: len(x) for (s, _), (x, _) in found[name].items()},
        "ranks": [{k: round(v, 4) if isinstance(v, float) else v for k, v in one.items()} for one in placed],
    }  # fmt: skip


def _alike(here: WorldVerdicts, there: WorldVerdicts) -> tuple[int, int]:
    same = sum(int((here.flags[shape] == there.flags[shape]).sum()) for shape in here.flags)
    return same, sum(flags.size for flags in here.flags.values())


def markdown(found: Sequence[Ratio], judgements: Sequence[Mapping[str, Any]]) -> list[str]:
    """The tables as the docs have them."""
    lines = [
        "| mesh | shape | ν | DOI | force | width | peak | SED | ep1 | r of ep1, ep3, SED |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in found:
        r = ", ".join(f"{one.r[name]:.3f}" for name in ("ep1", "ep3", "sed"))
        off = " | ".join(f"{100 * (v - 1):+.1f}" for v in (one.force, one.width, one.peak, one.sed))
        lines.append(
            f"| {one.mesh} | {one.shape} | {one.poisson:g} | {one.doi_mm:g} | {off} | "
            f"{one.ep1_linear:.3f} → {one.ep1_finite:.3f} | {r} |"
        )
    lines += [
        "",
        "| world | force | survive steps and bars | cells alike | rank of ep1, ep3, SED |",
        "|---|---|---|---|---|",
    ]
    for row in judgements:
        placed = ", ".join(f"{one['rank']} ({one['r']:.3f})" for one in row["ranks"])
        named = ", ".join(row["candidates"]) or "none"
        lines.append(
            f"| {row['world']} | {row['force']} | {named} | {row['cells_alike']} of {row['cells']} | {placed} |"
        )
    return lines


if __name__ == "__main__":
    main(*sys.argv[1:])
