"""The table of studies (`registry.toml`), their results as CSV, and the pages that quote these.

A page of `docs/` shows a table of `studies/results/` as a `csv-table` directive, whose `:file:` is the CSV.
"""

import csv
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

from rig.data.folder import replace_text

ROOT = Path(__file__).parents[1]
REGISTRY = Path(__file__).parent / "registry.toml"
RESULTS = Path(__file__).parent / "results"
DOCS = ROOT / "docs"

Rows = list[list[str]]

QUOTED = re.compile(
    r"^```\{csv-table\}\n:file: (?:\.\./)+studies/results/(?P<file>[\w/]+)\.csv\n(?::[^\n]*\n)*```$",
    flags=re.MULTILINE,
)
"""A table of the results on a page."""

_COMMIT = re.compile(r"[0-9a-f]{7,40}\+?(, [0-9a-f]{7,40}\+?)*")
_CELL = re.compile(r"(?<!\\)\|")


@dataclass(frozen=True)
class Study:
    """One entry of the table of studies."""

    name: str
    answers: str
    pages: tuple[str, ...] = ()
    run: tuple[str, ...] = ()
    minutes: float | None = None
    threads: int | None = None
    sets: tuple[str, ...] = ()
    data: tuple[str, ...] = ()
    removed: str = ""
    tables: Mapping[str, str] = field(default_factory=dict)
    """Name of each CSV, and the commit that measured it (or several, of parts of it)."""

    def measured(self, table: str) -> str:
        """Return where a table comes from, in words."""
        commit = self.tables[table]
        if self.removed:
            return f"measured at {commit} by a study that is no longer part of the project"
        return f"commit {commit}"

    @property
    def commands(self) -> tuple[str, ...]:
        """What to type."""
        threads = f"OMP_NUM_THREADS={self.threads} " if self.threads else ""
        return tuple(f"{threads}.venv/bin/python -m {one}" for one in self.run)


def studies(registry: Path = REGISTRY) -> dict[str, Study]:
    """Read every study by its name."""
    entries = tomllib.loads(registry.read_text(encoding="utf-8"))
    return {name: Study(name, **_given(entry)) for name, entry in entries.items()}


def _given(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()}


def owners(known: Mapping[str, Study]) -> dict[str, Study]:
    """Return the study of each CSV."""
    return {table: study for study in known.values() for table in study.tables}


# --- CSV and Markdown ---


def read_table(name: str, results: Path = RESULTS) -> Rows:
    """Return the header and the rows of a CSV."""
    with (results / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def write_table(name: str, rows: Sequence[Sequence[str]], results: Path = RESULTS) -> None:
    """Write a CSV with its header."""
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    path = results / f"{name}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_text(path, text.getvalue())


def as_markdown(rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([head, f"|{'---|' * len(rows[0])}", *body]) + "\n"


def show(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a Markdown table, each row as soon as it is known."""
    print(f"| {' | '.join(header)} |\n|{'---|' * len(header)}", flush=True)
    for row in rows:
        print(f"| {' | '.join(row)} |", flush=True)


def tables_in(text: str) -> Iterator[Rows]:
    """Yield every Markdown table of a text, such as a study prints.

    A rule ends the table above its header, so that tables without a line between them stay apart.
    """
    rows: Rows = []
    for line in [*text.splitlines(), ""]:
        row = [cell.strip() for cell in _CELL.split(line.strip()[1:-1])] if line.startswith("|") else []
        if not row and rows:
            yield rows
            rows = []
        elif row and not all(re.fullmatch(r":?-+:?", cell) for cell in row):
            rows.append(row)
        elif len(rows) > 1:
            yield rows[:-1]
            rows = rows[-1:]


# --- pages ---


def pages(docs: Path = DOCS) -> list[Path]:
    """Return the pages that may quote a table."""
    return sorted(docs.rglob("*.md"))


def quoted(text: str) -> Iterator[str]:
    """Yield the names of the tables that a page quotes."""
    for found in QUOTED.finditer(text):
        yield found["file"]


def expanded(text: str, results: Path = RESULTS) -> str:
    """Return a page with each `csv-table` as Markdown: what a reader sees."""
    return QUOTED.sub(lambda found: as_markdown(read_table(found["file"], results)), text)


# --- check ---


def problems(registry: Path = REGISTRY, results: Path = RESULTS, docs: Path = DOCS) -> list[str]:
    """Return whatever does not fit among registry, results and pages, one line each."""
    known = studies(registry)
    texts = {page.relative_to(docs).with_suffix("").as_posix(): page.read_text("utf-8") for page in pages(docs)}
    return [
        *(line for study in known.values() for line in _of_study(study, texts)),
        *_of_results(known, results),
        *(line for name, text in texts.items() for line in _of_page(name, text, owners(known), results)),
    ]


def _of_study(study: Study, texts: Mapping[str, str]) -> Iterator[str]:
    where = f"registry.toml, {study.name}"
    if not study.removed:
        for command in study.run:
            module = command.split()[0]
            if not module.startswith(("studies.", "tests.")) or find_spec(module) is None:
                yield f"{where}: there is no study {module}"
        yield from (f"{where}: there is no file {name}" for name in study.data if not (ROOT / name).exists())
    yield from (f"{where}: there is no page docs/{page}.md" for page in study.pages if page not in texts)
    yield from (f"{where}: no page quotes {table}" for table in study.tables if not _somewhere(table, study, texts))
    yield from (
        f"{where}: {commit!r} is no commit" for commit in study.tables.values() if not _COMMIT.fullmatch(commit)
    )


def _somewhere(table: str, study: Study, texts: Mapping[str, str]) -> bool:
    return any(f"studies/results/{table}.csv" in texts.get(page, "") for page in study.pages)


def _of_results(known: Mapping[str, Study], results: Path) -> Iterator[str]:
    listed = [table for study in known.values() for table in study.tables]
    stored = {path.relative_to(results).with_suffix("").as_posix() for path in results.rglob("*.csv")}
    yield from (f"registry.toml: {name} belongs to two studies" for name in sorted(listed) if listed.count(name) > 1)
    yield from (f"studies/results/{name}.csv is missing" for name in sorted({*listed} - stored))
    yield from (f"studies/results/{name}.csv belongs to no study" for name in sorted(stored - {*listed}))
    for name in sorted(stored):
        head, *rows = read_table(name, results)
        if not rows or any(len(row) != len(head) for row in rows):
            yield f"studies/results/{name}.csv: a row is not as wide as the header"


def _of_page(name: str, text: str, owner: Mapping[str, Study], results: Path) -> Iterable[str]:
    unknown = [table for table in quoted(text) if table not in owner or not (results / f"{table}.csv").exists()]
    return [f"docs/{name}.md quotes {table}, which no study writes" for table in unknown]
