"""`rig stream` and an inlet of LSL on loopback: every sample and marker equals the journal."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.data.lsl import CHANNELS, marker_of, sample_of
from rig.data.run import Following, RunFolder
from rig.engine import Target, indentation
from tests.preloaded import Popen
from tests.waiting import until

pytest.importorskip("pty", reason="needs pseudo-terminals and signals")
pytest.importorskip("pylsl", reason="needs pylsl (extra lsl)", exc_type=ImportError)

CLIENT = Path(__file__).parents[2] / "lsl_client.py"
LOOPBACK = """\
[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
AddressesOverride = {{127.0.0.1}}
[lab]
KnownPeers = {{127.0.0.1}}
SessionID = {session}
[log]
level = -2
"""


@pytest.fixture
def begun(tmp_path: Path) -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Begin a Python with LSL on loopback alone, in a session of its own."""
    config = tmp_path / "lsl.cfg"
    config.write_text(LOOPBACK.format(session=f"rig-{os.getpid()}-{tmp_path.name}"), encoding="ascii")
    processes: list[subprocess.Popen[str]] = []

    def begin(*words: object) -> "subprocess.Popen[str]":
        process = Popen(
            [sys.executable, *map(str, words)], env={**os.environ, "LSLAPICFG": str(config)}, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        processes.append(process)
        return process

    yield begin
    for process in processes:
        process.kill()
        process.communicate()


def test_an_inlet_receives_every_reading_and_step_of_a_press(
    begun: Callable[..., "subprocess.Popen[str]"], tmp_path: Path, spring: Callable[..., Any]
) -> None:
    streams = begun("-m", "rig", "stream", "--out", tmp_path)
    client = begun(CLIENT)
    assert client.stdout is not None
    assert json.loads(client.stdout.readline()) == {"channels": [[name, unit] for name, unit in CHANNELS.items()]}
    bench = spring()
    bench.journal.start({"protocol": "press"})
    indentation.indent(bench.ready(), Target("force_gwt", 2.0), hold_s=0.5)
    bench.journal.stop("done")
    received = json.loads(client.stdout.readline())
    documents = Following(RunFolder(bench.journal_path.parent)).new()
    readings = [one for one in documents if one["doc"] == "event" and one["stream"] == "sample"]
    steps = [one for one in documents if one["doc"] != "descriptor" and one not in readings]
    samples, markers = received["rig_samples"], received["rig_markers"]
    assert len(samples) == len(readings) > 20
    assert [values for _, values in samples] == [
        pytest.approx(sample_of(one["data"]), abs=0, rel=0, nan_ok=True) for one in readings
    ]
    assert [text for _, (text,) in markers] == [marker_of(one) for one in steps]
    (origin_s,) = {
        round(at_s - one["t_s"], 5) for (at_s, _), one in zip(samples + markers, readings + steps, strict=True)
    }
    assert isinstance(origin_s, float)
    streams.send_signal(signal.SIGINT)
    assert until(lambda: streams.poll() is not None)
    assert streams.returncode == 0


COUNTS = """\
import json, sys, time
import pylsl
from rig.design.counts_from.lsl_stream import opened
from rig.design.counts_from.source import AcceptedCounts
from rig.errors import CountError

found = []
for kind, samples in (("double64", ([0.0, 7.0], [1.0, float("nan")])), ("string", (["0", "12"], ["1", "many"]))):
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo(f"counts_{kind}", "Counts", 2, pylsl.IRREGULAR_RATE, kind, kind))
    source = opened(f"counts_{kind}")
    counts = AcceptedCounts(source)
    try:
        for number, sample in enumerate(samples):
            outlet.push_sample(sample)
            while counts.count(number) is None:
                counts.look(2)
                time.sleep(0.005)
            found.append(counts.count(number))
    except CountError as error:
        found.append(error.code)
    source.close()
print(json.dumps(found))
"""


def test_counts_of_a_stream_are_taken_in_and_wrong_ones_are_errors(
    begun: Callable[..., "subprocess.Popen[str]"],
) -> None:
    """Numbers or texts: the first sample is a count, the second cannot be one."""
    lab = begun("-c", COUNTS)
    assert lab.stdout is not None
    assert json.loads(lab.stdout.readline()) == [7, "bad_count", 12, "bad_count"]


TWO = """\
import pylsl
from rig.design.counts_from.lsl_stream import opened
from rig.errors import CountError

info = [pylsl.StreamInfo("counts", "Counts", 2, pylsl.IRREGULAR_RATE, "double64", rig) for rig in ("mine", "other")]
outlets = [pylsl.StreamOutlet(one) for one in info]
try:
    opened("counts")
except CountError as error:
    print(error.code, flush=True)
"""


def test_of_two_streams_of_one_name_neither_is_taken(begun: Callable[..., "subprocess.Popen[str]"]) -> None:
    lab = begun("-c", TWO)
    assert lab.stdout is not None
    assert lab.stdout.readline() == "several_streams\n"
