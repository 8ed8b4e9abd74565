"""How far fingers interpolated over the moduli of dermis and fat are from full builds, and how long both take.

.venv/bin/python -m studies.accuracy.another_finger [ROWS]    # docs/validation/performance.md; ten minutes, once

The fingers are held out: the corners of the range, the default, and others drawn from it, evenly in the logarithms.
Each that is done is a line of ROWS (default: another_finger.jsonl), and is not done again until that is deleted.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sim.benchmark import FAMILIES, QUICK_SCENES
from sim.config import FingertipConfig, Tissue
from sim.measures.receptors import ReceptorPlaces
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.interpolation import forget_kept, make_node, nodes_for
from sim.models.interpolation_weights import DERMIS, FAT, largest_error
from sim.models.result import IndentationResult

T = TypeVar("T")
Row = dict[str, Any]

HELD_OUT, SEED = 50, 16
QUANTITIES = ("force", "sed", "ep1")
_REPEATS = 5


def held_out() -> list[Tissue]:
    """The corners, the default and others."""
    corners = [(u, v) for u in (0.0, 1.0) for v in (0.0, 1.0)]
    drawn = np.random.default_rng(SEED).random((HELD_OUT - len(corners) - 1, 2)).tolist()
    return [Tissue(), *(_tissue(u, v) for u, v in [*corners, *drawn])]


def _tissue(u: float, v: float) -> Tissue:
    e_dermis, e_fat = (axis.low * (axis.high / axis.low) ** w for axis, w in ((DERMIS, u), (FAT, v)))
    return Tissue(e_dermis=min(e_dermis, DERMIS.high), e_fat=min(e_fat, FAT.high))


def _timed(call: Callable[[], T]) -> tuple[T, float]:
    """What it gives, and processor seconds."""
    began = time.process_time()
    return call(), time.process_time() - began


def row(tissue: Tissue) -> Row:
    """One finger, both ways."""
    config = FingertipConfig(tissue=tissue)
    full, built_s = _timed(lambda: load("finger", config, cached=False))
    Fingertip.load(config, exact=False)
    repeats = [_timed(lambda: Fingertip.load(config, exact=False)) for _ in range(_REPEATS)]
    other, moment_s = repeats[0][0], float(np.median([seconds for _, seconds in repeats]))
    errors: dict[str, dict[str, float]] = {quantity: {} for quantity in QUANTITIES}
    for scene in QUICK_SCENES:
        found, right = (f.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm) for f in (other, full))
        assert found.state.converged
        assert right.state.converged
        for quantity in QUANTITIES:
            errors[quantity][scene.name] = _error(found, right, quantity)
    return {"e_dermis": tissue.e_dermis, "e_fat": tissue.e_fat, "built_s": built_s, "moment_s": moment_s, **errors}


def _error(found: IndentationResult, right: IndentationResult, quantity: str) -> float:
    """Relative; at receptors the largest deviation over the largest value."""
    if quantity == "force":
        return abs(found.force_n / right.force_n - 1)
    there, expected = found.receptor_measures[quantity], right.receptor_measures[quantity]
    return float(np.abs(there - expected).max() / np.abs(expected).max())


def rows(kept: Path) -> Iterator[Row]:
    """Those that were kept, and the missing ones."""
    known = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()] if kept.exists() else []
    done = {(one["e_dermis"], one["e_fat"]): one for one in known}
    for n, tissue in enumerate(held_out(), 1):
        if (tissue.e_dermis, tissue.e_fat) not in done:
            found = row(tissue)
            done[tissue.e_dermis, tissue.e_fat] = found
            with kept.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(found) + "\n")
        one = done[tissue.e_dermis, tissue.e_fat]
        worst = ", ".join(f"{quantity} {100 * max(one[quantity].values()):.2f} %" for quantity in QUANTITIES)
        print(f"finger {n} of {HELD_OUT}: {worst}", file=sys.stderr, flush=True)
        yield one


def table(found: list[Row]) -> Iterator[str]:
    """Errors by family, then times."""
    corners = {(_tissue(u, v).e_dermis, _tissue(u, v).e_fat) for u in (0.0, 1.0) for v in (0.0, 1.0)}
    at_corners = [one for one in found if (one["e_dermis"], one["e_fat"]) in corners]
    header = (
        "shapes",
        *(f"{quantity}, median / largest (%)" for quantity in QUANTITIES),
        "largest at the corners (%)",
    )
    yield f"| {' | '.join(header)} |\n|{'---|' * len(header)}"
    for family in FAMILIES:
        names = [scene.name for scene in QUICK_SCENES if scene.family == family]
        cells = [[100 * one[quantity][name] for one in found for name in names] for quantity in QUANTITIES]
        worst = [100 * max(one[quantity][name] for one in at_corners for name in names) for quantity in QUANTITIES]
        both = " | ".join(f"{np.median(values):.2f} / {max(values):.2f}" for values in cells)
        yield f"| {family} | {both} | {' / '.join(f'{value:.2f}' for value in worst)} |"
    built_s, moment_s = (np.array([one[name] for one in found]) for name in ("built_s", "moment_s"))
    yield (
        f"\nfull build {np.median(built_s):.2f} s, another finger {np.median(moment_s):.3f} s of processor time: "
        f"1 : {np.median(built_s / moment_s):.0f} (median of {len(found)} fingers; least 1 : "
        f"{(built_s / moment_s).min():.0f})\nbound of the compliance's error in any direction {largest_error():.2%}"
    )


def nodes() -> str:
    """Build what is interpolated between, and say what that took."""
    built = nodes_for(FingertipConfig(), ReceptorPlaces())
    seconds = []
    for n, node in enumerate(built, 1):
        if not node.kept:
            seconds.append(_timed(lambda node=node: make_node(node))[1])  # type: ignore[misc]
            print(f"node {n} of {len(built)}: {seconds[-1]:.1f} s", file=sys.stderr, flush=True)
    size = sum(path.stat().st_size for node in built for path in node.files)
    Fingertip.load(exact=False)
    forget_kept()
    _, read_s = _timed(lambda: Fingertip.load(exact=False))
    made = f"built in {sum(seconds):.0f} s of processor time" if len(seconds) == len(built) else "from the cache"
    return f"{len(built)} nodes {made}, {size / 1e6:.0f} MB; read in {read_s:.2f} s, once a process"


def main() -> None:
    """Print both."""
    said = nodes()
    found = list(rows(Path(sys.argv[1] if len(sys.argv) > 1 else "another_finger.jsonl")))
    print("\n".join([*table(found), said]))


if __name__ == "__main__":
    main()
