"""One figure or table of the source: its claims, what is pressed for it, what is drawn."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from rig.report.page_parts import PageFigure, Section
from studies.source.printed.answers import FingerAnswers, PrintedPress
from studies.source.printed.rules import Measured, Near, Rule, Word

Verdict = Literal["agrees", "partly", "differs", "cannot be said", "out of scope", "a page of its own"]
VERDICTS: tuple[Verdict, ...] = ("agrees", "partly", "differs", "cannot be said", "out of scope", "a page of its own")

ALONE = ".venv/bin/python -m studies.source.pages study --only {}"
"""The command that makes one entry alone."""


@dataclass(frozen=True)
class Claim:
    """One thing that the source says and the model can be asked."""

    says: str
    source: str  # its number or word, as printed
    rule: Rule
    ours: Callable[[FingerAnswers], Measured]
    form: str = "{:.2f}"  # how ours is written, with its unit
    beside: Callable[[FingerAnswers], str] | None = None  # what is told beside ours


@dataclass(frozen=True)
class CheckedClaim:
    """A claim with what the model gave."""

    claim: Claim
    value: Measured
    beside: str = ""

    @property
    def word(self) -> Word:
        """The verdict."""
        return self.claim.rule.verdict(self.value)

    @property
    def ours(self) -> str:
        """The value as a table has it."""
        number = self.value if isinstance(self.value, str) else self.claim.form.format(self.value)
        return typeset(number) + (f" ({typeset(self.beside)})" if self.beside else "")

    @property
    def difference(self) -> str:
        """As a table has it."""
        found = self.claim.rule.difference(self.value)
        return "–" if found is None else typeset(found[1].format(found[0]))

    @property
    def ratio(self) -> float | None:
        """Ours over a printed number; None where none is printed."""
        rule = self.claim.rule
        return float(self.value) / rule.value if isinstance(rule, Near) else None

    @property
    def row(self) -> tuple[str, ...]:
        """As cells."""
        return (
            typeset(self.claim.says),
            self.claim.source,
            self.ours,
            self.difference,
            self.word,
            self.claim.rule.bounds,
        )


HEADER = ("what", "the source", "here", "difference", "verdict", "bounds of agrees, partly")


def typeset(text: str) -> str:
    """With typographic signs."""
    return text.replace("-", "−").replace("pseudo−", "pseudo-").replace("%", " %").replace("  %", " %")


def _nothing(_: FingerAnswers) -> tuple[PageFigure, ...]:
    return ()


def _no_tables(_: FingerAnswers) -> tuple[Section, ...]:
    return ()


@dataclass(frozen=True)
class Entry:
    """A row of the matrix. Where nothing is claimed, one of `missing`, `outside` and `elsewhere` says why not."""

    number: str  # the source's own, or the part of a chapter where none is known
    shows: str
    claims: tuple[Claim, ...] = ()
    scenes: tuple[PrintedPress, ...] = ()
    figures: Callable[[FingerAnswers], tuple[PageFigure, ...]] = _nothing
    tables: Callable[[FingerAnswers], tuple[Section, ...]] = _no_tables
    reading: str = ""
    missing: str = ""  # the datum without which nothing can be said
    outside: str = ""  # why it is out of scope
    elsewhere: str = ""  # the page that has all of it
    made_by: str = ""  # the command, where it is another one

    @property
    def key(self) -> str:
        """For anchors and the command line."""
        return re.sub(r"[^a-z0-9]+", "-", self.number.lower().replace(" … ", "-to-")).strip("-")

    @property
    def command(self) -> str:
        """What makes it again."""
        return self.made_by or ALONE.format(self.key)


@dataclass(frozen=True)
class MatrixRow:
    """An entry with what was found."""

    entry: Entry
    found: tuple[CheckedClaim, ...]

    @property
    def verdict(self) -> Verdict:
        """Of all claims together, where a verdict can be given."""
        if self.entry.outside or self.entry.missing:
            return "out of scope" if self.entry.outside else "cannot be said"
        return together([one.word for one in self.found]) if self.found else "a page of its own"

    @property
    def claims(self) -> tuple[tuple[str, ...], ...]:
        """The table of claims; without verdicts where none can be given."""
        judged = self.verdict in VERDICTS[:3]
        return tuple(one.row if judged else (*one.row[:-2], "–", "–") for one in self.found)

    @property
    def told(self) -> str:
        """The verdict with its count."""
        agree = sum(one.word == "agrees" for one in self.found)
        return f"{self.verdict} ({agree} of {len(self.found)})" if self.verdict == "partly" else self.verdict

    @property
    def headline(self) -> CheckedClaim | None:
        """The claim that is farthest from the source, the first of several; None where nothing is claimed."""
        return max(self.found, key=lambda one: VERDICTS.index(one.word), default=None)


def together(words: Sequence[Word]) -> Word:
    """All agree: agrees; all differ: differs; else partly."""
    kinds = set(words)
    return words[0] if len(kinds) == 1 else "partly"


def found(entry: Entry, answers: FingerAnswers) -> MatrixRow:
    """Every claim measured."""
    return MatrixRow(
        entry,
        tuple(CheckedClaim(c, c.ours(answers), "" if c.beside is None else c.beside(answers)) for c in entry.claims),
    )


def scenes_of(entries: Iterable[Entry]) -> list[PrintedPress]:
    """What all of them press, each once."""
    return list(dict.fromkeys(scene for entry in entries for scene in entry.scenes))
