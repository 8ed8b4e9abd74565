"""A run in a process of its own, for what asks it over its socket."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rig.control.client import Announced, announced
from tests.preloaded import Popen
from tests.program import WHOLE
from tests.waiting import DEADLINE_S, until

STOP = "2118"  # feed hold and reset


class Elsewhere:
    """`rig COMMAND` in a process of its own, and what it announces."""

    def __init__(self, out: Path, *words: object) -> None:
        command = [sys.executable, WHOLE, *map(str, words)]
        self.out = out
        self._read, self._documents = 0, list[Any]()
        self.process = Popen(
            [*command, "--out", str(out)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdin is not None
        self.process.stdin.write("\n" * 9)
        self.process.stdin.flush()
        self.one: Announced = self.comes_to(lambda: next((o for o in announced() if o.pid == self.process.pid), None))

    def comes_to(self, look: Callable[[], Any]) -> Any:
        """What look() finds; the process must not end before."""
        found: list[Any] = []
        until(lambda: found.append(look()) or found[-1] or self.process.poll() is not None)
        assert found[-1], self.process.communicate()
        return found[-1]

    def ask(self, do: str) -> dict[str, Any]:
        return self.one.ask(do, within_s=DEADLINE_S)

    def is_at(self, state: str) -> Callable[[], bool]:
        return lambda: self.ask("status")["state"] == state

    def end(self) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=DEADLINE_S)
        return self.process.returncode, out, err

    @property
    def folder(self) -> Path:
        (found,) = (path for path in self.out.iterdir() if not path.name.startswith("."))
        return found

    @property
    def documents(self) -> list[Any]:
        """Of its journal, of which each look reads only what was written since the last one."""
        for journal in self.out.glob("*/events.jsonl"):
            with journal.open("rb") as file:
                file.seek(self._read)
                whole = file.read().rpartition(b"\n")[0]
            if whole:
                self._read += len(whole) + 1
                self._documents += map(json.loads, whole.split(b"\n"))
        return self._documents

    @property
    def sent(self) -> list[str]:
        """What went to the devices, as hex."""
        lines = map(json.loads, (self.folder / "bytes.jsonl").read_text(encoding="ascii").splitlines())
        return [line["hex"] for line in lines if line["dir"] == "tx"]


def at_phase(phase: str) -> Callable[[Elsewhere], bool]:
    return lambda run: any(one.get("data", {}).get("phase") == phase for one in run.documents)
