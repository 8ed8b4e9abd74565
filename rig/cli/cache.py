"""`rig cache`: what is kept on disk so that nothing is worked out twice, and how to be rid of it."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Annotated, Any

import typer

from rig.cli.options import JsonOption
from rig.cli.output import out, print_json, told_in_one_line
from rig.protocol.errors import BadInputError
from sim.models.cache import KINDS, Entry, cache_dir, entries, most_bytes, prune

_ABOUT = {
    "model": "condensed fingers",
    "node": "builds to interpolate between",
    "columns": "strain under them, a file for each set of receptors",
    "skin": "where a skin is highest",
    "answers": "what fingers said of runs",
    "sites": "SED under point loads at the source's 24 sites",
}


def command(
    prune_it: Annotated[bool, typer.Option("--prune", help="Remove it; all of it is made anew when needed.")] = False,
    keep_gb: Annotated[
        float,
        typer.Option(metavar="G", help="With --prune: but for what was read last, up to G GB.", min=0),
    ] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Say what is kept, and with --prune remove what was not read for longest."""
    with told_in_one_line(as_json=as_json):
        if keep_gb and not prune_it:
            raise BadInputError(
                "{option} {value:g}: says what {needs} leaves, expected {needs} too",
                code="needs_option", option="--keep-gb", value=keep_gb, needs="--prune",
            )  # fmt: skip
        limit_gb = most_bytes() / 1e9
        removed = prune(1e9 * keep_gb) if prune_it else []
        kept = entries()
        if as_json:
            print_json({
                "folder": str(cache_dir()), "entries": [_as_json(entry) for entry in kept], "bytes": _bytes(kept),
                "limit_gb": limit_gb, "removed": len(removed), "removed_bytes": _bytes(removed),
            })  # fmt: skip
            return
        _print(kept, limit_gb)
        if prune_it:
            out.print(f"removed     {len(removed)} files, {_megabytes(removed)}")


def _print(kept: Sequence[Entry], limit_gb: float) -> None:
    out.print(f"folder      {cache_dir()} (RIG_CACHE_DIR)")
    for kind in KINDS:
        them = [entry for entry in kept if entry.kind == kind]
        if them:
            last = f"read last {_read(them[0]):%Y-%m-%d}, longest ago {_read(them[-1]):%Y-%m-%d}"
            out.print(f"{kind:<12}{len(them)} files, {_megabytes(them)}: {_ABOUT[kind]}; {last}")
    out.print(f"in all      {_megabytes(kept)}; beyond {limit_gb:g} GB (RIG_CACHE_GB) what was read longest ago goes")


def _as_json(entry: Entry) -> dict[str, Any]:
    read = _read(entry).isoformat(timespec="seconds")
    return {"name": entry.path.name, "kind": entry.kind, "bytes": entry.size, "read_utc": read}


def _read(entry: Entry) -> datetime:
    return datetime.fromtimestamp(entry.read_ns / 1e9, UTC)


def _bytes(them: Sequence[Entry]) -> int:
    return sum(entry.size for entry in them)


def _megabytes(them: Sequence[Entry]) -> str:
    return f"{_bytes(them) / 1e6:.1f} MB"
