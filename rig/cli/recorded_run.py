"""Runs that commands read: standard error names what is damaged in a journal, and a run that is incomplete."""

from pathlib import Path

from rig.cli.output import complain
from rig.data.run import Run, read_run
from rig.data.tables import foreign_in_one_line, summary_of


def recorded_run(path: Path, *, prints_state: bool = False) -> Run:
    """Read a run, name its damage, and say if it is incomplete and the command does not. Raises RunError."""
    with foreign_in_one_line(path):
        run = read_run(path)
        summary_of(run)
        incomplete = None if prints_state else run.incomplete
    warn_of_damage(run)
    if incomplete is not None:
        complain(incomplete)
    return run


def warn_of_damage(run: Run) -> None:
    """Print one line about a damaged journal, and one about other files that are not those of the run."""
    for warning in run.warnings:
        complain(warning)
