"""`rig config`: every key of the configuration, what it is for, and what it is set to."""

from collections.abc import Sequence
from difflib import get_close_matches
from itertools import groupby
from typing import Annotated

import typer

from rig.cli.options import FingerConfigOption, JsonOption
from rig.cli.output import out, print_json, told_in_one_line
from rig.plan.config import load_config
from rig.plan.config_keys import Key, as_toml, keys
from rig.protocol.errors import BadInputError

HEAD = """# Configuration reference

Every table and key of a configuration file, as `rig config --markdown` writes it. `rig config` prints the same as a
file to begin with, `rig config KEY` one key or table; with `--config rig.toml` it says what that file sets. An
unknown key is an error; a key without a default here is absent unless it is given.
"""


def command(
    key: Annotated[str | None, typer.Argument(metavar="[KEY]", help="A key or a table, such as limits.")] = None,
    config: FingerConfigOption = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="As the reference in the documentation.")] = False,
    as_json: JsonOption = False,
) -> None:
    """A configuration file with a line about each key; of one key or table if that is named."""
    with told_in_one_line(as_json=as_json):
        found = _named(list(keys(load_config(config))), key)
        if as_json:
            print_json({"keys": [_described(one) for one in found]})
        else:
            out.print(
                _page(found) if markdown else _file(found), markup=False, highlight=False, soft_wrap=True, end=""
            )


def _named(every: Sequence[Key], name: str | None) -> list[Key]:
    """All keys, those of a table and its tables, or those of a name. Raises BadInputError."""
    if name is None:
        return list(every)
    found = [one for one in every if name in (one.place, one.name) or f"{one.place}.".startswith(f"{name}.")]
    if not found:
        whole = "." in name
        known = dict.fromkeys(word for one in every for word in (one.place if whole else one.name, one.table))
        near = " or ".join(get_close_matches(name, known, n=2)) or "a key or table that `rig config` lists"
        raise BadInputError(
            "{key}: there is no such key, expected {expected}", code="unknown_key", key=name, expected=near
        )
    return found


def _file(found: Sequence[Key]) -> str:
    tables = groupby(found, lambda one: one.table)
    return "\n".join(f"[{table}]\n" + "".join(one.lines for one in members) for table, members in tables)


def _page(found: Sequence[Key]) -> str:
    parts = [HEAD]
    for table, members in groupby(found, lambda one: one.table):
        parts += [f"\n## `[{table}]`\n\n| key | default | unit and range | what it is |\n|---|---|---|---|\n"]
        parts += [_row(one) for one in members]
    return "".join(parts)


def _row(one: Key) -> str:
    default = "" if one.default is None else f"`{as_toml(one.default)}`"
    return f"| `{one.name}` | {default} | {one.allowed_in_words.replace('|', 'or')} | {one.what} |\n"


def _described(one: Key) -> dict[str, object]:
    told = {"key": one.place, "value": one.value, "default": one.default}
    return told | {"unit": one.unit, "allowed": one.allowed, "what": one.what}
