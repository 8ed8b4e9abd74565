"""What the rig does when a wire, a device or the machine under it fails, on real bytes.

Each fault strikes an indentation to 8 gwt on a finger of springs, at its first move in contact, or later in its hold.
Drivers, wire and virtual devices are those of a dry-run; bytes are lost, changed or delayed between them.
"""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rig.devices.base import ForceError, StageError
from rig.engine import EngineError, indent, verbs
from rig.errors import RigError
from rig.transport import TransportError
from rig.units import GWT_N
from studies.faults.faulty_bench import PREDICTED, TARGET, FaultyBench
from studies.posix import resource
from tests.faults.catalogue import Fault


@dataclass(frozen=True)
class FaultOutcome:
    """What came of a fault."""

    outcome: str
    ended_by: RigError | None
    state: str
    worst_gwt: float
    journalled: int  # whole lines


@contextmanager
def _file_sizes_restored() -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def suffer(fault: Fault, folder: Path) -> FaultOutcome:
    """Two indentations, the fault in the first."""
    bench = FaultyBench(folder, fault.tables)
    ended_by: RigError | None = None
    with ExitStack() as stack:
        stack.enter_context(_file_sizes_restored())
        stack.callback(lambda: bench.journal.close())
        try:
            _two_presses(bench, fault)
        except (EngineError, StageError, ForceError, TransportError) as error:
            ended_by = error
    lifted = bench.height_mm > PREDICTED.contact_mm + 1.0
    outcome = "done" if ended_by is None else "lifted" if lifted else "held"
    lines = bench.journal_path.read_bytes().split(b"\n")
    assert lines[-1] == b"", "a torn line"
    documents = [json.loads(line) for line in lines[:-1]]
    return FaultOutcome(outcome, ended_by, bench.engine.state.value, bench.worst_n / GWT_N, len(documents))


def _two_presses(bench: FaultyBench, fault: Fault) -> None:
    engine = bench.engine
    verbs.mount(engine, "bar:3.0")
    verbs.home(engine)
    verbs.zero(engine)
    fault.strike(bench)
    for x_mm in (0.0, 0.5):
        verbs.move_to(engine, x_mm)
        indent(engine, TARGET, hold_s=0.5, expected_contact_mm=PREDICTED.contact_mm)
