"""Text for a terminal: control characters as escape sequences of Python; lists of words."""

import unicodedata
from collections.abc import Sequence


def printable(text: str) -> str:
    r"""Return a text in which control characters are visible.

    Names of files, notes, answers of devices and fields of journals may contain anything: sequences that clear the
    screen or set its title, marks that reverse the direction of writing, halves of surrogate pairs. Line feeds and
    tabs remain.

    Examples
    --------
    >>> print(printable("run\x1b[2J \u202eon"))
    run\x1b[2J \u202eon
    """
    if text.isprintable():
        return text
    return "".join(one if _harmless(one) else one.encode("unicode_escape").decode("ascii") for one in text)


def _harmless(character: str) -> bool:
    return character.isprintable() or character in "\n\t" or unicodedata.category(character) == "Zs"


def on_one_line(text: str) -> str:
    """Return a printable text on one line, with visible line feeds."""
    return printable(text).replace("\n", "\\n")


def either(words: Sequence[str]) -> str:
    """Return words with commas between them and "or" before the last; an empty text for none."""
    return " or ".join(part for part in (", ".join(words[:-1]), *words[-1:]) if part)
