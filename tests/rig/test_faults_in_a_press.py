"""Presses beside a device that is busy or has no value, and what a sensor of several axes adds to the journal.

Every other fault of a wire or a device: tests/contracts, tests/faults/catalogue.py, studies/faults/campaign.
"""

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.devices.registry import ForceKind, find
from sim.devices.modbus import RegisterFault
from studies.faults.faulty_bench import TARGET, FaultyBench, bound_gwt
from tests.error_codes import causes
from tests.faults.catalogue import Fault
from tests.faults.outcomes import suffer

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches, below where a virtual stage begins."""
NET_FT: dict[str, Any] = {"force": {"kind": "net_ft"}, **NEAR}
HELD_TO_GWT = 0.1
APART = 12
"""Answers between two refusals."""


def _events(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines()]


def _is(document: dict[str, Any], kind: str, stream: str) -> bool:
    return (document["doc"], document.get("stream")) == (kind, stream)


def _pressed_to_the_same_force(strike: Callable[[FaultyBench], object], tables: dict[str, Any], folder: Path) -> None:
    found = suffer(Fault("harmless", "done", "", strike, tables), folder)
    assert (found.outcome, found.ended_by) == ("done", None)
    forces = [one["data"]["force_gwt"] for one in _events(folder) if _is(one, "event", "hold_end")]
    assert forces == pytest.approx([TARGET.value] * 2, abs=HELD_TO_GWT)
    assert found.worst_gwt <= TARGET.value + HELD_TO_GWT


Now = Callable[[], bool]
"""Whether the next request or answer is refused."""


def _refuses(number: int) -> Callable[[FaultyBench, Now], None]:
    """Registers that refuse reads and writes, which they then do not obey."""

    def strike(bench: FaultyBench, now: Now) -> None:
        leadshine = bench.config.stage.kind == "leadshine"
        for device in (bench.board.x, bench.board.z) if leadshine else (bench.sensor,):
            for name in ("read", "write"):
                setattr(device, name, _or_fault(getattr(device, name), number, now))

    return strike


def _or_fault(obey: Callable[..., Any], number: int, now: Now) -> Callable[..., Any]:
    def refuse_or_obey(*request: Any) -> Any:
        if now():
            raise RegisterFault(number)
        return obey(*request)

    return refuse_or_obey


def _says(reply: bytes) -> Callable[[FaultyBench, Now], None]:
    """A balance that answers so instead of with a weight."""
    return lambda bench, now: bench.change(
        bench.force_line, lambda data: [reply] if data.startswith((b"S S ", b"S D ")) and now() else [data]
    )


Answer = tuple[dict[str, Any], Callable[[FaultyBench, Now], None]]
LAUMAS = {"force": {"kind": "laumas", "baud": 115200}, **NEAR}
MTSICS = {"force": {"kind": "mtsics"}, **NEAR}
LEADSHINE = {"stage": {"kind": "leadshine"}, **NEAR}
BUSY: dict[str, Answer] = {
    "laumas: 6": (LAUMAS, _refuses(6)),
    "laumas: 11": (LAUMAS, _refuses(11)),
    "leadshine: 6": (LEADSHINE, _refuses(6)),
    "mtsics: S I": (MTSICS, _says(b"S I\r\n")),
}
NO_VALUE: dict[str, Answer] = {
    "laumas: 4": (LAUMAS, _refuses(4)),
    "mtsics: S +": (MTSICS, _says(b"S +\r\n")),
    "mtsics: S -": (MTSICS, _says(b"S -\r\n")),
}
"""Answers that are final. All numbers: tests/contracts, tests/rig/test_modbus_master.py."""
everywhere = pytest.mark.parametrize("phase", ["", "clearance", "press"], ids=["in the air", "near", "in contact"])
BUSY_TIMES = 3
"""So often one after the other, as answers are lost."""


def _struck(phase: str, answer: Callable[[FaultyBench, Now], None], now: Now) -> Callable[[FaultyBench], object]:
    """At once, on the way to the finger, or from the first sample of a phase on."""
    if not phase:
        return lambda bench: answer(bench, now)
    return lambda bench: bench.after(phase, lambda: answer(bench, now))


@everywhere
@pytest.mark.parametrize("name", BUSY)
def test_a_press_survives_a_device_that_is_occasionally_busy(name: str, phase: str, tmp_path: Path) -> None:
    tables, answer = BUSY[name]
    asked = itertools.count()

    def now_and_then() -> bool:
        return next(asked) % (APART + BUSY_TIMES) >= APART

    _pressed_to_the_same_force(_struck(phase, answer, now_and_then), tables, tmp_path)
    assert next(asked) > 3 * APART


@everywhere
@pytest.mark.parametrize("name", BUSY | NO_VALUE)
def test_a_device_without_a_value_ends_the_press(name: str, phase: str, tmp_path: Path) -> None:
    """Whether it stays busy or has a final answer; the force is no higher than without a reading."""
    tables, answer = (BUSY | NO_VALUE)[name]
    found = suffer(Fault("no value", "", "", _struck(phase, answer, lambda: True), tables), tmp_path)
    assert found.ended_by is not None
    assert found.worst_gwt <= bound_gwt()
    if "force" in tables:
        assert (found.outcome, found.ended_by.code) == ("lifted", "no_reading")
        code = {"S +": "overload", "S -": "underload"}.get(name.split(": ")[1], "refused")
        assert ("busy" if name in BUSY else code) in causes(found.ended_by)
    else:
        assert "busy" in {found.ended_by.code, *causes(found.ended_by)}


# --- what a Net F/T journals ---


def test_the_journal_of_a_net_ft_sensor_has_all_axes_and_packet_counts(tmp_path: Path) -> None:
    _pressed_to_the_same_force(lambda bench: None, NET_FT, tmp_path)
    events = _events(tmp_path)
    keys = set(find(ForceKind, "net_ft").also)
    units = next(one["units"] for one in events if _is(one, "descriptor", "sample"))
    assert keys < set(units)
    samples = [one["data"] for one in events if _is(one, "event", "sample")]
    assert all(keys < set(sample) for sample in samples)
    for sample in samples:
        assert sample["fz_n"] == pytest.approx(-sample["force_gwt"] * 9.80665e-3, abs=2e-4)
    assert {sample["packets_lost"] + sample["packets_late"] for sample in samples} == {0}
