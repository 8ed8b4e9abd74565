"""Every study as a page, read off `studies/registry.toml`; and below each table of a page, the study behind it."""

import re
from functools import cache

from studies.registry import QUOTED, Study, owners, studies

_HEAD = """\
# Studies and results

What each study answers, what runs it, how long it takes on two cores of 2.6 GHz, and the commit that measured each
table. The tables are CSV files in `studies/results/`. Where no commit is recorded for a measurement, the list has the
commit that brought the table into this documentation.

```
.venv/bin/python -m studies list           # this page
.venv/bin/python -m studies run NAME       # runs a study and stores its tables
.venv/bin/python -m studies check          # compares registry, results and pages
```
"""


def studies_page() -> str:
    """Return the page: every study with its commands, pages, files and tables."""
    return _HEAD + "".join(map(_section, studies().values()))


def _section(study: Study) -> str:
    lines = [f"\n## {study.name}\n", study.answers]
    if study.removed:
        lines.append(f"No longer part of the project: `git show {study.removed}` has its code.")
    elif study.run:
        lines.append(", ".join(f"`{command}`" for command in study.commands))
    if study.minutes is not None:
        lines[-1] += f" ({study.minutes:g} min)"
    lines += [", ".join(f"[{page}]({page}.md)" for page in study.pages)] if study.pages else []
    lines += ["\n".join(f"- `studies/results/{name}.csv`: {commit}" for name, commit in study.tables.items())]
    lines += ["\n".join(f"- `{name}`" for name in study.data)]
    return "\n\n".join(line for line in lines if line) + "\n"


@cache
def _owners() -> dict[str, Study]:
    return owners(studies())


def provenance(text: str, up: str) -> str:
    """Return a page with study, commit and CSV above each table."""
    owner = _owners()

    def named(found: re.Match[str]) -> str:
        name = found["file"]
        study = owner[name]
        line = (
            f"*[{study.name}]({up}studies.md#{study.name}), {study.measured(name)},* "
            f"{{download}}`CSV <{up}../studies/results/{name}.csv>`"
        )
        return f"{line}\n\n{found[0]}"

    return QUOTED.sub(named, text)
