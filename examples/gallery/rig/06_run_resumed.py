"""
A stopped run resumed
=====================

You get one complete run from a rehearsal that was stopped after two of four presses and then resumed. What was done
is not repeated.

How-to: :doc:`/running`. Reference: :doc:`/data`.
"""

import signal
import sys
import time
from pathlib import Path
from subprocess import DEVNULL, Popen, run
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

from rig.data import read_run

RIG = [sys.executable, "-m", "rig"]
SCRIPT = "bars", "from_mm=0.6", "to_mm=-0.6", "spacing_mm=0.4"


def presses(folder: Path) -> int:
    """Return the number of presses done: the journal describes their ends once, then has a line for each."""
    return sum(file.read_text().count('"indentation_end"') for file in folder.glob("*/events.jsonl")) - 1


with TemporaryDirectory() as folder:
    command = [*RIG, "dry-run", *SCRIPT, "--speed", "20", "--out", folder]
    with Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL) as rehearsal:
        while rehearsal.poll() is None and presses(Path(folder)) < 2:
            time.sleep(0.05)
        rehearsal.send_signal(signal.SIGINT)  # Ctrl-C
    (path,) = (file.parent for file in Path(folder).glob("*/events.jsonl"))
    stopped = read_run(path)
    print(f"stopped: {len(stopped.done)} presses done, {stopped.missing} missing")
    run([*RIG, "resume", str(path), "--yes"], check=True, capture_output=True)
    resumed = read_run(path)
    print(f"resumed: {len(resumed.done)} presses done, {resumed.repeated} repeated")

figure, axes = plt.subplots(layout="constrained")
samples = resumed.stream("sample")
axes.plot([one["t_s"] for one in samples], [one["force_gwt"] for one in samples])
axes.axvline(stopped.end_s, color="k", ls="--", label="stopped and resumed")
axes.set(xlabel="time of the run (s)", ylabel="force (gwt)")
axes.legend()
plt.show()
