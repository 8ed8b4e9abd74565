"""The source, figure by figure: chapters 3 to 6 on one page, the matrix of all verdicts first.

    .venv/bin/python -m studies.source.pages [FOLDER] [--only NUMBER …] [--sensitivity]    # default: study, all

Writes FOLDER/study.html and .pdf, and their tables as tables.md and tables.json; with --only (4-4, table-5-2, …) the
same of those alone in FOLDER/only, and prints their tables. Presses go over this machine's cores, each made once for
all figures that show it. --sensitivity adds how the survivors move with what the source leaves free (a minute more).
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from studies.registry import as_markdown
from studies.source.matrix_page import all_claims, markdown, studied, verdicts, write
from studies.source.printed.answers import FingerAnswers, load
from studies.source.printed.catalogue import ENTRIES, named
from studies.source.printed.entry import Entry, scenes_of
from studies.source.verdicts_by_parameter import all_verdicts, sensitivity_section

COMMAND = "make study"
SURVIVORS = "ch-5-survivors"
_SAID_EACH = 40


def parser() -> argparse.ArgumentParser:
    """What may be asked for."""
    asks = argparse.ArgumentParser(description="The source, figure by figure.")
    asks.add_argument("folder", nargs="?", default="study", type=Path)
    keys = [entry.key for entry in ENTRIES]
    asks.add_argument("--only", nargs="+", default=[], choices=keys, metavar="NUMBER", help=", ".join(keys))
    asks.add_argument("--sensitivity", action="store_true", help="of the survivors, to what the source leaves free")
    return asks


def main(arguments: Sequence[str] | None = None) -> None:
    """Press, measure and write."""
    told, began = parser().parse_args(arguments), time.perf_counter()
    say = partial(_say, began)
    folder = told.folder / "only" if told.only else told.folder
    folder.mkdir(parents=True, exist_ok=True)
    answers = FingerAnswers(load())
    entries = [_with_sensitivity(e) if told.sensitivity and e.key == SURVIVORS else e for e in named(told.only)]
    scenes = scenes_of(entries)
    say(f"{len(scenes)} presses over this machine's cores …")
    answers.press_all(scenes, partial(_pressed, say))
    command = f"python -m studies.source.pages --only {' '.join(told.only)}" if told.only else COMMAND
    study = studied(entries, answers, say, command)
    say("drawing …")
    write(folder, study)
    if told.only:
        print("\n".join(markdown(section) for section in study.tables[1:]))
    else:
        print(as_markdown(verdicts(study.rows)), as_markdown(all_claims(study.rows)), sep="\n")
    say(f"{folder / 'study.html'}, its PDF and its tables")


def _with_sensitivity(entry: Entry) -> Entry:
    """The entry, and a table of other fingers beside it."""
    return replace(entry, tables=lambda a: (*entry.tables(a), sensitivity_section(list(all_verdicts()))))


def _pressed(say: partial[None], done: int, of: int) -> None:
    if done == of or done % _SAID_EACH == 0:
        say(f"{done} of {of} presses")


def _say(began: float, text: str) -> None:
    print(f"{time.perf_counter() - began:5.0f} s  {text}", flush=True)


if __name__ == "__main__":
    main()
