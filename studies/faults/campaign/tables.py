"""What came of a campaign: counts by class of violation, and the worst force of each phase."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from studies.faults.campaign.judge import BOUND_GWT, EXEMPTIONS
from studies.registry import Rows, as_markdown

Record = dict[str, Any]
CLASSES = ("force", "sideways", "report", "lost or repeated", "not resumed", "crash")
TITLES = {"grbl": "GRBL", "rtu": "RTU", "tcp": "TCP", "tmcl": "TMCL", "net_ft": "Net F/T"}
_NAME = re.compile(r'"commit": "([^"]*)", "case": "([^"]*)"')


def records_of(path: Path) -> Iterator[Record]:
    """The records of a file of results, one by one, since there may be hundreds of thousands; no torn line."""
    if not path.exists():
        return
    with path.open(encoding="ascii") as file:
        for line in file:
            try:
                yield json.loads(line)
            except ValueError:
                continue


def names_in(path: Path, commit: str, begins: str = "") -> set[str]:
    """The names of the cases in a file of results that are of a commit, and begin so."""
    if not path.exists():
        return set()
    with path.open(encoding="ascii") as file:
        found = (_NAME.search(line) for line in file if line.endswith("}\n"))
        return {match[2] for match in found if match and match[1] == commit and match[2].startswith(begins)}


def pressed_gwt(record: Record) -> float:
    """The worst of a case and of what took it up."""
    return float(max(record["worst_gwt"], record.get("resume_worst_gwt", 0.0)))


class CampaignSummary:
    """Counts by bench, phase and class, and the worst force of each phase."""

    def __init__(self, records: Iterable[Record]) -> None:
        self.commits: set[str] = set()
        self.took_s = 0.0
        self.resumed = self.absorbed = 0
        self.cases, self.spared = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
        self.found = Counter[tuple[str, str, str]]()
        self.worst_gwt: dict[tuple[str, str], float] = {}  # without the exempt
        self.exempt: dict[str, list[float]] = {}
        self.bad = 0  # cases that break something and are not exempt
        for record in records:
            self._add(record)

    def _add(self, record: Record) -> None:
        place, exempt = (record["bench"], record["phase"]), record["exempt"]
        self.commits.add(record["commit"])
        self.took_s += record.get("s", 0.0)
        self.resumed += record["resumed"] is not None
        self.absorbed += record["exit"] == "absorbed"
        self.cases[place] += 1
        if exempt is None:
            self.bad += bool(record["violations"])
            self.found.update((*place, kind) for kind in record["violations"])
            self.worst_gwt[place] = max(self.worst_gwt.get(place, 0.0), pressed_gwt(record))
        else:
            self.spared[place] += bool(record["violations"])
            self.exempt.setdefault(exempt, []).append(pressed_gwt(record))

    def __str__(self) -> str:
        broken = Counter({kind: sum(n for (_, _, k), n in self.found.items() if k == kind) for kind in CLASSES})
        return (
            f"{self.cases.total()} cases ({self.absorbed} absorbed, {self.resumed} resumed), "
            f"{self.took_s / 60:.0f} min of processor time, bound {BOUND_GWT:.2f} gwt; "
            f"{', '.join(f'{kind}: {n}' for kind, n in broken.items())}; exempt: {self.spared.total()}"
        )

    def phases(self) -> Rows:
        """Cases and worst force of each phase on each bench: studies/results/faults/campaign.csv."""
        benches = list(dict.fromkeys(bench for bench, _ in self.cases))
        rows = [["phase", *(cell for bench in benches for cell in (f"{_title(bench)}: cases", "worst, gwt"))]]
        for phase in dict.fromkeys(phase for _, phase in self.cases):
            rows.append([phase])
            for bench in benches:
                rows[-1] += [_spaced(self.cases[bench, phase]), f"{self.worst_gwt.get((bench, phase), 0.0):.2f}"]
        totals = [_spaced(sum(n for (on, _), n in self.cases.items() if on == bench)) for bench in benches]
        return [*rows, ["all", *(cell for total in totals for cell in (total, ""))]]

    def exceptions(self) -> Rows:
        """Cases of each exemption: studies/results/faults/exceptions.csv."""
        rows = [["exception", "cases", "beyond the bound", "worst, gwt", "remedy"]]
        for exemption in EXEMPTIONS:
            forces = self.exempt.get(exemption.name, [])
            beyond, worst = sum(gwt > BOUND_GWT for gwt in forces), max(forces, default=0.0)
            rows.append([exemption.name, f"{len(forces)}", f"{beyond}", f"{worst:.2f}", exemption.remedy])
        return rows

    def table(self) -> str:
        """All tables as Markdown; `python -m studies run campaign` stores those of docs/validation/faults.md."""
        return "\n".join([f"{self}\n", as_markdown(self.phases()), as_markdown(self.exceptions())])


def _title(bench: str) -> str:
    return TITLES.get(bench, bench.replace("_", " ").capitalize())


def _spaced(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def told(record: Record) -> str:
    """One case in one line."""
    reported = f"{record['claim']}; {record['exit']}: {record['reason'][:120]}"
    worst = f"worst {record['worst_gwt']:.2f} gwt in {record.get('worst_in', '')}, left {record['left_gwt']:.2f}"
    what = ", ".join(record["violations"]) or "fine"
    return f"{record['case']}: {what}; {worst}, sideways {record['drag_mm']:.2f} mm; {reported}"
