"""Counts from a stream of the Lab Streaming Layer (LSL): each sample has a press's number and its count."""

from collections.abc import Mapping
from typing import Any, Protocol

from rig.data.lsl import LslMissingError
from rig.design.counts_from.source import MadePress
from rig.errors import CountError

FIND_S = 5.0
_SECOND_S = 1.0  # for a second stream of the same name
_MOST = 1024
_CHANNELS = 2


class Inlet(Protocol):
    """StreamInlet of pylsl."""

    def pull_chunk(self, timeout: float, max_samples: int) -> tuple[list[list[Any]], list[float]]: ...

    def close_stream(self) -> None: ...


class LslCounts:
    """Samples of a stream, numbers or texts."""

    def __init__(self, inlet: Inlet) -> None:
        self._inlet = inlet

    def made(self, press: MadePress) -> None:
        """Do nothing, because the stream runs by itself."""

    def new(self) -> list[tuple[Any, Any]]:
        """Return the samples that have arrived."""
        samples, _ = self._inlet.pull_chunk(timeout=0.0, max_samples=_MOST)
        return [(sample[0], sample[1]) for sample in samples or []]

    def truth(self) -> Mapping[str, Any] | None:
        """Return None: the nerve is recorded."""
        return None

    def close(self) -> None:
        """Close the stream."""
        self._inlet.close_stream()


def opened(name: str) -> LslCounts:
    """Return the stream of a name. Raises LslMissingError, CountError."""
    try:
        import pylsl
    except (ImportError, RuntimeError, OSError):  # without liblsl, or for another version of the system
        raise LslMissingError(
            "counts=lsl: the Lab Streaming Layer requires pylsl; install it with pip install 'indentation-rig[lsl]'"
        ) from None
    found = pylsl.resolve_byprop("name", name, timeout=FIND_S)
    if not found:
        raise CountError(f"counts=lsl:{name}: no such stream within {FIND_S:g} s; start it first", "no_stream")
    found = pylsl.resolve_byprop("name", name, minimum=2, timeout=_SECOND_S) or found
    if len({stream.uid() for stream in found}) > 1:
        hosts = ", ".join(sorted({stream.hostname() for stream in found}))
        raise CountError(
            f"counts=lsl:{name}: {len(found)} streams have this name, on {hosts}; give yours a name of its own",
            "several_streams",
        )
    channels = found[0].channel_count()
    if channels != _CHANNELS:
        raise CountError(
            f"counts=lsl:{name}: the stream has {channels} channels; it must have two, index and count",
            "wrong_channels",
        )
    inlet = pylsl.StreamInlet(found[0], recover=True)
    inlet.open_stream(timeout=FIND_S)
    return LslCounts(inlet)
