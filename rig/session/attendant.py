"""Whoever looks on while a script is carried out."""

from collections.abc import Mapping
from typing import Any, Protocol

from rig.data import RunFolder


class Attendant(Protocol):
    """Whoever looks on: sees every event, may ask for a pause or stop, and says whether to go on after a pause."""

    def stopped(self) -> bool:
        """Whether somebody has stopped the stage from another thread; asked where something has failed."""

    def begins(self, folder: RunFolder) -> None:
        """Ports are open and the journal in this folder has begun: from now on something may move."""

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        """An event is on disk."""

    def interrupted(self) -> bool:
        """Whether a pause is asked for at the next safe point."""

    def go_on(self) -> bool:
        """Whether the run goes on after the pause."""


class Nobody:
    """Looks on and asks for nothing."""

    def stopped(self) -> bool:
        """No."""
        return False

    def begins(self, folder: RunFolder) -> None:
        """Nothing comes of it."""

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        """Nothing comes of it."""

    def interrupted(self) -> bool:
        """No."""
        return False

    def go_on(self) -> bool:
        """No."""
        return False
