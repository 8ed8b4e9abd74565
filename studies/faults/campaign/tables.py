"""What came of a campaign: counts by class of violation, and the worst cases of each phase."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from studies.faults.campaign.judge import BOUND_GWT, EXEMPTIONS

Record = dict[str, Any]
CLASSES = ("force", "sideways", "report", "lost or repeated", "not resumed", "crash")

KEPT = ("case", "data", "worst_gwt", "left_gwt", "drag_mm", "exit", "claim", "on_record", "violations", "exempt")


def records_of(path: Path) -> list[Record]:
    """The records of a file of results; a torn line is left out."""
    return list(_records(path)) if path.exists() else []


def _records(path: Path) -> Iterator[Record]:
    for line in path.read_text(encoding="ascii").splitlines():
        try:
            yield json.loads(line)
        except ValueError:
            continue


def worst_of(records: Sequence[Record], number: int) -> list[Record]:
    """Those that pressed hardest, the run and its resumption alike."""
    return sorted(records, key=lambda r: -max(r["worst_gwt"], r.get("resume_worst_gwt", 0.0)))[:number]


def summary(records: Sequence[Record]) -> str:
    """Violations by bench, phase and class, and the worst of each."""
    took_s = sum(record.get("s", 0.0) for record in records)
    lines = [f"{len(records)} cases, {took_s / 60:.0f} min of processor time, bound {BOUND_GWT:.2f} gwt"]
    counted = Counter[tuple[str, str, str]]()
    cases, exempt = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for record in records:
        place = record["bench"], record["phase"]
        cases[place] += 1
        if record["exempt"] is not None:
            exempt[place] += bool(record["violations"])
            continue
        for kind in record["violations"]:
            counted[(*place, kind)] += 1
    lines.append(f"| bench | phase | cases | {' | '.join(CLASSES)} | exempt | worst gwt |\n|---|---|---|{'---|' * 8}")
    for place in cases:
        some = [r for r in records if (r["bench"], r["phase"]) == place and r["exempt"] is None]
        worst = max((r["worst_gwt"] for r in some), default=0.0)
        numbers = " | ".join(str(counted[(*place, kind)] or "") for kind in CLASSES)
        lines.append(
            f"| {place[0]} | {place[1]} | {cases[place]} | {numbers} | {exempt[place] or ''} | {worst:.2f} |"
        )
    totals = " | ".join(str(sum(n for (_, _, k), n in counted.items() if k == kind)) for kind in CLASSES)
    lines.append(f"| all | | {len(records)} | {totals} | {exempt.total()} | |")
    return "\n".join(lines)


def exempted(records: Sequence[Record]) -> str:
    """The worst of what no program can prevent, by class."""
    lines = ["| exempt | cases | beyond the bound | worst gwt | remedy |", "|---|---|---|---|---|"]
    for exemption in EXEMPTIONS:
        some = [record for record in records if record["exempt"] == exemption.name]
        beyond = sum("force" in record["violations"] for record in some)
        worst = max((record["worst_gwt"] for record in some), default=0.0)
        lines.append(f"| {exemption.name} | {len(some)} | {beyond} | {worst:.2f} | {exemption.remedy} |")
    return "\n".join(lines)


def worst_as_csv(records: Sequence[Record], command: str) -> str:
    """The worst five of each phase and bench, exempt or not, with what made them."""
    lines = [f"# {command}, at {', '.join(sorted({record['commit'] for record in records}))}", ",".join(KEPT)]
    for place in dict.fromkeys((record["bench"], record["phase"]) for record in records):
        for record in worst_of([r for r in records if (r["bench"], r["phase"]) == place], 5):
            row = {**record, "violations": " and ".join(record["violations"]), "exempt": record["exempt"] or ""}
            lines.append(",".join(str(row.get(key, "")).replace(",", ";") for key in KEPT))
    return "\n".join(lines) + "\n"


def told(record: Record) -> str:
    """One case in one line."""
    reported = f"{record['claim']}; {record['exit']}: {record['reason'][:120]}"
    worst = f"worst {record['worst_gwt']:.2f} gwt in {record.get('worst_in', '')}, left {record['left_gwt']:.2f}"
    what = ", ".join(record["violations"]) or "fine"
    return f"{record['case']}: {what}; {worst}, sideways {record['drag_mm']:.2f} mm; {reported}"


def table(records: Sequence[Record]) -> str:
    """For docs/faults.md."""
    parts = [
        summary(records),
        "",
        exempted(records),
        "",
        "| phase | case | worst gwt | ended | report |",
        "|---|---|---|---|---|",
    ]
    judged = [record for record in records if record["exempt"] is None]
    for phase in dict.fromkeys(record["phase"] for record in judged):
        for record in worst_of([r for r in judged if r["phase"] == phase], 5):
            worst = max(record["worst_gwt"], record.get("resume_worst_gwt", 0.0))
            parts.append(f"| {phase} | `{record['case']}` | {worst:.2f} | {record['exit']} | {record['claim']} |")
    return "\n".join(parts)
