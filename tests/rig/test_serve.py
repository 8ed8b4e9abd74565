"""`rig serve` and `rig run`: the same drivers, over real wires, with the finger answering in real time."""

import io
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rig.cli import main
from rig.clock import WallClock
from rig.data import read_run
from rig.force import MtSicsForce
from rig.protocol.config import Config
from rig.protocol.served_bench import ServedBench
from rig.stage import GrblStage
from rig.transport import open_port
from sim.devices import SerialLine, VirtualBalance
from sim.fingertip import Fingertip
from sim.serve.ports import PtyPort
from sim.wall_clock import WallScheduler

pytest.importorskip("pty", reason="needs pseudo-terminals")

# Close to the switches, on a board that homes fast: a short way to go in real time.
NEAR = {
    "frame": {"pad_centre_x_mm": -3.0, "pad_y_mm": -2.0, "apex_z_mm": -4.0},
    "force": {"baud": 115200, "sample_period_s": 0.02},
    "habits": {"clearance_mm": 0.4, "approach_speed_mm_s": 2.0, "press_speed_mm_s": 2.0},
}
FAST = (b"$110=3000", b"$111=3000", b"$112=3000", b"$120=500", b"$121=500", b"$122=500", b"$24=600", b"$25=3000",
        b"$26=10")  # fmt: skip


def set_up(port: str) -> None:
    """A board that homes in a second; its settings outlast the client, as in a real one."""
    wire, clock = open_port(port, 115200), WallClock()
    for line in FAST:
        wire.write(line + b"\n")
        heard = b""
        deadline_s = clock.monotonic_s() + 5.0
        while b"ok" not in heard and clock.monotonic_s() < deadline_s:
            heard += wire.read(0.1)
        assert b"ok" in heard, (line, heard)
    wire.close()


class Serving:
    """`rig serve` in a process of its own."""

    def __init__(self, *options: str) -> None:
        command = [sys.executable, "-c", "from rig.cli import main; main()", "serve", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def ports(self) -> dict[str, str]:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def end(self, number: signal.Signals) -> tuple[int, str, str]:
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=20)
        return self.process.returncode, out, err


@pytest.fixture
def serving() -> Iterator[Callable[..., Serving]]:
    started: list[Serving] = []

    def start(*options: str) -> Serving:
        started.append(Serving(*options))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.process.kill()
        one.process.communicate()


@dataclass(frozen=True)
class Ended:
    """How a command ended and what it printed."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output, which must be one line."""
        assert self.out.count("\n") == 1, self.err
        return json.loads(self.out)


Rig = Callable[..., Ended]


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Rig:
    """Run the program in this process, with what is typed to it."""

    def run(*arguments: object, typed: str | io.StringIO = "") -> Ended:
        monkeypatch.setattr(sys, "argv", ["rig", *map(str, arguments)])
        monkeypatch.setattr(sys, "stdin", io.StringIO(typed) if isinstance(typed, str) else typed)
        with pytest.raises(SystemExit) as caught:
            main()
        printed = capsys.readouterr()
        return Ended(int(caught.value.code or 0), printed.out, printed.err)

    return run


# --- the command ---


def test_one_device_one_line_and_a_clean_end(serving: Callable[..., Serving]) -> None:
    serve = serving("--stage", "grbl", "--tcp", "0")
    ports = serve.ports()
    assert set(ports) == {"stage"}
    stage = GrblStage(open_port(ports["stage"], 115200), WallClock())
    assert stage.connect().startswith("[VER:1.1h")
    stage.close()
    code, out, err = serve.end(signal.SIGINT)
    assert (code, out, err) == (0, "", "")


