"""Runs that commands read: standard error names what is damaged in a journal."""

from pathlib import Path

from rig.cli.output import complain
from rig.data.run import Run, read_run
from rig.data.tables import foreign_in_one_line


def recorded_run(path: Path) -> Run:
    """Read a run, and name its damage. Raises RunError."""
    with foreign_in_one_line(path):
        run = read_run(path)
    warn_of_damage(run)
    return run


def warn_of_damage(run: Run) -> None:
    """Print one line about a damaged journal."""
    if run.warning is not None:
        complain(run.warning)
