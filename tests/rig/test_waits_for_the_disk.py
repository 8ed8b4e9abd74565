"""Which runs are flushed to the disk: those that move something."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import rig.session.session as sessions
from rig.bench.virtual import virtual_bench
from rig.control.owned_stage import OwnedStage
from rig.session.execute import Live
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip
from tests.program import Program

SCRIPT = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    rig.indent(doi_mm=0.2, hold_s=0.1)
"""


@pytest.mark.parametrize("command", ["run", "dry-run"])
def test_each_step_of_a_run_is_flushed_to_disk_before_the_next_begins(
    command: str, finger: Fingertip, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def open_bench(config: Any, clock: Any, log: Any, ask: Any, pause: Any, stage: Any) -> Any:
        bench = virtual_bench(config, finger, log, VirtualClock(0.0, clock.monotonic_s()), pause)
        return replace(bench, virtual=False)  # type: ignore[arg-type]

    synced: dict[int, int] = {}
    monkeypatch.setattr(os, "fsync", lambda fd: synced.update({os.fstat(fd).st_ino: os.fstat(fd).st_size}))
    begun: list[tuple[int, int | None]] = []
    handle = Live.handle

    def sizes(live: Live, step: Any, place: Any) -> Any:
        (folder,) = (tmp_path / "runs").iterdir()
        journal = (folder / "events.jsonl").stat()
        begun.append((journal.st_size, synced.get(journal.st_ino)))
        return handle(live, step, place)

    monkeypatch.setattr(Live, "handle", sizes)
    monkeypatch.setattr(sessions, "open_bench", open_bench)
    monkeypatch.setattr(OwnedStage, "open", lambda stage: stage)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    for port in ("stage", "force"):
        (tmp_path / port).touch()
    ports = f"[stage]\nport = '{tmp_path / 'stage'}'\n[force]\nport = '{tmp_path / 'force'}'\n"
    (tmp_path / "rig.toml").write_text(ports, encoding="utf-8")
    options = ["--config", "rig.toml", "--yes"] if command == "run" else []
    assert program(command, "mine.py", *options).code == 0
    (folder,) = (tmp_path / "runs").iterdir()
    journal = (folder / "events.jsonl").stat()
    begun.append((journal.st_size, synced.get(journal.st_ino)))
    sizes_of_steps = [size for size, _ in begun]
    assert len(begun) == 6
    assert sizes_of_steps == sorted(set(sizes_of_steps)), "each step is recorded"
    assert [flushed for _, flushed in begun] == (sizes_of_steps if command == "run" else [None] * 6)
