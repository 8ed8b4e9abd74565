"""Numbers with their nouns: 1 press, 2 presses."""

import re


def number_of(number: int, plural: str) -> str:
    """Return a number and its noun, which is in the singular for one.

    Parameters
    ----------
    number : int
        How many there are.
    plural : str
        Noun in the plural, perhaps after adjectives and before other words.

    Returns
    -------
    str
        The number, then the words; for one, the first word that ends in s loses its ending.

    Examples
    --------
    >>> number_of(1, "other presses in contact"), number_of(3, "fingers")
    ('1 other press in contact', '3 fingers')
    """
    return f"{number} {one_of(plural) if number == 1 else plural}"


def one_of(plural: str) -> str:
    """Return a noun in the singular, with the words around it."""
    return re.sub(r"(?:(?<=ss)es|(?<=[cs]h)es|(?<!s)s)\b", "", plural, count=1)
