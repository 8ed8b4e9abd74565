"""What a configuration says that no bench can be: told by `rig check` and `rig doctor`, refused by `rig run`."""

import os

from rig.plan.config import Config
from rig.protocol.errors import BadInputError
from rig.protocol.refusals import refuse_place


def bench_problems(config: Config) -> list[str]:
    """One line for each."""
    force = config.force.port
    shared = [port for port in config.stage.ports if _same_port(port, force)]
    found = [f"stage.port and force.port: both are {port}, expected a port for each" for port in shared]
    try:
        refuse_place(0.0, 0.0, config)
    except BadInputError as error:
        found.append(f"frame: the pad at clearance: {error}")
    apex_mm, lowest_mm = config.frame.apex_z_mm, -config.stage.travel_mm[2]
    if not lowest_mm <= apex_mm <= 0:
        found.append(f"frame.apex_z_mm = {apex_mm:g}: outside the stage's travel, {lowest_mm:g} … 0 mm")
    return found


def refuse_bench(config: Config) -> None:
    """Raises BadInputError for the first of them."""
    for problem in bench_problems(config):
        raise BadInputError(problem)


def _same_port(one: str, other: str) -> bool:
    """Under whichever of its names: a link by id is the device that it leads to."""
    return one == other or (os.path.exists(one) and os.path.exists(other) and os.path.samefile(one, other))
