"""Order of names that contain numbers: 1 gwt, 2 gwt, 10 gwt."""

import re

_NUMBER = re.compile(r"((?:(?<![\w.])[-−])?\d+(?:\.\d+)?)")


def natural_order(name: str) -> tuple[str | float, ...]:
    """Return a key that sorts names by the numbers in them: "step:1 at 2 gwt" before "step:1 at 10 gwt".

    A minus sign before a number counts if no letter stands before it.
    """
    parts = _NUMBER.split(name)
    return tuple(float(part.replace("−", "-")) if k % 2 else part for k, part in enumerate(parts))
