"""The process that has the bench by hand: begun when a page asks for it, and left when the panel ends."""

import asyncio
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

from rig.errors import RigError
from rig.panel.owners import Find
from rig.session.control.announcements import ControlError

READY_S = 15.0
_LOOK_S = 0.05


class NotTakenError(RigError):
    """The bench could not be taken. One line."""

    default_code = "not_taken"


def words(config: Path | None) -> list[str]:
    """What it is begun with."""
    return [sys.executable, "-m", "rig", "by-hand", "--config", str(config)]


class ByHandProcess:
    """At most one; it owns the ports, and ends with this process."""

    def __init__(self, config: Path | None, find: Find) -> None:
        self._config, self._find = config, find
        self._process: subprocess.Popen[bytes] | None = None
        self._said: IO[bytes] | None = None
        self._taking = asyncio.Lock()

    async def take(self) -> None:
        """Begin it, and wait until it has announced itself. Raises NotTakenError."""
        async with self._taking:
            if await asyncio.to_thread(self._announced):
                return
            await self.ended()
            self.forget()
            self._process = self._begun()
            for _ in range(round(READY_S / _LOOK_S)):
                if await asyncio.to_thread(self._announced):
                    return
                if self._process.poll() is not None:
                    if self.last_words:
                        raise NotTakenError("{said}", code="refused", said=self.last_words)
                    code = self._process.returncode
                    raise NotTakenError("it ended with exit code {exit_code}", code="ended", exit_code=code)
                await asyncio.sleep(_LOOK_S)
            self._process.terminate()
            raise NotTakenError("the bench did not answer within {within_s:g} s", code="no_reply", within_s=READY_S)

    async def ended(self) -> None:
        """Wait until it is there no more: it has the ports longer than its note says. Raises NotTakenError."""
        for _ in range(round(READY_S / _LOOK_S)):
            if self._process is None or self._process.poll() is not None:
                return
            await asyncio.sleep(_LOOK_S)
        raise NotTakenError("the bench was not left within {within_s:g} s", code="not_left", within_s=READY_S)

    def leave(self) -> None:
        """Have it leave the bench, where it is there."""
        if self._process is None or self._process.poll() is not None:
            return
        for owner in self._find():
            if owner.pid == self._process.pid:
                with suppress(ControlError):
                    owner.ask("leave", within_s=1.0)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(READY_S)

    def forget(self) -> None:
        """What the last one said."""
        if self._said is not None:
            self._said.close()
            self._said = None

    @property
    def last_words(self) -> str:
        """The last line of one that has ended otherwise than it was asked to; else none."""
        if self._said is None or self._process is None or self._process.poll() in (None, 0):
            return ""
        self._said.seek(0)
        said = self._said.read().decode("utf-8", "replace").strip().splitlines()
        return said[-1].removeprefix("rig: ") if said else ""

    def _begun(self) -> "subprocess.Popen[bytes]":
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  # until it is forgotten
        return subprocess.Popen(
            words(self._config),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._said,
            start_new_session=True,  # Ctrl-C is the panel's
        )

    def _announced(self) -> bool:
        process = self._process
        there = process is not None and process.poll() is None
        return there and any(owner.pid == process.pid for owner in self._find() if process is not None)
