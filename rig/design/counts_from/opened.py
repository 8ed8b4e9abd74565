"""Open a source of counts from the text that names it."""

import importlib
import sys
from pathlib import Path
from typing import NamedTuple

from rig.design.counts import CountModel
from rig.design.counts_from.growing_file import GrowingFile
from rig.design.counts_from.source import CountSource
from rig.design.exceptions import DesignError
from rig.design.response_table import CANDIDATES, ResponseTable
from rig.errors import CountError
from rig.plan.config import Config

VIRTUAL, LSL, FILE = "virtual:", "lsl:", ".csv"
_MOST_SEED = 1_000_000
_KINDS = "COUNTS.csv, lsl:STREAM, virtual:SA1, virtual:MEASURE, or module:function of your own"


class VirtualName(NamedTuple):
    """A virtual nerve: its candidate or afferent, and its seed."""

    name: str
    seed: int


def virtual_name(text: str) -> VirtualName | None:
    """Return the virtual nerve that a text names, e.g. virtual:SA1@3; None for a recorded one. Raises DesignError."""
    from rig.design.counts_from.virtual_nerve import AFFERENT

    if not text.startswith(VIRTUAL):
        return None
    name, _, seed = text.removeprefix(VIRTUAL).partition("@")
    if name not in (AFFERENT, *CANDIDATES):
        known = ", ".join((AFFERENT, *CANDIDATES))
        raise DesignError(f"counts={text}: there is no virtual nerve {name}; use one of {known}", "unknown_nerve")
    if seed and not (seed.isascii() and seed.isdigit() and int(seed) < _MOST_SEED):
        raise DesignError(f"counts={text}: the seed must be 0 to {_MOST_SEED - 1}", "bad_seed")
    return VirtualName(name, int(seed or 0))


def refuse_source(text: str) -> None:
    """Raise DesignError for a text that names no source."""
    own, _, function = text.partition(":")
    if virtual_name(text) is not None or text.endswith(FILE) or (text.startswith(LSL) and function):
        return
    if not (own and function and all(part.isidentifier() for part in [*own.split("."), function])):
        raise DesignError(f"counts={text}: must be {_KINDS}", "no_source")


def opened(text: str, config: Config, table: ResponseTable, model: CountModel) -> CountSource:
    """Return the source that a text names, open. Raises CountError."""
    virtual = virtual_name(text)
    if virtual is not None:
        from rig.design.counts_from.virtual_nerve import AFFERENT, VirtualAfferent, VirtualFiber

        if virtual.name == AFFERENT:
            return VirtualAfferent(virtual.seed, config, model)
        return VirtualFiber(virtual.name, virtual.seed, table, model)
    if text.endswith(FILE):
        return GrowingFile(Path(text))
    if text.startswith(LSL):
        from rig.design.counts_from import lsl_stream

        return lsl_stream.opened(text.removeprefix(LSL))
    module, _, function = text.partition(":")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    try:
        source: CountSource = getattr(importlib.import_module(module), function)()
    except CountError:
        raise
    except Exception as error:
        raise CountError(f"counts={text}: {type(error).__name__}: {error}", "source_failed") from None
    return source
