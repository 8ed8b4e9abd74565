"""`rig init` on the ports of `rig serve`: every stage and every force sensor, on pseudo-terminals and on TCP."""

import threading
from collections.abc import Callable, Iterator
from itertools import cycle
from operator import attrgetter
from pathlib import Path

import pytest

from rig.bench.checks import bench_problems, look
from rig.bench.find_devices import find_devices
from rig.bench.served import ServedBench
from rig.cli import init
from rig.clock import WallClock
from rig.devices.registry import BUILT_IN, ForceKind, StageKind, find, stage_ports
from rig.plan.config import Config, load_config
from tests.program import INIT_ANSWERS, Program

pytest.importorskip("pty", reason="needs pseudo-terminals")

STAGES = BUILT_IN["stage"]
SENSORS = [name for name in BUILT_IN["force"] if find(ForceKind, name).probe]

Serve = Callable[..., list[str]]


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Serve one device in a thread; the sensor bears no finger."""
    running: list[tuple[ServedBench, threading.Thread]] = []

    def served(room: str, kind: str, way: str) -> list[str]:
        other = {"stage": None, "force": None, room: kind}
        bench = ServedBench(Config(), stage=other["stage"], force=other["force"], tcp=0 if way == "tcp" else None)
        thread = threading.Thread(target=bench.run)
        thread.start()
        running.append((bench, thread))
        return list(bench.ports.values())

    yield served
    for bench, thread in running:
        bench.stop()
        thread.join()
        bench.close()


@pytest.mark.quick(rows=lambda way: way == "pty")
@pytest.mark.parametrize("way", ["pty", "tcp"])
def test_every_device_is_found_and_its_file_is_right(
    way: str, serve: Serve, program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """All ports are asked at the same time; then the command runs for every stage on what its ports have answered."""
    of_stage = {kind: serve("stage", kind, way) for kind in STAGES}
    of_force = {kind: serve("force", kind, way)[0] for kind in SENSORS}
    expected = {port: ("stage", kind, None) for kind, ports in of_stage.items() for port in ports}
    expected |= {port: ("force", kind, None) for kind, port in of_force.items()}
    answers = {one.port: one for one in find_devices(expected, WallClock())}
    found = {port: one.as_json() for port, one in answers.items()}
    assert {port: (one["role"], one["kind"], one["code"]) for port, one in found.items()} == expected
    monkeypatch.setattr(init, "find_devices", lambda ports, clock: [answers[port] for port in ports])
    for stage, force in zip(STAGES, cycle(SENSORS), strict=False):
        ports, to = of_stage[stage], tmp_path / f"{stage}.toml"
        words = [word for port in (of_force[force], *ports) for word in ("--port", port)]
        words += ["--stage-port", ports[0]] if len(ports) > 1 else []
        ended = program("init", "--yes", "--json", "--to", to, *words, *INIT_ANSWERS)
        assert ended.code == 0, ended.err
        assert {one["port"]: one for one in ended.json["ports"]} == {p: found[p] for p in (of_force[force], *ports)}
        config = load_config(to)
        assert (stage_ports(config.stage), config.force.port) == (tuple(ports), of_force[force])
        assert bench_problems(config) == []
        its_stage, its_sensor = look(config, closely=True)
        assert its_stage["identity"], "the driver connects with that file"
        assert its_sensor["force_n"] == 0.0
        of_stage_kind = find(StageKind, stage)
        own = getattr(config.stage, of_stage_kind.place, None)
        for port, key in zip(ports, of_stage_kind.serial_keys, strict=bool(of_stage_kind.serial_keys)):
            assert answers[port].serial is not None
            assert attrgetter(key)(own) == answers[port].serial


def test_swapped_ports_are_noticed(serve: Serve, program: Program, tmp_path: Path) -> None:
    (stage,), (force,) = serve("stage", "grbl", "pty"), serve("force", "mtsics", "pty")
    to = tmp_path / "rig.toml"
    ended = program(
        "init", "--yes", "--json", "--to", to, "--stage-port", force, "--sensor-port", stage, *INIT_ANSWERS
    )
    assert (ended.code, ended.error_code, to.exists()) == (2, "swapped_ports", False)
