"""Numbers as people write them in files and options."""


def read_number(text: str) -> float:
    """Return the number that a text is, which may be NaN or infinite as with float(). Raises ValueError.

    float() alone also reads `1_0` as 10, and the digits of all scripts. In a table these are typing errors, or what
    another program reads otherwise.
    """
    text = text.strip()
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a number in the digits 0 to 9")
    return float(text)
