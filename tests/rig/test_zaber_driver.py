"""The Zaber driver byte for byte: transcripts of the maker's client, faults, retries; and the virtual chain."""

from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from itertools import pairwise

import pytest

from rig.devices.base import (
    StageAlarm,
    StageError,
    StageRejected,
    StageTimeout,
)
from rig.devices.zaber_link import ZaberLink, checksum, frame
from sim.devices.clock import VirtualClock
from tests.contracts import counted
from tests.contracts.bytes import zaber as chain
from tests.contracts.counted import Bench, ScriptedWire
from tests.contracts.stage import StageBench
from tests.error_codes import raises

# --- frames, as the maker's client sends and reads them ---

SENT = [
    ("/0 0 00:00\n", (0, 0, 0, "")),
    ("/1 0 01 get comm.packet.size.max:CF\n", (1, 0, 1, "get comm.packet.size.max")),
    ("/1 1 03 home:32\n", (1, 1, 3, "home")),
    ("/1 1 05 move abs 10000:BB\n", (1, 1, 5, "move abs 10000")),
    ("/1 1 09 move rel 500:06\n", (1, 1, 9, "move rel 500")),
    ("/1 1 06:F8\n", (1, 1, 6, "")),
    ("/1 1 15 stop:12\n", (1, 1, 15, "stop")),
    ("/0 0 21 stop:17\n", (0, 0, 21, "stop")),
]


@pytest.mark.parametrize(("sent", "words"), SENT, ids=[sent.strip() for sent, _ in SENT])
def test_a_command_is_the_one_of_the_makers_client(sent: str, words: tuple[int, int, int, str]) -> None:
    assert frame(*words) == sent.encode("ascii")


def sealed(content: str) -> bytes:
    """A line of a device."""
    return f"{content}:{checksum(content[1:])}\r\n".encode("ascii")


def linked(*replies: list[bytes]) -> tuple[ScriptedWire, ZaberLink]:
    """A link at whose far end the commands get these lines in turn, and then nothing."""
    clock, left = VirtualClock(0.0, 100.0), list(replies)
    wire = ScriptedWire(clock, lambda data: left.pop(0) if left else [])
    return wire, ZaberLink(wire, clock)


def test_a_refused_question_is_not_repeated() -> None:
    wire, link = linked([sealed("@01 1 00 RJ IDLE -- BADCOMMAND")], [sealed("@01 1 01 OK IDLE -- 1")])
    with raises(StageRejected, "line_refused", number="BADCOMMAND"):
        link.ask(1, 1, "get pos")
    assert wire.sent == [frame(1, 1, 0, "get pos")]


def test_an_id_without_a_reply_is_not_used_again_soon() -> None:
    """Its reply may come when the ids have gone once round."""
    clock = VirtualClock(0.0, 100.0)
    wire = ScriptedWire(clock, lambda data: [] if b" home" in data else [_echo(data)])
    link = ZaberLink(wire, clock)
    with raises(StageTimeout, "no_reply"):
        link.command(1, 1, "home")
    for _ in range(99):
        link.command(1, 1, "")
    assert {data[5:7] for data in wire.sent[1:]} == {b"%02d" % n for n in range(1, 100)}
    link.command(1, 1, "")
    assert wire.sent[-1][5:7] == b"01"
    clock.wait_s(2.9)
    for _ in range(99):
        link.command(1, 1, "")
    assert b"00" not in {data[5:7] for data in wire.sent[1:]}
    clock.wait_s(0.2)
    for _ in range(99):
        link.command(1, 1, "")
    assert b"00" in {data[5:7] for data in wire.sent[1:]}


def _echo(data: bytes) -> bytes:
    return sealed(f"@01 1 {data[5:7].decode()} OK IDLE -- 0")


def test_an_empty_list_of_warnings_is_read_as_the_warning_of_the_reply() -> None:
    bench = StageBench(chain.DEVICE, homed=True)
    bench.wire.state = "rested"
    usual = bench.stage.status()
    bench.wire.instead[b"2 1 warnings"] = b"@02 1 OK IDLE NI  "
    assert bench.stage.status() == usual


# --- the stage on the virtual chain ---


def commands(bench: Bench) -> list[str]:
    """What was sent, without ids and checksums."""
    found = []
    for _, _, data in bench.sent:
        device, axis, _, *words = data[1:-1].rpartition(b":")[0].decode("ascii").split()
        found.append(" ".join([device, axis, *words]))
    return found


bench_of = partial(counted.bench_of, "zaber")


def test_homing_makes_the_limits_those_of_the_travel_and_writes_them_once() -> None:
    bench = bench_of(homed=False)
    bench.stage.home()
    assert [words for words in commands(bench) if " set " in words] == [
        "2 1 set limit.max 16000", "1 1 set limit.max 24000",
    ]  # fmt: skip
    bench.sent.clear()
    bench.stage.home()
    assert not [words for words in commands(bench) if " set " in words]
    assert bench.devices.z.settings["limit.max"] == 16000


@pytest.mark.parametrize("version", ["7.25", "7.25.3", "10.1"])
def test_firmware_from_7_25_on_is_accepted(version: str) -> None:
    bench = bench_of(homed=False)
    bench.devices.devices[1].settings.update(version=version)
    assert version in bench.stage.connect()


