"""How exact the times of the streams for LSL are, how late they arrive, and how many are lost.

    .venv/bin/python -m studies.speed.lsl_times [--runs 20] [--seconds 5] [--rate 200]

A journal is written in real time on the wall clock, without waiting for the disk. `rig stream` follows it from its
own process, and an inlet in a third process receives over loopback. The clock of LSL on Linux is the monotonic
clock, so the error of a time is known: the time of a sample minus the monotonic time of its journal document.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rig.clock import WallClock
from rig.data.journal import Journal, read_journal
from rig.data.schema import STREAMS

LOOPBACK = """\
[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
AddressesOverride = {127.0.0.1}
[lab]
KnownPeers = {127.0.0.1}
SessionID = study
[log]
level = -2
"""


def receive() -> None:
    """Print a line once the inlet is open, then each sample as it comes: its time, its arrival, its number."""
    import pylsl

    (found,) = pylsl.resolve_byprop("name", "rig_samples", 1, 60.0)
    inlet = pylsl.StreamInlet(found, recover=False)
    inlet.open_stream(60.0)
    print(flush=True)
    while True:
        values, at_s = inlet.pull_sample(1.0)
        if values is not None:
            print(json.dumps([at_s, pylsl.local_clock(), values[0]]), flush=True)


def write(folder: Path, seconds: float, rate: float) -> float:
    """Write a journal at this rate; return the monotonic time of its beginning (s)."""
    clock = WallClock()
    folder.mkdir(parents=True)
    with Journal(folder / "events.jsonl", clock, STREAMS, virtual=True) as journal:
        journal.start({"protocol": "study"})
        began_s = clock.monotonic_s() - clock.run_s()
        for n in range(int(seconds * rate)):
            clock.wait_s(began_s + n / rate - clock.monotonic_s())
            journal.event("sample", {"force_gwt": n, "x_mm": 0.0, "height_mm": 1.0})
        journal.stop("done")
    return began_s


def measured(runs: int, seconds: float, rate: float) -> Mapping[str, Any]:
    """Return one row of the table."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        (out / "lsl.cfg").write_text(LOOPBACK, encoding="ascii")
        env = {**os.environ, "LSLAPICFG": str(out / "lsl.cfg")}
        streams = subprocess.Popen([sys.executable, "-m", "rig", "stream", "--out", str(out / "runs")], env=env)
        heard = out / "received"
        with heard.open("w", encoding="ascii") as file:
            receives = [sys.executable, "-m", "studies.speed.lsl_times", "--receive"]
            inlet = subprocess.Popen(receives, env=env, stdout=file)
        try:
            clock = WallClock()
            clock.wait_until(lambda: heard.stat().st_size > 0, clock.monotonic_s() + 120.0)
            began_s = [write(out / "runs" / f"{n:02}", seconds, rate) for n in range(runs)]
            clock.wait_s(3.0)
        finally:
            inlet.terminate()
            streams.send_signal(signal.SIGINT)
        inlet.wait()
        streams.wait()
        lines = heard.read_text(encoding="ascii").splitlines(keepends=True)
        received = np.array([json.loads(line) for line in lines if line.endswith("]\n")])
        times_s = [
            began + one["t_s"]
            for n, began in enumerate(began_s)
            for one in read_journal(out / "runs" / f"{n:02}" / "events.jsonl")
            if one["doc"] == "event"
        ]
    # Samples arrive in order, so a lost one would show as a wrong number.
    sent = np.array(times_s)
    lost = len(sent) - len(received)
    whole = lost == 0 and bool((received[:, 2] == np.tile(np.arange(len(sent) // runs), runs)).all())
    if not whole:
        return {"readings": len(sent), "lost": lost}
    error_us, late_ms = 1e6 * np.abs(received[:, 0] - sent), 1e3 * (received[:, 1] - sent)
    later_ms = late_ms.reshape(runs, -1)[:, int(rate) :]  # from a second after the beginning of a run
    return {
        "readings/s": f"{rate:g}",
        "runs": runs,
        "readings": len(sent),
        "lost": lost,
        **_spread("error", "µs", error_us),
        **_spread("arrival", "ms", later_ms),
        "worst in the first second (ms)": f"{late_ms.max():.0f}",
    }


def _spread(what: str, unit: str, values: "np.ndarray[Any, Any]") -> dict[str, str]:
    middle, high = np.percentile(values, [50, 99])
    return {
        f"{what} median ({unit})": f"{middle:.1f}",
        f"{what} 99 % ({unit})": f"{high:.1f}",
        f"worst {what} ({unit})": f"{values.max():.1f}",
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.speed.lsl_times")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rate", type=float, default=200.0)
    parser.add_argument("--receive", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.receive:
        receive()
        return
    row = measured(options.runs, options.seconds, options.rate)
    print(",".join(row), ",".join(str(value) for value in row.values()), sep="\n")


if __name__ == "__main__":
    main()
