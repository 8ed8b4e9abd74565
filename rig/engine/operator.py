"""Who stands at the bench."""

from typing import Protocol


class Operator(Protocol):
    """Whoever stands at the bench: a person, or the virtual plant of a dry-run."""

    def mount(self, indentor: str) -> str:
        """Put this indentor on the carriage; returns the name of the one that is on then."""

    def confirm(self, request: str) -> None:
        """Do what is asked for before anything moves; returns when it is done."""

    def true_pose(self) -> tuple[float, float] | None:
        """True x and DOI in mm where they can be known (a virtual bench), else None."""
