"""List, run and check the studies.

.venv/bin/python -m studies list [NAME …]      what each answers, how long it takes, what it writes
.venv/bin/python -m studies run NAME …         run studies and store the tables that they print
.venv/bin/python -m studies run --set bench    all studies of `make bench`
.venv/bin/python -m studies check              compare registry, results and pages
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence

from rig.data.folder import replace_text
from studies import registry
from studies.registry import Rows, Study, studies

OUTPUT = registry.ROOT / "build" / "studies"
"""What each study printed last."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m studies", description="Studies and their results.")
    commands = parser.add_subparsers(dest="command", required=True)
    known = studies()
    listing = commands.add_parser("list", help="list studies")
    listing.add_argument("names", nargs="*", choices=[[], *known], metavar="NAME")
    running = commands.add_parser("run", help="run studies and store their tables")
    running.add_argument("names", nargs="*", choices=[[], *known], metavar="NAME")
    running.add_argument("--set", choices=("bench",), help="all studies of a make target")
    commands.add_parser("check", help="compare registry, results and pages")
    options = parser.parse_args(arguments)
    if options.command == "list":
        for name in options.names or known:
            print(as_text(known[name]))
        return 0
    if options.command == "run":
        names = options.names or [name for name, one in known.items() if options.set and options.set in one.sets]
        if not names:
            running.error("name a study, or a set with --set")
        return max(run(known[name]) for name in names)
    return check()


def as_text(study: Study) -> str:
    """Return one study as some lines."""
    lines = [f"{study.name}: {study.answers}"]
    lines += [f"    {command}" for command in study.commands]
    if study.minutes is not None:
        lines.append(f"    {study.minutes:g} min on two cores")
    if study.removed:
        lines.append(f"    no longer part of the project; its code: git show {study.removed}")
    lines += [f"    studies/results/{table}.csv, {study.measured(table)}" for table in study.tables]
    return "\n".join([*lines, *(f"    {name}" for name in study.data)])


def run(study: Study) -> int:
    """Run a study, store the tables that it prints and the commit; return an exit code."""
    if study.removed or not study.run:
        print(as_text(study), file=sys.stderr)
        return 1
    printed, begun_at = "", _commit()
    for command in study.run:
        print(f"{study.name}: {command}", file=sys.stderr, flush=True)
        code, text = _printed(command, study.threads)
        printed += text
        if code:
            return code
    return store(study, printed, begun_at)


def _printed(command: str, threads: int | None) -> tuple[int, str]:
    """Run one command and pass on what it prints; return its exit code and its output."""
    name, *options = shlex.split(command)
    environment = os.environ | ({"OMP_NUM_THREADS": f"{threads}"} if threads else {})
    lines = []
    with subprocess.Popen(
        [sys.executable, "-m", name, *options], cwd=registry.ROOT, env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            lines.append(line)
    return process.returncode, "".join(lines)


def store(study: Study, printed: str, commit: str) -> int:
    """Write the tables of an output to the study's CSV files; return 1 where a file finds no table."""
    OUTPUT.mkdir(parents=True, exist_ok=True)
    output = OUTPUT / f"{study.name}.md"
    replace_text(output, printed)
    found = matched(study, list(registry.tables_in(printed)))
    text = registry.REGISTRY.read_text(encoding="utf-8")
    for name, rows in found.items():
        head = registry.read_table(name, registry.RESULTS)[0]
        registry.write_table(name, [head, *rows[1:]], registry.RESULTS)
        text = re.sub(rf'^"{name}" = ".*"$', f'"{name}" = "{commit}"', text, flags=re.MULTILINE)
    replace_text(registry.REGISTRY, text)
    missing = [name for name in study.tables if name not in found]
    for name in missing:
        print(f"{output}: no table for studies/results/{name}.csv", file=sys.stderr)
    return int(bool(missing))


def matched(study: Study, printed: list[Rows]) -> dict[str, Rows]:
    """Return the printed table of each CSV: the one with its header; else the next of its width, if as many are left.

    The header of a CSV is written for readers, and stays.
    """
    heads = {name: registry.read_table(name, registry.RESULTS)[0] for name in study.tables}
    found: dict[str, Rows] = {}
    for name, head in heads.items():
        same = [rows for rows in printed if rows[0] == head]
        if same:
            found[name] = same[0]
            printed = [rows for rows in printed if rows is not same[0]]
    rest = [name for name in heads if name not in found]
    if len(rest) == len(printed):
        pairs = zip(rest, printed, strict=True)
        found |= {name: rows for name, rows in pairs if len(rows[0]) == len(heads[name])}
    return found


def _commit() -> str:
    """Return the commit of the tree, with + where files were changed since."""

    def git(*words: str) -> str:
        return subprocess.run(("git", *words), cwd=registry.ROOT, capture_output=True, text=True, check=True).stdout

    changed = git("status", "--porcelain", "-uno").strip()
    return git("rev-parse", "--short=8", "HEAD").strip() + ("+" if changed else "")


def check() -> int:
    """Print what does not fit; return 1 if anything does not."""
    found = registry.problems()
    print("\n".join(found) or "registry, results and pages agree")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
