"""The page of the study: the matrix first, then every figure and table, each with its claims."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rig.data.folder import replace_bytes, replace_text
from rig.report.page_parts import PageFigure, Section, as_png, render
from rig.report.pdf import as_pdf
from studies.registry import as_markdown
from studies.source.matrix import VERDICT_COLUMN, matrix, why
from studies.source.printed.answers import FingerAnswers
from studies.source.printed.entry import HEADER, Entry, MatrixRow, found

TITLE = "The source, figure by figure"
ABOUT = "Chapters 3 to 6 of B. I. Raju, S.M. thesis, MIT, 1998, beside the default finger."
SUMMARY_HEADER = ("number", "what it shows", "verdict", "note")
CLAIMS_HEADER = ("number", "what", "the source", "here", "verdict", "bounds of agrees, partly")
PAGES = (
    ("comparison.html", "the same schedules on the virtual bench, as a comparison shows them", "make study-bench"),
    ("forces.html", "step 1 at two forces on the virtual bench", "make study-bench"),
    ("synthetic.html", "an example on synthetic recordings", "make study-bench"),
)


@dataclass(frozen=True)
class ShownEntry:
    """What an entry draws."""

    figures: tuple[PageFigure, ...]
    tables: tuple[Section, ...]


@dataclass(frozen=True)
class MatrixPage:
    """Everything that is written."""

    rows: tuple[MatrixRow, ...]
    shown: dict[str, ShownEntry]
    provenance: dict[str, Any]

    @property
    def matrix(self) -> Section:
        """The first page."""
        return matrix(self.rows)

    @property
    def tables(self) -> list[Section]:
        """The matrix, the claims of each entry, and the tables that go with them."""
        claims = [_claims(row) for row in self.rows if row.found]
        others = [table for one in self.shown.values() for table in one.tables if table.rows]
        return [self.matrix, *claims, *others]


def _claims(row: MatrixRow) -> Section:
    return Section(f"{row.entry.number}: {row.told}", row.entry.shows, HEADER, row.claims)


def studied(
    entries: Sequence[Entry], answers: FingerAnswers, say: Callable[[str], object], command: str
) -> MatrixPage:
    """Every entry measured; figures are drawn when they are written."""
    rows, shown = [], {}
    for entry in entries:
        rows.append(found(entry, answers))
        shown[entry.key] = ShownEntry(entry.figures(answers), entry.tables(answers))
        say(f"{entry.number}: {rows[-1].told}")
    return MatrixPage(tuple(rows), shown, _provenance(answers, command))


def _provenance(answers: FingerAnswers, command: str) -> dict[str, Any]:
    return {
        "command": command,
        "presses": answers.presses,
        "nodes": answers.finger.model.nodes,
        "e_epidermis_mpa": answers.finger.e_epidermis_mpa,
        "small_strain": answers.small_strain.note,
        "versions": {name: version(name) for name in ("indentation-rig", "numpy", "scipy", "matplotlib")},
    }


def write(folder: Path, study: MatrixPage) -> None:
    """study.html and .pdf, tables.md and .json."""
    draw = partial(
        render,
        "study.html.j2",
        title=TITLE,
        about=ABOUT,
        small_strain=study.provenance["small_strain"],
        matrix=study.matrix,
        rows=study.rows,
        header=HEADER,
        verdict_column=VERDICT_COLUMN,
        shown=study.shown,
        pages=PAGES,
        provenance=study.provenance,
    )
    replace_text(folder / "study.html", draw())
    replace_bytes(folder / "study.pdf", as_pdf(draw(picture=as_png), datetime.now(UTC)))
    replace_text(folder / "tables.md", "\n".join(markdown(section) for section in study.tables))
    as_json = [
        {"number": row.entry.number, "verdict": row.verdict, "claims": [f.row for f in row.found]}
        for row in study.rows
    ]
    kept = {**study.provenance, "header": HEADER, "entries": as_json}
    replace_text(folder / "tables.json", json.dumps(kept, ensure_ascii=False, indent=1))


def verdicts(rows: Sequence[MatrixRow]) -> list[tuple[str, ...]]:
    """Return the verdict of every figure and table: studies/results/source/figures.csv."""
    return [
        SUMMARY_HEADER,
        *((row.entry.number, row.entry.shows, row.told, why(row) or row.entry.reading or "–") for row in rows),
    ]


def all_claims(rows: Sequence[MatrixRow]) -> list[tuple[str, ...]]:
    """Return every claim: studies/results/source/claims.csv."""
    return [CLAIMS_HEADER, *((row.entry.number, *cells[:3], *cells[4:]) for row in rows for cells in row.claims)]


def markdown(section: Section) -> str:
    """A table as the docs have them."""
    return f"**{section.title}.** {section.text}\n\n{as_markdown([section.header, *section.rows])}"
