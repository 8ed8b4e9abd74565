"""What a run's report is asked for, where the finger is: only there are libraries that draw."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rig.data import Run

if TYPE_CHECKING:
    from sim.models.fingertip import Fingertip


def make_report(finger: "Fingertip", run: Run, wall_s: float, ending: Mapping[str, str] | None) -> None:
    """The report of a run that has just ended. Raises OSError."""
    from rig.report.run.run_report import write_report

    write_report(run, finger, wall_s, ending)


def make_missing(finger: "Fingertip", run: Run) -> None:
    """What a complete run lacks of it. Raises OSError."""
    from rig.report.run.run_report import write_missing

    write_missing(run, finger)


def lacks_report(run: Run) -> bool:
    """Whether the report, or numbers behind its figures, are missing."""
    from rig.report.run import run_report

    return run_report.lacks_report(run)
