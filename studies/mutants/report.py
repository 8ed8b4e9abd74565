"""The score, and the survivors with their reasons."""

import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

Result = dict[str, Any]


def accepted(path: Path) -> dict[str, str]:
    """Key of each mutant that may survive, and why."""
    entries = tomllib.loads(path.read_text(encoding="utf-8")).get("equivalent", [])
    return {key: entry["why"] for entry in entries for key in entry["mutants"]}


def score(results: list[Result], why: dict[str, str]) -> dict[str, float]:
    """Mutants, killed, equivalents, and the share killed of those that are none."""
    outcomes = Counter(
        "equivalent" if r["outcome"] == "survived" and r["key"] in why else r["outcome"] for r in results
    )
    killed = outcomes["killed"] + outcomes["timeout"]
    counted = len(results) - outcomes["equivalent"]
    return {
        "mutants": len(results),
        "killed": killed,
        "equivalent": outcomes["equivalent"],
        "survived": outcomes["survived"],
        "score": killed / counted if counted else 1.0,
    }


def page(results: list[Result], why: dict[str, str]) -> str:
    """Markdown: the score of both groups, and all survivors."""
    parts = [
        "# Mutants",
        "",
        "| group | mutants | killed | equivalent | survived | score |",
        "|---|---|---|---|---|---|",
    ]
    groups = {name: [r for r in results if r["group"] == name] for name in ("first", "sample")}
    for name, group in groups.items():
        row = score(group, why)
        equivalent = f"{row['equivalent']} ({row['equivalent'] / max(len(group), 1):.1%})"
        parts.append(
            f"| {name} | {row['mutants']} | {row['killed']} | {equivalent} | {row['survived']} | {row['score']:.1%} |"
        )
    for name, group in groups.items():
        left = [r for r in group if r["outcome"] == "survived"]
        parts += ["", f"## Survivors, {name} group", "", "| where | before | after | reason |", "|---|---|---|---|"]
        for r in sorted(left, key=lambda r: (r["key"] in why, r["path"], r["line"])):
            parts.append(
                f"| {r['path']}:{r['line']} | {_code(r['before'])} | {_code(r['after'])} | {why.get(r['key'], '')} |"
            )
    stale = sorted(set(why) - {r["key"] for r in results if r["outcome"] == "survived"})
    if stale:
        parts += ["", "## Accepted, but killed or gone", "", *(f"- `{key}`" for key in stale)]
    return "\n".join(parts) + "\n"


def _code(text: str) -> str:
    return "`" + text.replace("|", "\\|").replace("`", "'") + "`" if text else ""
