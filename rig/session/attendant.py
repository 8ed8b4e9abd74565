"""Whoever looks on while a script is carried out."""

from collections.abc import Mapping
from typing import Any, Protocol

from rig.data import RunFolder


class Attendant(Protocol):
    """Whoever looks on: sees every event, may ask for a pause, and says whether to go on after it."""

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
