"""Makers' client libraries that have an environment of their own, because they would not fit beside the others.

`make clients` makes them in `.clients/NAME`, from `requirements/clients/NAME.txt`; CLIENTS names another folder.
"""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def python_of(name: str) -> Path:
    """The interpreter of a client's environment; the test is skipped where there is none."""
    folder = Path(os.environ.get("CLIENTS", ROOT / ".clients")) / name
    for python in (folder / "bin" / "python", folder / "Scripts" / "python.exe"):
        if python.exists():
            return python
    return pytest.skip(f"make clients makes {folder}, the environment of the maker's client")
