"""Run `rig bench`, and make the table and the figure of docs/validation/performance.md."""

import json
import subprocess
import sys
from typing import Any

import numpy as np

from rig.report.benchmark_page import pareto
from studies.registry import DOCS, ROOT, show

FAMILIES = {"smooth": "smooth", "bar": "bars", "step": "step 1"}
QUANTITIES = {"force": "force", "width": "width", "sed": "SED", "ep1": "ep1"}


def largest(rows: list[dict[str, Any]], family: str, quantity: str) -> str:
    """Largest error in per cent, or a dash."""
    found = [row["error"] for row in rows if (row["family"], row["quantity"]) == (family, quantity)]
    return f"{100 * max(found):.1f}" if found else "–"


def table(rows: list[dict[str, Any]]) -> None:
    """Print a line for each candidate."""
    head = ["model, element", "mesh", "nodes", "from nothing (s)", "contact (ms)", "memory (MB)"]
    head += [f"{name}: {' / '.join(QUANTITIES.values())} (%)" for name in FAMILIES.values()]
    lines = []
    for model, element, mesh, nodes in dict.fromkeys(
        (row["model"], row["element"], row["refinement"], row["nodes"]) for row in rows
    ):
        mine = [r for r in rows if (r["model"], r["element"], r["refinement"]) == (model, element, mesh)]
        costs = {key: float(np.median([row[key] for row in mine])) for key in ("total_s", "contact_s", "memory_mb")}
        errors = [" / ".join(largest(mine, family, quantity) for quantity in QUANTITIES) for family in FAMILIES]
        cells = [f"{costs['total_s']:.1f}", f"{1e3 * costs['contact_s']:.0f}", f"{costs['memory_mb']:.0f}"]
        lines.append([f"{model} {element}", mesh, str(nodes), *cells, *errors])
    show(head, lines)


def main() -> None:
    """Print the table, write the figure."""
    page = ROOT / "build" / "bench.html"
    page.parent.mkdir(exist_ok=True)
    bench = [sys.executable, "-m", "rig", "bench", "--json", "--out", str(page)]
    rows = json.loads(subprocess.run(bench, stdout=subprocess.PIPE, check=True).stdout)["rows"]
    (DOCS / "figures" / "pareto.png").write_bytes(pareto(rows).png)
    table(rows)


if __name__ == "__main__":
    main()
