"""The byte tables of `tests/contracts/bytes/`, and what is derived from them and from the registry."""

import importlib
import pkgutil
from pathlib import Path
from typing import TypeVar

from rig.devices.counted_axis import TwoAxisStage
from rig.devices.registry import BUILT_IN
from tests.contracts.force import ForceBytes
from tests.contracts.stage import StageBench, StageBytes

FOLDER = Path(__file__).parent / "bytes"
T = TypeVar("T")


def tables(of: type[T]) -> list[T]:
    """Every table of a class."""
    return [
        found
        for info in pkgutil.iter_modules([str(FOLDER)])
        for found in vars(importlib.import_module(f"tests.contracts.bytes.{info.name}")).values()
        if isinstance(found, of)
    ]


def stage_table(kind: str) -> StageBytes:
    """The table of a stage, the first one where it has several."""
    found = next((device for device in tables(StageBytes) if device.kind == kind), None)
    assert found is not None, f"tests/contracts/bytes/{kind}.py: no StageBytes with kind={kind!r}"
    return found


def force_table(name: str) -> ForceBytes:
    """The table of a force sensor, by its name."""
    return next(device for device in tables(ForceBytes) if device.name == name)


def counted_stages() -> list[str]:
    """The kinds whose axes count steps."""
    benches = {kind: StageBench(stage_table(kind), connected=False) for kind in BUILT_IN["stage"]}
    return [kind for kind, bench in benches.items() if isinstance(bench.stage, TwoAxisStage)]
