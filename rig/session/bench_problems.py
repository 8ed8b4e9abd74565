"""What a configuration says that no bench can be: told by `rig check` and `rig doctor`, refused by `rig run`."""

import os
from collections.abc import Iterator

from rig.errors import around
from rig.plan.config import Config
from rig.protocol.errors import BadInputError
from rig.protocol.refusals import refuse_place


def bench_problems(config: Config) -> list[str]:
    """One line for each."""
    return [str(problem) for problem in _problems(config)]


def refuse_bench(config: Config) -> None:
    """Raises BadInputError for the first of them."""
    for problem in _problems(config):
        raise problem


def _problems(config: Config) -> Iterator[BadInputError]:
    force = config.force.port
    for port in config.stage.ports:
        if _same_port(port, force):
            yield BadInputError("stage.port and force.port: both are {port}, expected a port for each",
                                code="same_port", port=port)  # fmt: skip
    try:
        refuse_place(0.0, 0.0, config)
    except BadInputError as error:
        yield around(BadInputError, "frame: the pad at clearance: {problem}", error)
    apex_mm, lowest_mm = config.frame.apex_z_mm, -config.stage.travel_mm[2]
    if not lowest_mm <= apex_mm <= 0:
        yield BadInputError("{key} = {value:g}: outside the stage's travel, {low:g} … 0 mm",
                            code="apex_outside_travel", key="frame.apex_z_mm", value=apex_mm, low=lowest_mm,
                            high=0.0)  # fmt: skip


def _same_port(one: str, other: str) -> bool:
    """Under whichever of its names: a link by id is the device that it leads to."""
    return one == other or (os.path.exists(one) and os.path.exists(other) and os.path.samefile(one, other))
