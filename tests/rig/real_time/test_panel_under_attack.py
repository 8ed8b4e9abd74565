"""STOP and the operator's page beside every attack of other programs on the panel, with 1 024 descriptors."""

import subprocess
from collections.abc import Callable
from http.client import HTTPException
from pathlib import Path

import pytest

from tests.faults.panel_attacks import ATTACKS, BIG, under
from tests.faults.panel_under_attack import panel_under_attack
from tests.preloaded import Popen
from tests.program import beside_progress
from tests.waiting import DEADLINE_S, until

pytest.importorskip("resource")

DESCRIPTORS, CONNECTIONS = 1024, 1200
AGAIN_S = 30.0
"""A page repeats STOP far sooner; nothing here depends on it."""
MOST_LINES = 8
"""Two loggers of two levels, a line of each in a minute."""
IN_SUITE = ("half_requests", "slow_bodies_with_token", "streams_with_token", "requests", "resets", "no_descriptors")
"""One attack of each kind: held, slow, streams, flooding, reset, no descriptor."""


def answered(ask: Callable[[], int]) -> int:
    """The status of the first answer; as a page does, ask again where the connection is lost."""

    def tried() -> int:
        try:
            return ask()
        except (OSError, HTTPException):
            return 0

    return until(tried)


@pytest.mark.quick(rows=lambda name: name in IN_SUITE)
@pytest.mark.parametrize("name", ATTACKS)
def test_stop_is_answered_beside_every_attack(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "Popen", Popen)
    attack = ATTACKS[name]
    (tmp_path / "runs" / "a").mkdir(parents=True)
    with open(tmp_path / "runs" / "a" / BIG, "wb") as big:
        big.truncate(1 << 28)
    with panel_under_attack(tmp_path, DESCRIPTORS) as panel:
        assert answered(lambda: panel.stop(DEADLINE_S) == 200)
        with under(name, panel.port, panel.token, CONNECTIONS):
            if attack.takes_descriptors:
                panel.use_up_descriptors()
            for _ in range(3):
                panel.stops_s.clear()
                assert answered(lambda: panel.stop(AGAIN_S) == 200)  # else 503: sent, and not yet answered
                assert panel.stops_s
            streams = 503 if name == "streams_with_token" else 200
            assert answered(lambda: panel.stream(AGAIN_S)) == streams or attack.known
        assert panel.process.poll() is None
        lines = beside_progress(panel.log.read_text("utf-8")).splitlines()
        assert len(lines) <= MOST_LINES
        assert not any(line.startswith("Traceback") for line in lines)


@pytest.mark.parametrize("name", ["half_requests", "no_descriptors"])
def test_stop_over_the_page_s_own_connection_is_answered_while_both_ports_are_attacked(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subprocess, "Popen", Popen)
    with panel_under_attack(tmp_path, DESCRIPTORS) as panel, panel.connected(DEADLINE_S) as wire:
        assert panel.status(wire, "POST", "/stop") == 200
        with (
            under(name, panel.port, panel.token, CONNECTIONS),
            under(name, panel.stop_port, panel.token, CONNECTIONS),
        ):
            if ATTACKS[name].takes_descriptors:
                panel.use_up_descriptors()
            panel.stops_s.clear()
            own = wire.sock
            for _ in range(3):
                assert panel.status(wire, "POST", "/stop") == 200
            assert wire.sock is own, "it was not opened anew"
            assert len(panel.stops_s) == 3
