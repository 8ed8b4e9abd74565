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
from rig.report.page import PageFigure, Section, as_png, render
from rig.report.pdf import as_pdf
from studies.source.matrix import VERDICT_COLUMN, matrix, why
from studies.source.printed.answers import FingerAnswers
from studies.source.printed.entry import HEADER, Entry, MatrixRow, found

TITLE = "The source, figure by figure"
ABOUT = "Chapters 3 to 6 of B. I. Raju, S.M. thesis, MIT, 1998, beside the default finger."
DOCS = """\
This page compares chapters 3 to 6 of B. I. Raju, S.M. thesis, MIT, 1998 (*Raju 1998*) with the default finger.
`make study` writes it as `study/source.md`; `docs/source.md` shows how to run the study.
`docs/validation/source_verdicts.md` has the tables behind Table 5.2 and Eq. 4.1, and `docs/validation/coding.md`
those behind chapter 6. To make one figure alone:

```
.venv/bin/python -m studies.source.pages study --only 4-4
```"""
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
    """study.html and .pdf, tables.md and .json, and source.md for the docs."""
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
    replace_text(folder / "source.md", as_docs(study))
    as_json = [
        {"number": row.entry.number, "verdict": row.verdict, "claims": [f.row for f in row.found]}
        for row in study.rows
    ]
    kept = {**study.provenance, "header": HEADER, "entries": as_json}
    replace_text(folder / "tables.json", json.dumps(kept, ensure_ascii=False, indent=1))


def as_docs(study: MatrixPage) -> str:
    """Return docs/validation/source.md: one table of verdicts, one of all claims."""
    verdicts = [
        (row.entry.number, row.entry.shows, row.told, why(row) or row.entry.reading or "–") for row in study.rows
    ]
    claims = [
        ("" if n else row.entry.number, *cells[:3], *cells[4:])
        for row in study.rows
        for n, cells in enumerate(row.claims)
    ]
    parts = [
        f"# Validation: {TITLE[0].lower()}{TITLE[1:]}",
        DOCS,
        study.matrix.text,
        _table(SUMMARY_HEADER, verdicts),
        "## Claims",
        _table(CLAIMS_HEADER, claims),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def markdown(section: Section) -> str:
    """A table as the docs have them."""
    return f"**{section.title}.** {section.text}\n\n{_table(section.header, section.rows)}"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
