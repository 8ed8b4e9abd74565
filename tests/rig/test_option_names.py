"""An option has one meaning, whichever command it belongs to."""

from collections import defaultdict
from typing import Any

import typer

from rig.cli import program as commands
from rig.cli.program import COMMANDS


def _options() -> dict[str, dict[str, str]]:
    """Kind of value of each option, by command."""
    found: dict[str, dict[str, str]] = defaultdict(dict)
    for name in COMMANDS:
        one: Any = typer.main.get_command(commands._app([name])).commands[name]
        for command in getattr(one, "commands", {name: one}).values():
            for param in command.params:
                for option in param.opts if param.param_type_name == "option" else ():
                    found[option][f"{name} {command.name}"] = "flag" if param.is_flag else "value"
    return found


def test_no_option_is_a_flag_on_one_command_and_takes_a_value_on_another() -> None:
    kinds = {option: by_command for option, by_command in _options().items() if len(set(by_command.values())) > 1}
    assert kinds.keys() <= KNOWN.keys(), kinds


KNOWN = {  # the flag concerns the same thing as the value
    "--choose": "`rig check --choose` checks the presses that the source of `rig run --choose SOURCE` may choose",
    "--columns": "`rig show --columns` lists columns of runs, `rig compare --columns` names those of recordings",
}
