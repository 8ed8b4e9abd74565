"""Runs that commands read: standard error names what is damaged in a journal, and a run that is incomplete."""

from pathlib import Path

from rig.cli.output import complain
from rig.data.run import Run, read_run
from rig.data.tables import alive, foreign_in_one_line, summary_of
from rig_shared.plural import number_of


def recorded_run(path: Path, *, prints_state: bool = False) -> Run:
    """Read a run, name its damage, and say if it is incomplete and the command does not. Raises RunError."""
    with foreign_in_one_line(path):
        run = read_run(path)
        about = alive(summary_of(run), path.parent)
    warn_of_damage(run)
    if about.state != "done" and not prints_state:
        planned = number_of(about.planned, "indentations")
        complain(f"run folder {path}: the run is incomplete ({about.state}): {about.done} of {planned} done")
    return run


def warn_of_damage(run: Run) -> None:
    """Print one line about a damaged journal, and one about other files that are not those of the run."""
    for warning in run.warnings:
        complain(warning)
