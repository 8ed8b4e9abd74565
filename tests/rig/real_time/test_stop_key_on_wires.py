"""A key pressed, and pulled out, while a real run holds a press: its bytes, its record, and where the indentor is."""

import json
import os
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.data import read_run
from rig.engine import Journal
from rig.session.hardware_stop import BY_THE_BUTTON

pytest.importorskip("pty", reason="needs pseudo-terminals")
pytestmark = pytest.mark.usefixtures("empty_figures")

PRESSED = struct.pack("llHHi", 0, 0, 1, 30, 1)


@pytest.fixture
def held(
    whole: tuple[ServedBench, Path], rig: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[Callable[[], object]], Any]]:
    """A run of one press, and what is done when its hold begins."""
    pipe = tmp_path / "pedal"
    os.mkfifo(pipe)
    file = os.open(pipe, os.O_RDWR)
    config = whole[1]
    off, key = '[stop]\nkind = "off"\n', f'[stop]\nkind = "key"\ndevice = "{pipe}"\n'
    assert off in config.read_text(encoding="utf-8")
    config.write_text(config.read_text(encoding="utf-8").replace(off, key), encoding="utf-8")
    event = Journal.event

    def run(deed: Callable[[int], object]) -> Any:
        def seen(journal: Journal, stream: str, data: Mapping[str, Any]) -> None:
            event(journal, stream, data)
            if stream == "hold_start":
                deed(file)

        monkeypatch.setattr(Journal, "event", seen)
        arguments = ("run", "first_press", "presses=1", "hold_s=30", "--config", config, "--out", tmp_path / "runs")
        return rig(*arguments, "--yes", "--json", typed="\n")

    yield run
    os.close(file)


def test_a_press_stops_the_stage_at_once(held: Callable[..., Any]) -> None:
    ended = held(lambda file: os.write(file, PRESSED))
    assert ended.code == 130, ended.err
    assert BY_THE_BUTTON in ended.json["ending"]["reason_text"]
    run = read_run(Path(ended.json["run"]))
    assert run.stop is not None
    assert (run.stop["status"], run.stop["reason"]) == ("aborted", BY_THE_BUTTON)
    assert run.stop["indentor"]["left"] == "held"
    wire = [json.loads(line) for line in run.folder.bytes_log.read_text(encoding="ascii").splitlines()]
    (hold,) = run.events["hold_start"]
    sent = [chunk["hex"] for chunk in wire if chunk["dir"] == "tx" and chunk["t_s"] >= hold["t_s"]]
    assert "2118" in sent
    assert not [line for line in sent[sent.index("2118") :] if "5a" in line], "no move of Z after it"


def test_pulled_out_it_is_lifted_and_the_run_ends(held: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    read = os.read

    def unplugged(file: int) -> None:
        def refused(fd: int, count: int) -> bytes:
            if count == 64 * len(PRESSED):
                raise OSError(19, os.strerror(19))
            return read(fd, count)

        monkeypatch.setattr(os, "read", refused)
        os.write(file, PRESSED)

    ended = held(unplugged)
    assert ended.code == 1, ended.err
    assert ended.json["code"] == "button_gone"
    assert ended.json["ending"]["indentor"]["left"] == "lifted"
