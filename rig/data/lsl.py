"""Outlets of the Lab Streaming Layer (LSL): readings and steps of the runs in a folder, read from their journals.

Data flow one way: a run knows nothing of its streams, so they can neither delay a press nor stop one.
"""

import json
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from rig.clock import WallClock
from rig.data.documents import Document
from rig.data.events import READING, STREAMS
from rig.data.folder import RunFolder
from rig.data.run import Following
from rig.errors import RigError

CHANNELS = {name: STREAMS[READING][name] for name in ("force_gwt", "doi_mm", "x_mm", "height_mm")}
"""Channels of the readings, with their units. A value that the journal lacks is NaN."""

SAMPLES, MARKERS = "rig_samples", "rig_markers"
"""Names of the two streams."""

_HIDDEN = {"note": ("text",), "start": ("parameters", "subject"), "resume": ()}
"""Keys that a marker omits, because other computers can read it."""

_PAIRS = 9  # of readings of two clocks
_SEARCH_S = 0.5


class LslMissingError(RigError):
    """Error of a missing library for LSL."""

    default_code = "pylsl_missing"


class GrowingRuns:
    """Reader of a folder of runs: returns the documents of runs that begin or continue after its creation.

    A run that has begun before is returned from the start of its present part.
    """

    def __init__(self, out: Path, clock: WallClock | None = None) -> None:
        self._out, self._clock = out, clock or WallClock()
        self._sizes = self._found()
        self._before = set(self._sizes)
        self._following: dict[Path, Following] = {}
        self._growing: set[Path] = set()
        self._search_at_s = -math.inf

    def new(self) -> list[tuple[Path, list[Document]]]:
        """Return the new documents of each run. Raises RunError."""
        now_s = self._clock.monotonic_s()
        if now_s >= self._search_at_s:
            self._search_at_s = now_s + _SEARCH_S
            sizes = self._found()
            self._growing |= {run for run, size in sizes.items() if size != self._sizes.get(run, 0)}
            self._sizes = sizes
        return [(run, new) for run in sorted(self._growing) if (new := self._new(run))]

    def _new(self, run: Path) -> list[Document]:
        joined = run not in self._following
        new = self._following.setdefault(run, Following(RunFolder(run))).new()
        if joined and run in self._before:
            begins = [n for n, document in enumerate(new) if document["doc"] in ("start", "resume")]
            new = new[begins[-1] :] if begins else []
        if new and new[-1]["doc"] == "stop":
            self._growing.discard(run)
        return new

    def _found(self) -> dict[Path, int]:
        """Return the sizes of all journals (bytes)."""
        found = {}
        for journal in self._out.glob("[!.]*/events.jsonl"):
            try:
                found[journal.parent] = journal.stat().st_size
            except OSError:  # It was just moved.
                continue
        return found


class LslOutlet(Protocol):
    """LslOutlet of pylsl."""

    def push_sample(self, x: Sequence[Any], timestamp: float) -> None: ...


class RunStreams:
    """Two outlets for the documents of runs, with their times on the clock of LSL.

    The time of a sample is `t_s` of the journal plus an offset, which is constant within a part of a run.
    """

    def __init__(self, samples: LslOutlet, markers: LslOutlet, offset_s: Callable[[], float]) -> None:
        """Prepare the streams. offset_s: returns the clock of LSL minus the wall clock (s)."""
        self._samples, self._markers, self._offset_s = samples, markers, offset_s
        self._origins_s: dict[Path, float] = {}

    def push(self, run: Path, documents: Sequence[Document]) -> None:
        """Push the next documents of a run."""
        begins = run not in self._origins_s or any(one["doc"] in ("start", "resume") for one in documents)
        if begins:
            # Both clocks were read one after the other; a pause between them only adds.
            apart_s = min(one["unix_s"] - one["t_s"] for one in _of_the_last_part(documents))
            self._origins_s[run] = apart_s + self._offset_s()
        for document in documents:
            self._push(document, self._origins_s[run] + document["t_s"])

    def _push(self, document: Document, at_s: float) -> None:
        if document["doc"] == "event" and document["stream"].endswith("sample"):
            self._samples.push_sample(sample_of(document["data"]), at_s)
        elif document["doc"] != "descriptor":
            self._markers.push_sample([marker_of(document)], at_s)


def _of_the_last_part(documents: Sequence[Document]) -> Sequence[Document]:
    begins = [n for n, one in enumerate(documents) if one["doc"] in ("start", "resume")]
    return documents[begins[-1] :] if begins else documents


def sample_of(data: Mapping[str, Any]) -> list[float]:
    """Return the values of the channels of a reading."""
    return [math.nan if (value := data.get(name)) is None else float(value) for name in CHANNELS]


def marker_of(document: Document) -> str:
    """Return the marker of a step: one line of JSON, without the participant's code and the text of notes."""
    name = document["stream"] if document["doc"] == "event" else document["doc"]
    data = document["data"] if document["doc"] == "event" else document
    left_out = ("doc", "crc32", "uid", "seq", "t_s", "unix_s", *_HIDDEN.get(name, ()))
    return json.dumps({"marker": name, **{key: value for key, value in data.items() if key not in left_out}})


def lsl() -> Any:
    """Return the package pylsl. Raises LslMissingError."""
    try:
        import pylsl
    except (ImportError, RuntimeError, OSError):  # without liblsl, or for another version of the system
        raise LslMissingError(
            "stream: the Lab Streaming Layer requires pylsl; install it with pip install 'indentation-rig[lsl]'"
        ) from None
    return pylsl


def open_streams() -> RunStreams:
    """Open the two outlets, which other computers can find. Raises LslMissingError."""
    pylsl = lsl()
    clock, host = WallClock(), platform.node()
    about = pylsl.StreamInfo(SAMPLES, "Force", len(CHANNELS), pylsl.IRREGULAR_RATE, "double64", f"{SAMPLES}@{host}")
    channels = about.desc().append_child("channels")
    for name, unit in CHANNELS.items():
        channel = channels.append_child("channel")
        channel.append_child_value("label", name).append_child_value("unit", unit)
    marks = pylsl.StreamInfo(MARKERS, "Markers", 1, pylsl.IRREGULAR_RATE, "string", f"{MARKERS}@{host}")

    def offset_s() -> float:
        """Compare the clocks several times; an interruption makes a comparison longer, so the shortest counts."""
        pairs = [(pylsl.local_clock(), clock.unix_s(), pylsl.local_clock()) for _ in range(_PAIRS)]
        before_s, unix_s, after_s = min(pairs, key=lambda one: one[2] - one[0])
        return float((before_s + after_s) / 2 - unix_s)

    return RunStreams(pylsl.StreamOutlet(about), pylsl.StreamOutlet(marks), offset_s)
