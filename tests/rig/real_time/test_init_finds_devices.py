"""`rig init` on the ports of `rig serve`: every stage beside every force sensor, on pseudo-terminals and on TCP."""

import threading
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import pytest

from rig.bench.checks import bench_problems, look
from rig.bench.served import ServedBench
from rig.devices.registry import BUILT_IN, ForceKind, find, stage_ports
from rig.plan.config import Config, load_config
from tests.program import INIT_ANSWERS, Program

pytest.importorskip("pty", reason="needs pseudo-terminals")

FOUND = [name for name in BUILT_IN["force"] if find(ForceKind, name).probe]
PAIRS = list(product(BUILT_IN["stage"], FOUND))


def _way(stage: str, force: str) -> str:
    """Return how a pair is served, such that every device is found on both."""
    return ("pty", "tcp")[(BUILT_IN["stage"].index(stage) + BUILT_IN["force"].index(force)) % 2]


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


# Ports are asked one by one: each stage and each sensor on both ways, each stage beside two of the three.
@pytest.mark.quick(
    rows=lambda stage, force: force == "mtsics" or (force == "net_ft") == (stage in ("zaber", "standa"))
)
@pytest.mark.parametrize(("stage", "force"), PAIRS)
def test_the_devices_are_found_and_the_file_is_right(
    stage: str, force: str, serve: Serve, program: Program, tmp_path: Path
) -> None:
    way, to = _way(stage, force), tmp_path / "rig.toml"
    of_stage, (of_force,) = serve("stage", stage, way), serve("force", force, way)
    words = [word for port in (of_force, *of_stage) for word in ("--port", port)]
    words += ["--stage-port", of_stage[0]] if len(of_stage) > 1 else []
    ended = program("init", "--yes", "--json", "--to", to, *words, *INIT_ANSWERS)
    assert ended.code == 0, ended.err
    found = {one["port"]: (one["role"], one["kind"], one["code"]) for one in ended.json["ports"]}
    assert found == dict.fromkeys(of_stage, ("stage", stage, None)) | {of_force: ("force", force, None)}
    config = load_config(to)
    assert (stage_ports(config.stage), config.force.port) == (tuple(of_stage), of_force)
    assert bench_problems(config) == []
    seen = look(config, closely=True)
    assert seen["stage"]["identity"], "the driver connects with that file"
    assert seen["force"]["force_n"] == 0.0


def test_swapped_ports_are_noticed(serve: Serve, program: Program, tmp_path: Path) -> None:
    (stage,), (force,) = serve("stage", "grbl", "pty"), serve("force", "mtsics", "pty")
    to = tmp_path / "rig.toml"
    ended = program(
        "init", "--yes", "--json", "--to", to, "--stage-port", force, "--sensor-port", stage, *INIT_ANSWERS
    )
    assert (ended.code, ended.error_code, to.exists()) == (2, "swapped_ports", False)
