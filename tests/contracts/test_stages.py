"""Every registered stage keeps the contract, and has said all that it asks of its controller."""

import pickle

import pytest

from rig.bench.virtual import stage_opener, virtual_line, virtual_stage
from rig.devices.base import (
    MoveError,
    StageError,
    StageNotHomed,
    StageOverridden,
    StageReset,
    StageTimeout,
    arrive,
)
from rig.devices.make_drivers import stage_driver
from rig.devices.registry import BUILT_IN, StageKind, find
from rig.plan.config import Config
from rig.transport import LoopbackTransport
from sim.devices.clock import VirtualClock
from tests.contracts.stage import StageBytes, StageContract, StageEnd
from tests.contracts.tables import tables
from tests.error_codes import has_code, raises
from tests.parts.hobby_driver import HobbyStage
from tests.stub_bench import StubStage, raising

DEVICES = tables(StageBytes)
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
    for rows in ("settings", "shows", "ends", "refusals", "search", "limit"):
        assert bool(getattr(device, rows)) is (rows not in device.lacks), (
            f"tests/contracts/bytes: {device.name}: give rows of {rows}, or say in lacks why there are none"
        )
    assert len(device.garbled) >= 5
    faults = {shown.number for shown in device.shows.values() if "alarm" in shown.codes} | {device.alarm}
    for name, words, numbers in (
        ("fault_words", device.fault_words, faults),
        ("refusal_words", device.refusal_words, {device.unlock[-1], *device.refusals}),
    ):
        assert {*words} == numbers, f"tests/contracts/bytes: {device.name}: give {name} of {numbers ^ {*words}}"


# --- on its virtual twin ---

AXES = [(kind, axis) for kind in BUILT_IN["stage"] for axis in find(StageKind, kind).axes]
WAYS = [(0.025, -1.0, -0.95), (0.025, -0.02, 0.0), (0.025, -2.5, -2.0), (0.0, -1.0, -1.0)]


@pytest.mark.parametrize(("kind", "axis"), AXES)
@pytest.mark.parametrize(("backlash_mm", "to_mm", "highest_mm"), WAYS)
def test_measured_backlash_is_taken_up_on_the_way_up_and_where_none_is_measured_there_is_none(
    kind: str, axis: str, backlash_mm: float, to_mm: float, highest_mm: float
) -> None:
    """Twice as far beyond the target, but not beyond the top; the way begins at −2 mm."""
    measured = {"value": backlash_mm, "date": "2026-01-05", "expires": "2126-01-05"}
    calibration = {f"{axis}_backlash_mm": measured} if backlash_mm else {}
    config, clock = Config.model_validate({"stage": {"kind": kind}, "calibration": calibration}), VirtualClock()
    line = virtual_line(clock, config.stage)
    virtual_stage(clock, line, config)
    stage = stage_driver(
        stage_opener(config, line, lambda at, name: LoopbackTransport(at, clock, name)), clock, config
    )
    stage.connect()
    stage.home()
    stage.move_to(**{f"{axis}_mm": -2.0}, speed_mm_s=10.0)
    looks = stage.moving(**{f"{axis}_mm": to_mm}, speed_mm_s=0.5, look_s=0.01)
    seen_mm = [getattr(look, f"{axis}_mm") for look in (stage.status(), *looks, stage.status())]
    assert seen_mm[-1] == pytest.approx(to_mm, abs=0.003)
    assert max(seen_mm) == pytest.approx(highest_mm, abs=0.008)


# --- a driver that raises plain text ---

PLAIN = "odd {text} of {0}, 100 %"


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        (StageError, "stage_failed"), (StageTimeout, "timeout"), (StageReset, "was_reset"),
        (StageOverridden, "overridden"), (MoveError, "bad_move"),
    ],
)  # fmt: skip
def test_plain_text_of_a_driver_stays_as_it_is(kind: type[StageError] | type[MoveError], code: str) -> None:
    """A third-party driver knows no codes; what it raises comes out of a motion, and of a process, unchanged."""
    stage = StubStage(VirtualClock())
    arrive(stage.homing())
    stage.at_look = raising(kind(PLAIN))
    with pytest.raises(kind) as caught:
        arrive(stage.moving(z_mm=-5.0, speed_mm_s=1.0))
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        has_code(error, code)
        assert str(error) == PLAIN


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
