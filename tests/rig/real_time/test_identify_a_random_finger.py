"""A random finger served by one process and identified by another, over TCP; its truth stays in the server."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.data import read_run
from rig.identify.random_finger import truth_of
from rig.plan.config import Config
from rig.plan.finger_file import read_finger_file
from tests.program import Program
from tests.rig.real_time.conftest import NEAR, Serving, set_up
from tests.sim.coarse_mesh import coarse_mesh
from tests.waiting import read_too_late

SEED = 7  # it lies lower than is believed: NEAR has little room above it
KNOWN = Config.model_validate(
    {**NEAR, "finger": {"mesh": coarse_mesh(0.5, 0.7).model_dump()}, "virtual": {"indentor": "bar:3.0"}}
)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Serving]:
    """`rig serve --random-finger`, in a process of its own."""
    path = tmp_path / "bench.toml"
    path.write_text(KNOWN.as_toml(), encoding="utf-8")
    serving = Serving("--random-finger", str(SEED), "--tcp", "0", "--config", str(path))
    try:
        yield serving
    finally:
        if serving.process.poll() is None:
            serving.end(signal.SIGINT)


def test_a_random_finger_is_identified_over_tcp(rig: Program, served: Serving, tmp_path: Path) -> None:
    ports = served.ports()
    set_up(ports["stage"])
    config, file = tmp_path / "rig.toml", tmp_path / "finger.toml"
    here = {name: getattr(KNOWN, name).model_copy(update={"port": ports[name]}) for name in ("stage", "force")}
    config.write_text(KNOWN.model_copy(update=here).as_toml(), encoding="utf-8")
    asked = ("first_press", "presses=1", "--shapes", "bar:3.0", "--presses", 1, "--config", config, "--to", file)
    ended = rig("identify", *asked, "--out", tmp_path / "runs", "--yes", "--json", typed="\n")
    # A machine may be too busy to solve the finger in time for the balance, and says so; what was learned is kept.
    if ended.code:
        assert read_too_late(ended.err), ended.err
        assert "this machine is too busy" in served.end(signal.SIGINT)[2]
        return
    assert ended.json["presses"] == 1
    identified = read_finger_file(file).identified
    run = read_run(Path(ended.json["run"]))
    assert run.start["virtual"] is False
    assert identified.runs == (run.folder.path.name,)
    assert (run.folder.path / "identification.html").exists()
    told = {key for events in run.events.values() for event in events for key in event}
    assert not [key for key in told if key.startswith("true_")]
    kept = "".join(path.read_text(errors="replace") for path in run.folder.path.iterdir() if path.is_file())
    for value in truth_of(SEED).values():
        assert f"{value:.6f}" not in kept
    beside = rig("serve", "--reveal", SEED, "--beside", file, "--json").json["parameters"]
    assert all(one["low"] < one["high"] for one in beside)
