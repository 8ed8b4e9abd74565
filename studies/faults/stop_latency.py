"""Measure the time from a stop to its byte by what the owner computes, on idle and on busy cores.

    .venv/bin/python -m studies.faults.stop_latency --against ../before --csv studies/results/safety/stop_latency.csv

An owner with a stage on a pseudo-terminal waits, computes in Python, or solves presses, while another process asks it
to stop 50 times over its control socket. A hung owner does not answer, and `rig stop` sends the byte beside it. Both
processes read one clock, the byte is timed when its write returns, and the start of Python is not part of it.
`--against` names another checkout, whose stops alternate with those of this one.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from statistics import median

OWNERS = ("waits", "python", "solves", "hung")
_WORKER = '''\
import json, os, pty, signal, subprocess, sys, tempfile, threading, time, tty
from pathlib import Path
import rig.transport.ports as ports

OWNER = """
import os, signal, sys, time
from pathlib import Path
import rig.transport.ports as ports
from rig.clock import WallClock
from rig.control.client import Announcement
from rig.control.owner_socket import ControlSocket
from rig.control.owned_stage import OwnedStage, answer_to_a_stop
from rig.control.stage_alone import stage_alone
config, does = sys.argv[1:]
settings, _ = stage_alone(Path(config))
stage = OwnedStage(settings, WallClock()).open()
wrote, write = [], ports.SerialTransport.write
def timed(self, data):
    write(self, data)
    wrote.append(time.monotonic())
ports.SerialTransport.write = timed
def stop(request):
    wrote.clear()
    return {**answer_to_a_stop(stage.stop), "byte_s": wrote[0]}
if does == "solves":
    from sim.models.fingertip import Fingertip
    finger = Fingertip.load()
about = Announcement(pid=os.getpid(), kind="by hand", virtual=False, ports=(settings.stage.port,), began_unix_s=1.0)
with ControlSocket(about, {"stop": stop}):
    print("ready", flush=True)
    if does == "hung":
        os.kill(os.getpid(), signal.SIGSTOP)
    while does == "python":
        sum(n * n for n in range(1000))
    n = 0
    while does == "solves":
        finger.indent("bar:3.0", 1e-3 * (n % 500), doi_mm=0.4)
        n += 1
    sys.stdin.read()
"""
folder = Path(tempfile.mkdtemp())
os.environ["RIG_RUNTIME_DIR"] = str(folder / "r")
from rig.control.client import announced
from rig.control.stage_alone import stage_alone
from rig.control.stop import send_stop
far, near = pty.openpty()
tty.setraw(near)
config = folder / "rig.toml"
config.write_text(f"[stage]\\nport = '{os.ttyname(near)}'\\n")
settings, _ = stage_alone(config)
ANSWERS = {b"\\x18": b"\\r\\nGrbl 1.1h ['$' for help]\\r\\n", b"?": b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\\r\\n"}
def board():
    while data := os.read(far, 4096):
        for byte, answer in ANSWERS.items():
            if byte in data:
                os.write(far, answer)
threading.Thread(target=board, daemon=True).start()
wrote, write = [], ports.SerialTransport.write
def timed(self, data):
    write(self, data)
    wrote.append(time.monotonic())
ports.SerialTransport.write = timed
owner, doing = None, ""
for line in sys.stdin:
    does, times = json.loads(line)
    if does != doing:
        if owner is not None:
            owner.kill()
            owner.communicate()
        words, doing = [sys.executable, "-c", OWNER, str(config), does], does
        owner = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        owner.stdout.readline()
    if does == "hung":
        time.sleep(0.1)
    else:
        owner.send_signal(signal.SIGCONT)
    time.sleep(0.2)
    found = []
    for n in range(times):
        wrote.clear()
        begun_s = time.monotonic()
        if does == "hung":
            send_stop(settings)
            byte_s = wrote[0]
        else:
            (one,) = announced()
            byte_s = one.ask("stop", within_s=30.0)["byte_s"]
        found.append(byte_s - begun_s)
        time.sleep(0.02 + 0.003 * (n % 7))
    owner.send_signal(signal.SIGSTOP)  # The other checkout is measured.
    print(json.dumps(found), flush=True)
owner.kill()
'''


class Checkout:
    """Process that runs the stops of one checkout."""

    def __init__(self, name: str, path: Path, stack: ExitStack) -> None:
        self.name = name
        self.found: dict[tuple[str, int], list[float]] = {}
        environment = {**os.environ, "PYTHONPATH": str(path), "OMP_NUM_THREADS": "1"}
        self._process = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-c", _WORKER],
                env=environment, cwd=path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )
        )  # fmt: skip

    def measure(self, owner: str, load: int, times: int) -> None:
        """Stop an owner so many times."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([owner, times]) + "\n")
        self._process.stdin.flush()
        self.found.setdefault((owner, load), []).extend(json.loads(self._process.stdout.readline()))

    def end(self) -> None:
        """End the process and its owner."""
        self._process.communicate()


def main() -> None:
    """Measure, print a table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=int, default=50)
    parser.add_argument("--load", type=int, default=8, help="busy processes")
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    rows = []
    with ExitStack() as stack:
        here = Checkout("now", Path(__file__).parents[2], stack)
        checkouts = [here]
        if options.against is not None:
            checkouts.insert(0, Checkout("before", options.against.resolve(), stack))
        for load in (0, options.load):
            busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(load)]
            try:
                for owner in OWNERS:
                    for _ in range(options.stops // 10):
                        for one in checkouts:
                            one.measure(owner, load, 10)
                    for one in checkouts:
                        ms = [1e3 * s for s in one.found[owner, load]]
                        rows.append([one.name, owner, load, len(ms), f"{median(ms):.1f}", f"{max(ms):.1f}"])
                        print(*rows[-1], sep="\t", flush=True)
            finally:
                for process in busy:
                    process.kill()
                    process.wait()
        for one in checkouts:
            one.end()
    if options.csv is not None:
        with options.csv.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["checkout", "owner", "busy processes", "stops", "median (ms)", "worst (ms)"])
            writer.writerows(rows)


if __name__ == "__main__":
    main()
