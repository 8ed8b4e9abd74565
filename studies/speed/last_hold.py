"""How far a jog by hand goes after its last hold, and what the process that makes it costs.

    .venv/bin/python -m studies.speed.last_hold [--share]

On the virtual clock: a button is held, a hold each 0.1 s, and from some instant on nothing is heard of it. How far
the stage then goes until it rests, and how far it would go if the process were killed at the worst moment; the
largest of PHASES instants. Promised: 0.25 s of the last hold and two slices of 0.1 s at the speed that was asked for,
and a step. With --share: `rig by-hand` on devices in real time, its processor time (Linux) while it looks on and
while it jogs.
"""

import argparse
import io
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rig.bench.served import ServedBench
from rig.bench.virtual import bench_around
from rig.control.client import announced
from rig.devices.base import StageStatus
from rig.engine.bench_memory import LastKnown
from rig.engine.dead_man import SLICE_S
from rig.manual.requests import HOLD_S
from rig.manual.server import HandOwner
from rig.plan.config import Config
from rig.transport.stop_gate import StopGate
from sim.devices.clock import VirtualClock
from sim.plant import Carriage, TruePose

KINDS: dict[str, dict[str, Any]] = {
    "GRBL, balance": {"force": {"baud": 115200}},
    "Leadshine, transmitter": {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}},
}
SPEEDS_MM_S = (0.5, 1.0, 2.0, 5.0, 10.0)
PHASES, SETTLED_S, SAMPLE_S = 10, 3.0, 0.005
STEP_MM = 1 / 400
SHARE_S = 20.0


class Air:
    """Nothing under the indentor."""

    def __init__(self, carriage: Carriage) -> None:
        self._carriage = carriage

    def mount(self, indentor: str) -> None:
        """It does not matter."""

    def pose_at(self, t_s: float) -> TruePose:
        """Where it is, or will be if nobody says anything more."""
        pose = self._carriage.pose_at(t_s)
        return TruePose(pose.x_mm, pose.above_apex_mm, -pose.above_apex_mm)

    def force_n(self, t_s: float) -> float:
        """None."""
        return 0.0


def promised_mm(speed_mm_s: float) -> float:
    """At most."""
    return speed_mm_s * (HOLD_S + 2 * SLICE_S) + STEP_MM


def gone_mm(kind: str, speed_mm_s: float, phase_s: float) -> tuple[float, float]:
    """After the last hold: until it rests; and if nothing were said any more from the worst moment on."""
    clock, gate, config = VirtualClock(1.7e9), StopGate(), Config.model_validate(KINDS[kind])
    air: list[Air] = []
    bench = bench_around(lambda carriage: _kept(air, carriage), config, clock, io.StringIO(), gate=gate)
    bench.stage.connect()
    bench.stage.home()
    at: StageStatus = bench.stage.status()
    known = LastKnown(zero_offset_n=0.0, left_at_mm=(at.x_mm, at.y_mm, at.z_mm))
    owner = HandOwner(config, bench, gate, io.StringIO(), known)
    x_mm = air[0].pose_at
    farthest: list[float] = []

    def hold() -> float:
        press = {"axis": "x", "sign": -1, "speed_mm_s": speed_mm_s, "tab": "study", "press": 1}
        owner.answers["hold"]({**press, "unix_s": clock.unix_s()})
        return x_mm(clock.monotonic_s()).x_mm

    def person() -> Iterator[float]:
        from_mm = hold()
        for wait_s in (*[0.1] * 10, phase_s):
            yield wait_s
            from_mm = hold()
        until_s = clock.monotonic_s() + SETTLED_S
        killed_mm = 0.0
        while clock.monotonic_s() < until_s:
            killed_mm = max(killed_mm, from_mm - x_mm(clock.monotonic_s() + 60.0).x_mm)
            yield SAMPLE_S
        farthest.extend((from_mm - x_mm(clock.monotonic_s()).x_mm, killed_mm))
        owner.leave()

    acts = person()

    def act() -> None:
        wait_s = next(acts, None)
        if wait_s is not None:
            clock.call_at(clock.monotonic_s() + wait_s, act)

    with owner.begun():
        act()
        owner.run()
    return farthest[0], farthest[1]


