"""Which fingers the source allows.

    .venv/bin/python -m studies.source.allowed [FOLDER] [--results FOLDER]    # default: study, the kept tables

Reads what is kept of every finger that was pressed (`results/`), presses what is missing, one finger after another,
each on disk before the next is begun; then emulates, rules out, prints what is left, and writes FOLDER/allowed.png.
With the kept tables a minute or two; with an empty folder of results half an hour of one core.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from studies.registry import as_markdown
from studies.source.allowed import kept
from studies.source.allowed.study import made
from studies.source.allowed.tables import drawn, halves, parameters


def parser() -> argparse.ArgumentParser:
    """What may be asked for."""
    asks = argparse.ArgumentParser(description="Which fingers the source allows.")
    asks.add_argument("folder", nargs="?", default="study", type=Path)
    asks.add_argument("--results", default=kept.RESULTS, type=Path, help="where the tables of fingers are kept")
    return asks


def main(arguments: Sequence[str] | None = None) -> None:
    """Press what is missing, judge and write."""
    told = parser().parse_args(arguments)
    say = _saying(time.perf_counter())
    study = made(told.results, say)
    told.folder.mkdir(parents=True, exist_ok=True)
    drawn(study, told.folder / "allowed.png")
    for k, left in enumerate(study.lefts, 1):
        say(f"wave {k}: {left.fingers} fingers, inflation {left.inflation:g}, {left.share:.2%} of all ranges left")
    print(as_markdown(list(parameters(study.last))), as_markdown(list(halves(study))), sep="\n")
    say(f"{told.folder / 'allowed.png'}")


def _saying(began: float) -> Callable[[str], None]:
    return partial(_say, began)


def _say(began: float, text: str) -> None:
    print(f"{time.perf_counter() - began:5.0f} s  {text}", flush=True)


if __name__ == "__main__":
    main()
