"""Numbers with their nouns: 1 press, 2 presses."""

import re


def number_of(number: int, plural: str) -> str:
    """Return a number and its noun, given in the plural: 1 "other presses in contact" is "1 other press in contact".

    For one, the first word that ends in s loses its ending.
    """
    return f"{number} {one_of(plural) if number == 1 else plural}"


def one_of(plural: str) -> str:
    """Return a noun in the singular, with the words around it."""
    return re.sub(r"(?:(?<=ss)es|(?<=[cs]h)es|(?<!s)s)\b", "", plural, count=1)