def _kept(air: list[Air], carriage: Carriage) -> Air:
    air.append(Air(carriage))
    return air[0]


def table() -> Iterator[str]:
    """Rows of the table in docs/validation/safety.md."""
    yield "| mm/s | promised (mm) | " + " | ".join(f"{kind}: went on, killed (mm)" for kind in KINDS) + " |"
    yield "|---" * (2 + len(KINDS)) + "|"
    for speed_mm_s in SPEEDS_MM_S:
        row = [f"{speed_mm_s:g}", f"{promised_mm(speed_mm_s):.3f}"]
        for kind in KINDS:
            found = [gone_mm(kind, speed_mm_s, 0.1 * k / PHASES) for k in range(PHASES)]
            row.append(", ".join(f"{max(way):.3f}" for way in zip(*found, strict=True)))
        yield "| " + " | ".join(row) + " |"


def share() -> Iterator[str]:
    """Of one core, while it looks on at 20 and at 50 readings a second, and while it jogs."""
    for period_s in (0.05, 0.02):
        yield f"{1 / period_s:.0f} readings a second: " + ", ".join(_shares(period_s))


def _shares(period_s: float) -> Iterator[str]:
    config = Config.model_validate({"force": {"baud": 115200, "sample_period_s": period_s}})
    with tempfile.TemporaryDirectory() as folder, ServedBench(config, stage="grbl", force="mtsics") as bench:
        os.environ["RIG_STATE_DIR"] = os.environ["RIG_RUNTIME_DIR"] = folder
        serving = threading.Thread(target=bench.run)
        serving.start()
        tables = {"stage": {"port": bench.ports["stage"]}, "force": {"port": bench.ports["force"], "baud": 115200,
                  "sample_period_s": period_s}}  # fmt: skip
        toml = Path(folder) / "rig.toml"
        toml.write_text(Config.model_validate(tables).as_toml(), encoding="utf-8")
        process = subprocess.Popen([sys.executable, "-m", "rig", "by-hand", "--config", str(toml)])
        try:
            yield from _measured(process)
        finally:
            process.terminate()
            process.wait()
            bench.stop()
            serving.join()


def _measured(process: "subprocess.Popen[bytes]") -> Iterator[str]:
    while not (there := announced()):
        if process.poll() is not None:
            raise SystemExit(1)
        time.sleep(0.05)
    ask = there[0].ask
    ask("home")
    while ask("status")["busy"]:
        time.sleep(0.1)
    read, spent, began_s = _told(ask), _spent_s(process.pid), time.monotonic()
    time.sleep(SHARE_S)
    rate = (_told(ask) - read) / (time.monotonic() - began_s)
    yield f"looking on {(_spent_s(process.pid) - spent) / SHARE_S:.1%} of a core"
    spent, began_s = _spent_s(process.pid), time.monotonic()
    while time.monotonic() < began_s + SHARE_S:
        ask("hold", axis="x", sign=-1, speed_mm_s=1.0, tab="study", press=1, unix_s=time.time())
        time.sleep(0.1)
    yield f"jogging, ten holds a second, {(_spent_s(process.pid) - spent) / SHARE_S:.1%}; {rate:.1f} read a second"


def _told(ask: Callable[..., dict[str, Any]]) -> int:
    """How many readings there were."""
    return int(ask("status", since=1 << 40)["readings"]["next"])


def _spent_s(pid: int) -> float:
    """Of a process, user and system."""
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Print the table, or the shares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--share", action="store_true", help="processor time of the process, in real time")
    for line in share() if parser.parse_args().share else table():
        print(line, flush=True)


if __name__ == "__main__":
    main()
