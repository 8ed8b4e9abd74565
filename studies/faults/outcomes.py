"""What the rig does when a wire, a device or the machine under it fails, on real bytes: every fault of the catalogue.

    .venv/bin/python -m studies.faults.outcomes    # studies/results/faults/one_fault.csv

Each fault strikes an indentation to 8 gwt on a finger of springs, at its first move in contact, or later in its hold.
Drivers, wire and virtual devices are those of a dry-run; bytes are lost, changed or delayed between them.
"""

import json
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rig.devices.base import ForceError, StageError
from rig.engine import EngineError, indent, verbs
from rig.engine.limits import Stopping
from rig.errors import RigError
from rig.plan.config import Config
from rig.transport import TransportError
from rig.units import GWT_N
from studies.faults.catalogue import CATALOGUE, Fault
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, TARGET, FaultyBench
from studies.posix import resource


@dataclass(frozen=True)
class FaultOutcome:
    """What came of a fault."""

    outcome: str
    ended_by: RigError | None
    state: str
    worst_gwt: float
    journalled: int  # whole lines


def bound_gwt() -> float:
    """The soft trip, and what the worst increment may add."""
    trip_gwt = SOFT_TRIP_N / GWT_N
    return trip_gwt + Stopping.of(Config(), 1.0).overshoot_gwt(trip_gwt, PREDICTED.force_n / GWT_N, PREDICTED.doi_mm)


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


def main() -> None:
    """Print the table."""
    print(
        f"| fault | what happens | the engine is then | worst force (gwt, of {bound_gwt():.2f}) |\n|---|---|---|---|"
    )
    for fault in CATALOGUE:
        with tempfile.TemporaryDirectory() as folder:
            found = suffer(fault, Path(folder))
        told = "the run goes on" if found.ended_by is None else str(found.ended_by)
        reason = told.replace(folder, "…").replace("|", "\\|")
        print(f"| {fault.name} | {found.outcome}: {reason} | {found.state} | {found.worst_gwt:.2f} |")


if __name__ == "__main__":
    main()
