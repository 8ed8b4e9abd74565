"""Line to the recording amplifier, of a real or a virtual bench."""

from collections.abc import Iterator
from contextlib import closing, contextmanager

from rig.bench.virtual import VirtualBench
from rig.devices.sync_line import AdapterOutput, StageOutput, SyncLine
from rig.engine.bench import Bench
from rig.settings import SyncSettings
from sim.devices.sync_line import VirtualSyncLine


@contextmanager
def sync_line(settings: SyncSettings, bench: Bench) -> Iterator[SyncLine | None]:
    """Yield the configured line at rest, or None; it is at rest at the end. Raises TransportError."""
    if settings.output == "off":
        yield None
    elif settings.adapter is None:
        yield StageOutput(bench.stage, bench.clock)
    elif isinstance(bench, VirtualBench):
        yield VirtualSyncLine(bench.clock)
    else:
        with closing(AdapterOutput(settings, bench.clock)) as line:
            yield line
