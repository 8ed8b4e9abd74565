"""Order of names that contain numbers: 1 gwt, 2 gwt, 10 gwt."""

import re

_NUMBER = re.compile(r"((?:(?<![\w.])[-−])?\d+(?:\.\d+)?)")


def natural_order(name: str) -> tuple[str | float, ...]:
    """Return a key that sorts names by the numbers in them.

    Parameters
    ----------
    name : str
        Name such as ``"bar:3.0 to 10 gwt"``; a minus sign before a number counts if no letter stands before it.

    Returns
    -------
    tuple of str and float
        Text and numbers in turn, so that keys of any two names can be compared.

    Examples
    --------
    >>> sorted(["step:1 at 10 gwt", "step:1 at 2 gwt", "bar:1.5"], key=natural_order)
    ['bar:1.5', 'step:1 at 2 gwt', 'step:1 at 10 gwt']
    """
    parts = _NUMBER.split(name)
    return tuple(float(part.replace("−", "-")) if k % 2 else part for k, part in enumerate(parts))
