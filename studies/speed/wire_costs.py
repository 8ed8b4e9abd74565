"""What the demo costs on each kind of wire: bench time, wall time of a press, bytes for each increment.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.speed.wire_costs [--beside FOLDER]    # half a minute a tree

--beside: another tree of the project, measured in turns with this one; the last column is this tree over that one.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parents[2]
DEMO = ("protocols/steps.py", "--set", "step=1", "force_gwt=2.33")
MODBUS = """\
[stage]
kind = "leadshine"
baud = 115200
framing = "{0}"
[force]
kind = "laumas"
baud = 115200
framing = "{0}"
"""
BENCHES = {
    "GRBL, MT-SICS": "",
    "Leadshine, Laumas, RTU": MODBUS.format("rtu"),
    "Leadshine, Laumas, TCP": MODBUS.format("tcp"),
}
ROUNDS = 3


@dataclass(frozen=True)
class DryRunCost:
    """One dry-run of the demo."""

    bench_s: float
    wall_s_a_press: float
    bytes_an_increment: float  # on the stage's wire, both ways


def measured(tree: Path, config: str) -> DryRunCost:
    """Carry the demo out in a tree of the project."""
    with tempfile.TemporaryDirectory() as folder:
        toml = Path(folder) / "bench.toml"
        toml.write_text(config, encoding="utf-8")
        words = ("-m", "rig", "dry-run", *DEMO, "--config", str(toml), "--out", folder, "--json")
        done = subprocess.run(
            [sys.executable, *words],
            cwd=tree,
            env=os.environ | {"PYTHONPATH": str(tree)},
            capture_output=True,
            check=True,
        )
        answer = json.loads(done.stdout)
        run = Path(folder, Path(answer["run"]).name)
        presses, increments = answer["indentations"], sum(1 for _ in _increments(run / "events.jsonl"))
        return DryRunCost(
            answer["duration_s"], answer["wall_s"] / presses, _stage_bytes(run / "bytes.jsonl") / increments
        )


def _increments(journal: Path) -> Iterator[float]:
    """Heights of the readings that follow a move below clearance."""
    last_mm = None
    for line in journal.read_text(encoding="utf-8").splitlines():
        height_mm = json.loads(line).get("data", {}).get("height_mm")
        if height_mm is not None and height_mm != last_mm:
            last_mm = height_mm
            yield height_mm


def _stage_bytes(log: Path) -> int:
    lines = (json.loads(line) for line in log.read_text(encoding="utf-8").splitlines())
    return sum(len(line["hex"]) // 2 for line in lines if line["port"] == "stage")


def least(costs: list[DryRunCost]) -> DryRunCost:
    """The quickest round; bench time and bytes are the same in all."""
    return min(costs, key=lambda cost: cost.wall_s_a_press)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--beside", type=Path)
    asked = parser.parse_args()
    trees = [HERE] if asked.beside is None else [HERE, asked.beside.resolve()]
    print("| bench | bench time, s | wall time of a press, ms | bytes an increment |\n|---|---|---|---|")
    for name, config in BENCHES.items():
        rounds = [[measured(tree, config) for tree in trees] for _ in range(ROUNDS)]
        found = [least(list(of_tree)) for of_tree in zip(*rounds, strict=True)]
        numbers = [
            [f"{cost.bench_s:.1f}", f"{1e3 * cost.wall_s_a_press:.0f}", f"{cost.bytes_an_increment:.0f}"]
            for cost in found
        ]
        if len(found) == 1:
            cells = numbers[0]
        else:
            now, then = found
            ratios = (
                now.bench_s / then.bench_s,
                now.wall_s_a_press / then.wall_s_a_press,
                now.bytes_an_increment / then.bytes_an_increment,
            )
            cells = [f"{a}, was {b} (× {r:.3f})" for a, b, r in zip(*numbers, ratios, strict=True)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