@pytest.mark.parametrize("flag", ["WM", "FS"])
def test_a_stage_that_was_moved_while_it_stood_may_say_so_while_it_homes(flag: str) -> None:
    """The warning lasts until the axis has moved; any other ends homing."""
    homes = chain.axis(2, f"BUSY {flag}", 4000) | {
        b"2 1 get pos": (b"@02 1 OK BUSY %s 4000" % flag.encode(), "z is home")
    }
    bench = StageBench(replace(chain.DEVICE, states={**chain.DEVICE.states, "z homes": homes}))
    with nullcontext() if flag == "WM" else raises(StageAlarm, "alarm", number=flag, axis="z"):
        bench.stage.home()
    assert bench.stage.homed is (flag == "WM")


@pytest.mark.parametrize("more", [0, -1])
def test_a_travel_of_z_that_is_too_short_is_refused_when_it_homes(more: int) -> None:
    """Also one that became too short after the devices were compared with the configuration."""
    bench = bench_of(homed=False)
    assert bench.stage.connect()
    bench.devices.z.settings["limit.max"] = 16000 + more
    refused = raises(StageError, "not_as_configured", setting="limit.max") if more else nullcontext()
    with refused:
        bench.stage.home()
    assert bench.stage.homed is not more


# --- what stops it ---


@pytest.mark.parametrize("hides", ["WV", "WT"])
def test_a_warning_that_is_hidden_behind_a_harmless_one_is_seen(hides: str) -> None:
    bench = bench_of()
    bench.devices.z.warn(hides)
    bench.stage.move_to(z_mm=-1.0, speed_mm_s=2.0)
    bench.devices.z.warn("WS")
    with raises(StageAlarm, "alarm", number="WS"):
        bench.stage.status()


def test_an_alert_that_came_in_between_is_not_forgotten() -> None:
    """A fault that is gone when the next reply comes has been there."""
    bench = bench_of()
    bench.devices.devices[2].settings["comm.alert"] = "1"
    looks = bench.stage.moving(z_mm=-10.0, speed_mm_s=2.0)
    next(looks)
    bench.devices.z.fail("FS")
    bench.devices.z.repair("FS")
    with raises(StageAlarm, "alarm", number="FS", axis="z"):
        list(looks)


def test_an_alert_of_a_cleared_fault_is_forgotten_when_it_is_unlocked() -> None:
    bench = bench_of()
    bench.devices.devices[2].settings["comm.alert"] = "1"
    next(bench.stage.moving(z_mm=-10.0, speed_mm_s=2.0))
    bench.devices.z.fail("FS")
    bench.stage.halt()  # Its questions read the alert.
    bench.stage.unlock()
    assert bench.stage.status().state == "Idle"


# --- stop ---


def test_a_stop_that_is_lost_with_the_next_question_is_repeated() -> None:
    bench = bench_of()
    next(bench.stage.moving(z_mm=-30.0, speed_mm_s=5.0))
    read, left = bench.devices._read, [1, 2]
    bench.devices._read = lambda line: None if left and left.pop() else read(line)  # type: ignore[method-assign]
    bench.sent.clear()
    bench.stage.stop()
    assert [words for words in commands(bench) if "stop" in words] == ["0 0 stop", "0 0 stop"]
    assert not bench.devices.z.busy


@pytest.mark.parametrize("lost", [0, 1, 3])
def test_a_stop_that_does_not_take_effect_becomes_an_emergency_stop(lost: int) -> None:
    """It is sent again at every look."""
    bench, left = bench_of(), [lost]
    next(bench.stage.moving(z_mm=-30.0, speed_mm_s=5.0))
    obey = bench.devices.z.obey

    def obeyed(words: list[str]) -> str:
        left[0] -= list(words) == ["estop"]
        ignored = list(words) == ["stop"] or (list(words) == ["estop"] and left[0] >= 0)
        return "0" if ignored else obey(words)

    bench.devices.z.obey = obeyed  # type: ignore[method-assign]
    bench.sent.clear()
    asked_s = bench.clock.monotonic_s()
    bench.stage.stop()
    sent = zip(bench.sent, commands(bench), strict=True)
    estops_s = [at_s - asked_s for (at_s, _, _), words in sent if "estop" in words]
    assert estops_s[0] == pytest.approx(0.3, abs=0.03)
    assert len(estops_s) > lost
    assert all(later - earlier < 0.05 for earlier, later in pairwise(estops_s))
    assert not bench.devices.z.busy


# --- encoder, configuration ---


def test_the_position_of_an_encoder_is_read_and_a_slip_is_no_arrival() -> None:
    bench = bench_of(stage={"zaber": {"z": {"address": 2, "encoder": True}}})
    bench.stage.move_to(z_mm=-2.0, speed_mm_s=5.0)
    assert "2 1 get encoder.pos" in commands(bench)
    bench.devices.z.encoder_slip = 4
    with raises(StageError, "not_there", at_mm=-3.01, target_mm=-3.0):
        bench.stage.move_to(z_mm=-3.0, speed_mm_s=5.0)