def test_both_devices_behind_two_tcp_ports(serving: Callable[..., Serving], finger: Fingertip) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    serve = serving("--tcp", str(number), "--indentor", "step:1")
    ports = serve.ports()
    assert ports == {"stage": f"tcp://127.0.0.1:{number}", "force": f"tcp://127.0.0.1:{number + 1}"}
    force = MtSicsForce(open_port(ports["force"], 9600), WallClock())
    assert force.connect() == "MT-SICS balance 0123456789"
    assert force.read().force_n == 0.0
    force.close()
    code, out, err = serve.end(signal.SIGTERM)
    assert (code, out) == (0, "")
    assert "forces asked for, 0 not ready in time" in err


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--stage", "hexapod"), "--stage hexapod: no such device, expected grbl"),
        (("--force", "spring"), "--force spring: no such device, expected mtsics"),
        (("--pty", "--tcp", "5000"), "--pty --tcp: expected one of them"),
        (("--tcp", "70000"), "--tcp 70000: expected 0 … 65534"),
        (("--indentor", "spoon"), "shape 'spoon': no such indentor"),
    ],
)
def test_what_serve_refuses(rig: Rig, options: tuple[str, ...], complaint: str) -> None:
    ended = rig("serve", *options)
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.startswith(f"rig: {complaint}")
    assert ended.err.count("\n") == 1


def test_a_busy_port_is_one_line(rig: Rig) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        number = other.getsockname()[1]
        ended = rig("serve", "--force", "mtsics", "--tcp", number)
    assert (ended.code, ended.out, ended.err) == (2, "", f"rig: TCP port {number}: address already in use\n")


# --- a rehearsal on a real wire ---


@pytest.fixture
def rig_toml(tmp_path: Path) -> Callable[..., Path]:
    """Write the configuration of a rig near its switches, with these ports."""

    def write(stage: str, force: str = "/dev/ttyNOWHERE7") -> Path:
        path = tmp_path / "rig.toml"
        tables = {**NEAR, "stage": {"port": stage}, "force": {**NEAR["force"], "port": force}}
        path.write_text(Config.model_validate(tables).as_toml(), encoding="utf-8")
        return path

    return write


Apart = tuple[str, str, Path]


@pytest.fixture
def apart(served: Callable[..., ServedBench], rig_toml: Callable[..., Path]) -> Apart:
    """A fast board and a balance that know nothing of each other, with no finger: ports and configuration."""
    stage = served(stage="grbl").ports["stage"]
    force = served(Config.model_validate(NEAR), force="mtsics").ports["force"]
    set_up(stage)
    return stage, force, rig_toml(stage, force)


def test_a_protocol_on_a_real_wire(
    rig: Rig, served: Callable[..., ServedBench], rig_toml: Callable[..., Path], finger: Fingertip, tmp_path: Path
) -> None:
    bench = served(Config.model_validate(NEAR), stage="grbl", force="mtsics")
    set_up(bench.ports["stage"])
    config = rig_toml(**bench.ports)
    ended = rig("run", "first_press", "presses=2", "hold_s=0.2", "--config", config, "--out", tmp_path / "runs",
                "--json", typed="\n")  # fmt: skip
    assert ended.code == 0, ended.err
    answer = ended.json
    assert (answer["complete"], answer["indentations"]) == (True, 2)
    assert answer["duration_s"] < 30.0
    assert "mount bar:3.0, then press Enter" in ended.err
    run = read_run(Path(answer["run"]))
    assert run.start["virtual"] is False
    # The virtual finger is the predicted one, so the force comes at the depth of the model's own answer.
    expected = finger.indent("bar:3.0", 0.0, force_gwt=1.0)
    for hold in run.stream("hold_end"):
        assert hold["force_gwt"] == pytest.approx(1.0, abs=0.05)
        assert hold["doi_mm"] == pytest.approx(expected.doi_mm, abs=0.02)
        assert "true_doi_mm" not in hold
    ports = {json.loads(line)["port"] for line in run.folder.bytes_log.read_text(encoding="ascii").splitlines()}
    assert ports == set(bench.ports.values())
    assert bench.statistics is not None
    assert bench.statistics.unknown == 0


def test_run_needs_ports_that_are_there_and_leaves_nothing_otherwise(
    rig: Rig, finger: Fingertip, tmp_path: Path
) -> None:
    config = tmp_path / "rig.toml"
    config.write_text('[stage]\nport = "/dev/ttyNOWHERE7"\n', encoding="utf-8")
    ended = rig("run", "first_press", "--config", config, "--out", tmp_path / "runs")
    assert (ended.code, ended.out) == (1, "")
    assert ended.err == "rig: stopped: there is no port /dev/ttyNOWHERE7\n"
    assert not list((tmp_path / "runs").iterdir())


