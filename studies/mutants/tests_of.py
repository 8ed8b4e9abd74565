"""Which tests may notice a mutant, those first that are likely to and quick."""

import json
import re
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

from studies.mutants.source import Mutant

LIST_OF_KEYS, WALKS_IT = "tests/data/config_keys.txt", "from tests.config_keys import"

Coverage = dict[str, dict[str, Any]]


class LineTests:
    """Tests by the line that they run, with a memory of which noticed what."""

    def __init__(self, root: Path, coverage: Coverage) -> None:
        self._root = root
        self.seconds = {test: entry["seconds"] for test, entry in coverage.items()}
        self._shared: dict[str, dict[str, float]] = {test: entry["shared"] for test, entry in coverage.items()}
        self._by_line: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
        for test, entry in coverage.items():
            for path, lines in entry["lines"].items():
                for line in lines:
                    self._by_line[path][line].add(test)
        self._noticed: dict[str, Counter[str]] = defaultdict(Counter)

    def likely(self, mutant: Mutant, budget_s: float) -> tuple[list[str], float, bool]:
        """Tests in the order to try them, their seconds, and whether these are all that run the changed lines."""
        found = self._running(mutant.path, mutant.lines)
        others: set[str] = set()
        if mutant.at_import:
            found = self._mentioning(mutant.at_import) | self._by_the_list(mutant.at_import)
            others = self._running(mutant.path, tuple(self._by_line[mutant.path])) - found
        in_function, in_file = self._noticed[f"{mutant.path}::{mutant.function}"], self._noticed[mutant.path]
        cost = {t: (self._alone_s(t) + 0.02) / (1 + 4 * in_function[t] + in_file[t]) for t in found | others}
        cost |= {t: 4 * cost[t] for t in others}
        chosen: list[str] = []
        total_s, made = 0.0, set[str]()
        for test in sorted(cost, key=lambda t: (cost[t], t)):
            own_s = self.seconds[test] + sum(s for f, s in self._shared[test].items() if f not in made)
            if not chosen or total_s + own_s <= budget_s:
                chosen.append(test)
                made.update(self._shared[test])
                total_s += own_s
        return chosen, total_s, len(chosen) == len(cost)

    def _alone_s(self, test: str) -> float:
        return self.seconds[test] + float(sum(self._shared[test].values()))

    def noticed(self, mutant: Mutant, test: str) -> None:
        """Remember what killed this one: its neighbours may die of the same."""
        if test in self.seconds:
            self._noticed[f"{mutant.path}::{mutant.function}"][test] += 1
            self._noticed[mutant.path][test] += 1

    def _running(self, path: str, lines: tuple[int, ...]) -> set[str]:
        by_line = self._by_line.get(path, {})
        return set().union(*(by_line.get(line, set()) for line in lines))

    def _mentioning(self, name: str) -> set[str]:
        """Tests that run a line with this name; "*" is none."""
        word = re.compile(rf"\b{re.escape(name)}\b")
        found: set[str] = set()
        for path in [p for p in self._by_line if name != "*" and (self._root / p).exists()]:
            text = (self._root / path).read_text(encoding="utf-8").splitlines()
            found |= self._running(path, tuple(k for k, line in enumerate(text, 1) if word.search(line)))
        return found

    def _by_the_list(self, name: str) -> set[str]:
        """Tests that walk the list of all keys of the configuration, where this is one: no line of them names it."""
        listed = self._root / LIST_OF_KEYS
        keys = listed.read_text(encoding="utf-8") if listed.exists() else ""
        if not re.search(rf"^\S+\.{re.escape(name)} ", keys, re.MULTILINE):
            return set()
        files = {test.partition("::")[0] for test in self.seconds}
        walking = {file for file in files if WALKS_IT in (self._root / file).read_text(encoding="utf-8")}
        return {test for test in self.seconds if test.partition("::")[0] in walking}


def read_coverage(folder: Path) -> Coverage:
    """What all runs under coverage found."""
    whole: Coverage = {}
    for path in sorted(folder.glob("*.json")):
        whole |= json.loads(path.read_text(encoding="utf-8"))
    return whole
