"""Every registered stage keeps the contract, and has said all that it asks of its controller."""

import importlib
import os
import pickle
import pkgutil
from pathlib import Path

import pytest

from rig.devices.base import MoveError, StageError, StageNotHomed, StageOverridden, StageReset, StageTimeout, arrive
from rig.devices.registry import BUILT_IN
from sim.devices.clock import VirtualClock
from tests.contracts.stage import StageBytes, StageContract, StageEnd, sentences
from tests.error_codes import has_code, raises
from tests.parts.hobby_driver import HobbyStage
from tests.stub_bench import StubStage, raising

TABLES = Path(__file__).parent / "bytes"
SENTENCES = Path(__file__).parent / "stages.txt"
DEVICES: list[StageBytes] = [
    found
    for info in pkgutil.iter_modules([str(TABLES)])
    for found in vars(importlib.import_module(f"tests.contracts.bytes.{info.name}")).values()
    if isinstance(found, StageBytes)
]
TO_BE_SAID = {"new", "home", "moving", "arrived", "elsewhere", "held", "alarm", "rested"}


class TestStages(StageContract):
    """All of them."""

    devices = DEVICES


def test_every_registered_stage_has_its_bytes() -> None:
    assert {device.kind for device in DEVICES} == set(BUILT_IN["stage"])
    assert {device.name for device in DEVICES} >= {"grbl", "leadshine_rtu", "leadshine_tcp"}


@pytest.mark.parametrize("device", DEVICES, ids=lambda device: device.name)
def test_a_table_leaves_nothing_open(device: StageBytes) -> None:
    """What a controller cannot do is said, too, and why."""
    assert device.source
    assert set(device.states) >= TO_BE_SAID
    assert (device.limit is None) == ("limit" in device.lacks)
    assert len(device.garbled) >= 5


def test_what_a_user_reads_is_as_it_stands() -> None:
    """`GOLDEN=write pytest tests/contracts/test_stages.py` writes it anew."""
    one_of_each = {device.kind: device for device in reversed(DEVICES)}.values()
    told = [line for device in one_of_each for line in (device.kind, *(f"  {one}" for one in sentences(device)), "")]
    found = "\n".join(told)
    assert "{" not in found.replace("{'", "")
    if os.environ.get("GOLDEN") == "write":
        SENTENCES.write_text(found, encoding="utf-8")
    assert found == SENTENCES.read_text(encoding="utf-8")


# --- a driver that raises plain text ---

PLAIN = "odd {text} of {0}, 100 %"


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        (StageError, "stage_failed"), (StageTimeout, "timeout"), (StageReset, "was_reset"),
        (StageOverridden, "overridden"), (MoveError, "bad_move"),
    ],
)  # fmt: skip
def test_plain_text_is_told_as_it_is(kind: type[StageError] | type[MoveError], code: str) -> None:
    """A third-party driver knows no codes; what it raises comes out of a motion, and of a process, unchanged."""
    stage = StubStage(VirtualClock())
    arrive(stage.homing())
    stage.at_look = raising(kind(PLAIN))
    with pytest.raises(kind) as caught:
        arrive(stage.moving(z_mm=-5.0, speed_mm_s=1.0))
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        has_code(error, code)
        assert (str(error), error.fields) == (PLAIN, {})


def test_the_driver_of_a_package_that_knows_no_codes() -> None:
    """Its own words, and the codes of the driver that it is built on."""
    device = next(one for one in DEVICES if one.kind == "grbl")
    clock = VirtualClock()
    hobby = HobbyStage(StageEnd(device, clock), clock)
    with raises(StageError, "stage_failed") as caught:
        hobby.connect()
    assert device.identity in str(caught.value)
    with raises(StageNotHomed, "not_homed", who="wire: the stage"):
        hobby.move_to(z_mm=-11.0, speed_mm_s=5.0)