def test_run_refuses_a_calibration_out_of_date(rig: Rig, finger: Fingertip, tmp_path: Path) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(
        "[calibration.force_scale]\nvalue = 1.0\ndate = 2019-01-01\nexpires = 2020-01-01\n", encoding="utf-8"
    )
    ended = rig("run", "first_press", "--config", config, "--out", tmp_path / "runs")
    assert ended.code == 2
    assert ended.err == "rig: calibration.force_scale: expired on 2020-01-01, expected a newer measurement\n"


def test_nobody_mounts(rig: Rig, apart: Apart, finger: Fingertip, tmp_path: Path) -> None:
    _, _, config = apart
    ended = rig("run", "first_press", "--config", config, "--out", tmp_path / "runs")
    assert ended.code == 130
    assert "nobody answered that bar:3.0 is mounted" in ended.err


def test_stop_from_another_process_ends_a_run_at_once(
    rig: Rig, apart: Apart, finger: Fingertip, tmp_path: Path
) -> None:
    stage, _, config = apart
    command = [sys.executable, "-c", "from rig.cli import main; main()", "run", "first_press"]
    run = subprocess.Popen(
        [*command, "--config", str(config), "--out", str(tmp_path / "runs")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert run.stdin is not None
        run.stdin.write("\n")
        run.stdin.flush()
        wait_for(lambda: any('"approach"' in p.read_text() for p in (tmp_path / "runs").glob("*/events.jsonl")))
        stopped = rig("stop", "--config", config, "--json")
        assert stopped.code == 0, stopped.err
        assert stopped.json == {"stopped": stage, "owner": run.pid}
        _, err = run.communicate(timeout=20)
    finally:
        run.kill()
        run.communicate()
    assert run.returncode == 130
    assert "rig: stopped: at once, by the operator" in err
    (journal,) = (tmp_path / "runs").glob("*/events.jsonl")
    assert json.loads(journal.read_text().splitlines()[-1])["status"] == "aborted"
    assert {"data.h5", "report.html", "SHA256SUMS"} <= {path.name for path in journal.parent.iterdir()}


def wait_for(ready: Callable[[], bool], timeout_s: float = 40.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not ready():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


# --- bench verbs ---


def test_home_status_and_zero(rig: Rig, apart: Apart) -> None:
    stage, force, config = apart
    assert rig("status", "--config", config, "--json").json["stage"]["state"] == "Alarm"
    homed = rig("home", "--config", config, "--json")
    assert homed.code == 0, homed.err
    at = {"state": "Idle", "x_mm": -1.0, "y_mm": -1.0, "z_mm": -1.0}
    assert homed.json == at
    assert rig("zero", "--config", config, "--json").json == {
        "identity": "MT-SICS balance 0123456789",
        "force_n": 0.0,
    }
    wire = open_port(force, 115200)
    wire.write(b"TA 2.50 g\r\n")
    wire.close()
    assert rig("doctor", "--config", config).code == 0
    after = rig("status", "--config", config, "--json").json
    assert after["stage"] == {"kind": "grbl", "port": stage, **at}
    assert after["force"]["force_n"] == pytest.approx(-2.5 * 9.80665e-3), "looking on leaves the tare"
    assert after["force"]["stable"]
    people = rig("status", "--config", config)
    assert people.code == 0
    assert f"stage       kind grbl, port {stage}, state Idle, x_mm -1.0" in people.out


def test_status_of_ports_that_are_not_there_and_of_one_that_is_owned(
    rig: Rig, served: Callable[..., ServedBench], rig_toml: Callable[..., Path]
) -> None:
    bench = served(stage="grbl")
    wire = open_port(bench.ports["stage"], 115200)
    try:
        ended = rig("status", "--config", rig_toml(**bench.ports), "--json")
    finally:
        wire.close()
    assert ended.code == 1
    assert ended.json["stage"] == {"kind": "grbl", "port": bench.ports["stage"], "owner": os.getpid()}
    assert ended.json["force"]["problem"] == "there is no port /dev/ttyNOWHERE7"
    assert ended.err == "rig: there is no port /dev/ttyNOWHERE7\n"


def test_stop_on_a_port_that_nobody_owns(
    rig: Rig, served: Callable[..., ServedBench], rig_toml: Callable[..., Path]
) -> None:
    bench = served(stage="grbl")
    stage = GrblStage(open_port(bench.ports["stage"], 115200), WallClock())
    stage.connect()
    stage.unlock()
    stage.jog("x", -40.0, 5.0)
    stage.close()
    stopped = rig("stop", "--config", rig_toml(**bench.ports), "--json")
    assert stopped.json == {"stopped": bench.ports["stage"], "owner": None}
    look = GrblStage(open_port(bench.ports["stage"], 115200), WallClock())
    assert look.look().state == "Alarm"
    look.close()


def test_doctor_looks_at_the_devices_of_a_configuration(
    rig: Rig, served: Callable[..., ServedBench], tmp_path: Path
) -> None:
    stage, force = served(stage="grbl").ports["stage"], served(force="mtsics").ports["force"]
    config = tmp_path / "rig.toml"
    config.write_text(
        f'[stage]\nport = "{stage}"\ntravel_mm = [60, 30, 50]\n[force]\nport = "{force}"\n'
        "[calibration.force_scale]\nvalue = 1.02\ndate = 2019-01-01\nexpires = 2020-01-01\n",
        encoding="utf-8",
    )
    found = rig("doctor", "--config", config, "--json").json
    assert found["stage"]["state"] == "Alarm"
    assert "expected $132=50 (it has 40)" in found["stage"]["problem"]
    assert found["force"]["identity"] == "MT-SICS balance 0123456789"
    assert found["calibrated"] == {"force_scale": "1.02, expired 2020-01-01"}
    assert "calibrated" not in rig("doctor", "--json").json


# --- calibration ---


def test_steps_per_mm_with_a_caliper(rig: Rig, free_stage: tuple[Callable[[], float], Path]) -> None:
    """The board says 2 mm, the caliper 1.96: it takes 2 % more steps for a millimetre than it believes."""
    steps = ("calibrate", "steps", "--config", free_stage[1], "--axis", "x", "--by-mm", "-2", "--speed-mm-s", "5")
    ended = rig(*steps, "--json", typed="1.96\n")
    assert ended.code == 0, ended.err
    assert "the board says 2.000 mm; how many did you measure" in ended.err
    assert ended.json["name"] == "x_steps_per_mm"
    assert ended.json["value"] == pytest.approx(400 * 2 / 1.96, rel=1e-6)
    table = tomllib.loads(ended.json["toml"])["calibration"]["x_steps_per_mm"]
    assert (table["expires"] - table["date"]).days == 365
    assert Config.model_validate({"calibration": {"x_steps_per_mm": table}})
    for typed, complaint in (
        ("0.2\n", "expected a difference of 20 % at most"),
        ("two\n", "expected a number"),
        ("", "nobody"),
    ):
        ended = rig(*steps, typed=typed)
        assert (ended.code, ended.out) == (2, "")
        assert complaint in ended.err


def test_force_scale_with_a_known_mass(rig: Rig, tmp_path: Path) -> None:
    """50 g that the sensor takes for 49 g; then nothing on it, which is missed and said."""
    load_n, scheduler = [0.0], WallScheduler()
    line = SerialLine(scheduler, 115200)
    VirtualBalance(scheduler, line, lambda t_s: load_n[0])
    port = PtyPort(scheduler, line)
    loop = threading.Thread(target=scheduler.run)
    loop.start()
    config = tmp_path / "rig.toml"
    config.write_text(f'[force]\nport = "{port.name}"\nbaud = 115200\n', encoding="utf-8")

    class Hand(io.StringIO):
        def readline(self, _size: int | None = -1, /) -> str:
            load_n[0] = 49 * 9.80665e-3
            return "\n"

    weigh = ("calibrate", "force", "--config", config, "--mass-g", "50", "--json")
    try:
        weighed, missed = rig(*weigh, typed=Hand()), rig(*weigh, typed="\n")
    finally:
        scheduler.stop()
        loop.join(5.0)
        port.close()
        scheduler.close()
    assert (weighed.code, weighed.json["name"]) == (0, "force_scale")
    assert weighed.json["value"] == pytest.approx(50 / 49, rel=1e-3)
    assert missed.code == 2
    assert "expected a difference of 20 % at most" in missed.err


# --- jogging ---


@pytest.fixture
def free_stage(served: Callable[..., ServedBench], rig_toml: Callable[..., Path]) -> tuple[Callable[[], float], Path]:
    """Where the carriage really is (x in mm), and the configuration of an unlocked board."""
    bench = served(stage="grbl")
    stage = GrblStage(open_port(bench.ports["stage"], 115200), WallClock())
    stage.connect()
    stage.unlock()
    stage.close()

    def x_mm() -> float:
        look = GrblStage(open_port(bench.ports["stage"], 115200), WallClock())
        try:
            return look.look().x_mm
        finally:
            look.close()

    return x_mm, rig_toml(**bench.ports)


def test_jog_by_a_distance(rig: Rig, free_stage: tuple[Callable[[], float], Path]) -> None:
    x_mm, config = free_stage
    ended = rig("jog", "--config", config, "--axis", "x", "--by-mm", "-1.23", "--speed-mm-s", "5", "--json")
    assert ended.code == 0, ended.err
    assert ended.json["x_mm"] == pytest.approx(-1.23, abs=0.0026)
    assert x_mm() == pytest.approx(-1.23, abs=0.0026)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--axis", "q", "--by-mm", "1"), "--axis q: expected x, y or z"),
        (("--axis", "x"), "--by-mm None: expected a distance in mm, not zero"),
        (("--axis", "x", "--by-mm", "0"), "--by-mm 0.0: expected a distance in mm, not zero"),
        (("--axis", "x", "--by-mm", "1", "--speed-mm-s", "99"), "--speed-mm-s 99: expected 0.017 … 10"),
    ],
)
def test_what_jog_refuses(rig: Rig, tmp_path: Path, options: tuple[str, ...], complaint: str) -> None:
    config = tmp_path / "rig.toml"
    config.write_text("", encoding="utf-8")
    ended = rig("jog", "--config", config, *options)
    assert (ended.code, ended.err) == (2, f"rig: {complaint}\n")


def test_jog_beyond_the_travel_says_so(rig: Rig, free_stage: tuple[Callable[[], float], Path]) -> None:
    ended = rig("jog", "--config", free_stage[1], "--axis", "x", "--by-mm", "5")
    assert ended.code == 1
    assert "the jog target lies outside the travel" in ended.err


def start_jog(config: Path, speed_mm_s: float) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", "from rig.cli import main; main()", "jog", "--config", str(config)]
    return subprocess.Popen(
        [*command, "--speed-mm-s", str(speed_mm_s)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def hold_key(jog: subprocess.Popen[bytes], key: bytes, seconds: float) -> None:
    """As a keyboard repeats it."""
    assert jog.stdin is not None
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        jog.stdin.write(key)
        jog.stdin.flush()
        time.sleep(0.03)


def test_a_held_key_moves_and_a_released_one_stops(free_stage: tuple[Callable[[], float], Path]) -> None:
    x_mm, config = free_stage
    jog = start_jog(config, 2.0)
    try:
        assert jog.stderr is not None
        jog.stderr.readline()  # ready
        hold_key(jog, b"a", 1.0)
        time.sleep(0.7)
        out, err = jog.communicate(b"q", timeout=20)
    finally:
        jog.kill()
        jog.communicate()
    assert jog.returncode == 0, err
    assert b"state       Idle" in out
    # Held for 1 s, released after 0.15 s more; the rest is slack for a busy machine, not for a runaway.
    assert -3.2 < x_mm() < -0.5


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_the_stage_stops_when_the_process_goes(
    free_stage: tuple[Callable[[], float], Path], number: signal.Signals
) -> None:
    """Even when it is killed: no more than two slices, 2 · 4 mm/s · 0.1 s, lay ahead of where the stage was."""
    x_mm, config = free_stage
    jog = start_jog(config, 4.0)
    try:
        assert jog.stderr is not None
        jog.stderr.readline()
        hold_key(jog, b"a", 1.0)
        jog.send_signal(number)
        jog.communicate(timeout=20)
    finally:
        jog.kill()
        jog.communicate()
    at_death_mm = x_mm()
    time.sleep(0.6)
    assert at_death_mm < -0.5, "it had moved"
    assert x_mm() > at_death_mm - 0.8 - 0.01
    rest_mm = x_mm()
    time.sleep(0.3)
    assert x_mm() == rest_mm
