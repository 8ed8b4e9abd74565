"""`rig run` on real ports, with the finger answering in real time; and how it is refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.data import read_run
from rig.session.early_ending import FinalPosition
from sim.models.fingertip import Fingertip
from tests.waiting import read_too_late, repeated

pytest.importorskip("pty", reason="needs pseudo-terminals")
pytestmark = pytest.mark.usefixtures("empty_figures")

Rig = Callable[..., Any]
NOT_MOVED = f"where   {FinalPosition('not moved').words}\n"
Apart = tuple[str, str, Path]


def test_a_protocol_on_a_real_wire(
    rig: Rig, whole: tuple[ServedBench, Path], finger: Fingertip, tmp_path: Path
) -> None:
    bench, config = whole
    clock = WallClock()
    began_s = clock.monotonic_s()
    ended = rig("run", "first_press", "presses=2", "hold_s=0.2", "--config", config, "--out", tmp_path / "runs",
                "--yes", "--json", typed="\n")  # fmt: skip
    assert "bar:3.0" in ended.err
    for _ in repeated(0.0):
        if not (ended.code and read_too_late(ended.err)):
            break
        # As a person would: go on with the run.
        ended = rig("resume", ended.json["run"], "--yes", "--json", typed="\n")
    assert ended.code == 0, ended.err
    answer = ended.json
    assert (answer["complete"], answer["indentations"]) == (True, 2)
    assert 2 * 0.2 < answer["duration_s"] < clock.monotonic_s() - began_s, "the holds, and what the command took"
    run = read_run(Path(answer["run"]))
    assert run.start["virtual"] is False
    # The virtual finger is the predicted one, so the force comes at the depth of the model's own answer.
    expected = finger.indent("bar:3.0", 0.0, force_gwt=1.0)
    for hold in run.stream("hold_end"):
        assert hold["force_gwt"] == pytest.approx(1.0, abs=0.05)
        assert hold["doi_mm"] == pytest.approx(expected.doi_mm, abs=0.02)
        assert "true_doi_mm" not in hold
    wire = [json.loads(line) for line in run.folder.bytes_log.read_text(encoding="ascii").splitlines()]
    assert {chunk["port"] for chunk in wire} == set(bench.ports.values())
    # A busy machine may solve some too late: each such reading was refused on the wire, and none made up.
    felt = b"".join(bytes.fromhex(c["hex"]) for c in wire if (c["port"], c["dir"]) == (bench.ports["force"], "rx"))
    assert bench.statistics is not None
    assert bench.statistics.unknown == felt.count(b"S I\r\n")
    assert bench.statistics.requested > felt.count(b"S D") + felt.count(b"S S") > 40


def test_run_needs_ports_that_are_there_and_leaves_nothing_otherwise(rig: Rig, tmp_path: Path) -> None:
    config = tmp_path / "rig.toml"
    config.write_text('[stage]\nport = "/dev/ttyNOWHERE7"\n', encoding="utf-8")
    ended = rig("run", "first_press", "--config", config, "--out", tmp_path / "runs")
    assert (ended.code, ended.out) == (1, "")
    assert ended.err.startswith(f"{NOT_MOVED}rig: ")
    assert "/dev/ttyNOWHERE7" in ended.err
    assert not list((tmp_path / "runs").iterdir())


def test_nobody_mounts(rig: Rig, apart: Apart, tmp_path: Path) -> None:
    _, _, config = apart
    ended = rig("run", "first_press", "--yes", "--config", config, "--out", tmp_path / "runs", "--json")
    assert (ended.code, ended.json["code"]) == (130, "nobody_answered")
    assert "bar:3.0" in ended.json["ending"]["reason_text"]
