"""The campaign of studies/faults/campaign: it finds what is bad, and a sample of it on the program finds nothing."""

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from rig.devices.registry import BUILT_IN, KnownBench
from rig.engine.bench_memory import state_folder
from rig.session.early_ending import FinalPosition
from studies.faults.campaign import runner
from studies.faults.campaign.__main__ import in_shard, sample
from studies.faults.campaign.cases import FaultCase, cases
from studies.faults.campaign.faults import LATE_S, FaultyCarriage, WireFault, wire_faults
from studies.faults.campaign.judge import BOUND_GWT, EXEMPTIONS, claim_of, exemption_of, true_claim, violations
from studies.faults.campaign.messages import (
    LANGUAGES,
    LINES,
    MODBUS,
    MODBUS_TCP,
    NET_FT,
    TMCL,
    XIMC,
    ZABER,
    Language,
    language,
)
from studies.faults.campaign.scenarios import SCENARIOS, Finished
from studies.faults.campaign.tables import CampaignSummary, Record, names_in, records_of, told
from studies.faults.campaign.world import BENCHES, VirtualWorld, config_of
from studies.registry import read_table, tables_in
from tests.contracts.force import Connected, ForceBytes
from tests.contracts.stage import StageBench, StageBytes
from tests.contracts.tables import tables

# --- faults ---


def test_the_fault_campaign_strikes_every_byte_of_a_message_in_every_way() -> None:
    data = b"G0Z-3\n"
    found = list(wire_faults(data, from_device=True))
    arrives = [tuple(piece for _, piece in fault.pieces(data)) for fault in found if fault.kind != "late"]
    assert len(set(arrives)) == len(arrives), "none twice"
    for at, bit in itertools.product(range(len(data)), range(8)):
        assert (data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :],) in arrives
    for at in range(len(data)):
        assert (data[:at] + data[at + 1 :],) in arrives
        assert (data[: at + 1] + data[at:],) in arrives
        assert ((data[:at],) if at else ()) in arrives, "cut at every length, nothing at all included"
    for at in range(len(data) - 1):
        assert (data[:at] + bytes([data[at + 1], data[at]]) + data[at + 2 :],) in arrives
    assert (data, data) in arrives
    assert [fault.late_s for fault in found if fault.kind == "late"] == list(LATE_S)
    assert not [fault for fault in wire_faults(data, from_device=False) if fault.kind == "late"]


def test_each_wire_fault_of_the_campaign_has_its_own_name() -> None:
    found = [*wire_faults(b"SI\r\n", from_device=True)]
    assert len({str(fault) for fault in found}) == len(found)


_hex = bytes.fromhex


@pytest.mark.parametrize(
    ("spoken", "one", "other", "shapes", "contents"),
    [
        (LINES, b"G53Z-1.5\n", b"G53Z-2.7\n", True, False),
        (LINES, b"G53Z-1.5\n", b"G53Z-12.7\n", False, False),
        (LINES, b"SI\r\n", b"S\r\n", False, False),
        (MODBUS, _hex("020310140002 80fc"), _hex("020310140002 0a0a"), True, True),
        (MODBUS, _hex("020304000000 00c933"), _hex("020304ffffdc 10901b"), True, False),
        (MODBUS_TCP, _hex("000100000006 020310140002"), _hex("00ff00000006 020310140002"), True, True),
        (MODBUS_TCP, _hex("000100000006 020310140002"), _hex("000100000006 020310150002"), False, False),
        (ZABER, b"/2 1 05 move abs 1000 327:0A\n", b"/2 1 77 move abs 2000 327:F1\n", True, False),
        (ZABER, b"@02 1 05 OK IDLE -- 1000:0A\r\n", b"@02 1 77 OK IDLE -- 2000:F1\r\n", True, False),
        (ZABER, b"@02 1 05 OK IDLE -- 1000:0A\r\n", b"@02 1 05 OK BUSY -- 1000:F1\r\n", False, False),
        (ZABER, b"/2 1 05 get pos:0A\n", b"/2 1 99 get pos:F7\n", True, True),
        (ZABER, b"/2 1 05 get pos:0A\n", b"/1 1 05 get pos:0B\n", True, False),
        (ZABER, b"/2 1 05:0A\n", b"/2 1 00:00\n", True, True),
        (XIMC, b"move" + bytes(17) + b"\1\n", b"move" + bytes(17) + b"\2\3", True, True),
        (XIMC, b"gpos", b"gets", False, False),
        (TMCL, _hex("01 04 00 00 00000001 06"), _hex("01 04 00 00 0000000a 0f"), True, False),
        (NET_FT, bytes(35) + b"\n", b"\1" * 8 + bytes(27) + b"\n", True, True),
        (NET_FT, bytes(36), bytes(35) + b"\1", True, False),
        (NET_FT, b"<cfgcpf>10</cfgcpf>\n", b"<cfgcpf>20</cfgcpf>\n", True, False),
    ],
)  # fmt: skip
def test_the_campaign_groups_messages_by_shape_and_content(
    spoken: Language, one: bytes, other: bytes, shapes: bool, contents: bool
) -> None:
    assert (spoken.shape(one) == spoken.shape(other)) is shapes
    assert (spoken.content(one) == spoken.content(other)) is contents


@pytest.mark.parametrize("device", tables(StageBytes), ids=lambda device: device.name)
def test_the_campaign_tells_motion_commands_from_queries_of_every_stage(device: StageBytes) -> None:
    bench, frames = StageBench(device), dict[bytes, bytes]()
    hear = bench.wire._hear

    def hearing(frame: bytes, port: bytes) -> None:
        frames[port + device.heard(frame)] = frame
        hear(frame, port)

    bench.wire._hear = hearing  # type: ignore[method-assign]
    bench.stage.home()
    next(bench.stage.moving(**device.move))
    spoken = language(KnownBench.model_validate({"stage": {"kind": device.kind, **device.table}}).stage)
    found = [spoken.is_command(frames[asked]) for asked in (device.trigger, device.where)]
    assert found == [True, False], f"studies/faults/campaign/messages.py: LANGUAGES does not fit {device.kind}"


@pytest.mark.parametrize("device", [*tables(StageBytes), *tables(ForceBytes)], ids=lambda device: device.name)
def test_a_kind_without_a_language_of_its_own_replies_in_lines_of_text(device: StageBytes | ForceBytes) -> None:
    if any(device.kind in kinds for kinds in LANGUAGES.values()):
        return
    replies = list[bytes]()

    def said(frame: bytes, reply: bytes) -> bytes:
        replies.append(device.said(frame, reply))
        return replies[-1]

    noted = replace(device, said=said)
    StageBench(noted) if isinstance(noted, StageBytes) else Connected(noted).driver.read()
    assert all(reply.isascii() and reply.endswith(b"\n") for reply in replies), (
        f"studies/faults/campaign/messages.py: LANGUAGES has no entry for {device.kind}"
    )


def test_the_campaign_speaks_every_language() -> None:
    spoken = [language(device) for bench in BENCHES for device in (config_of(bench).stage, config_of(bench).force)]
    assert {*spoken} == {LINES, MODBUS, MODBUS_TCP, ZABER, XIMC, TMCL, NET_FT}


@pytest.mark.parametrize(
    ("kind", "goes_mm"),
    [("z stalls", 0.0), ("z travels 0.5", -0.5), ("z travels 2", -2.0), ("z slips going down", -0.5), ("none", -1.0)],
)
def test_a_faulty_carriage_moves_otherwise_until_mended(kind: str, goes_mm: float) -> None:
    world = VirtualWorld("grbl")
    stage = _homed(world)
    stage.move_to(z_mm=-5.0, speed_mm_s=5.0)
    before_mm = _height_mm(world)
    world.mechanics = FaultyCarriage(world, kind)
    stage.move_to(z_mm=-6.0, speed_mm_s=5.0)
    assert _height_mm(world) - before_mm == pytest.approx(goes_mm, abs=0.01)
    world.mechanics.mend()
    stage.move_to(z_mm=-7.0, speed_mm_s=5.0)
    assert _height_mm(world) - before_mm == pytest.approx(goes_mm - 1.0, abs=0.01)
    stage.home()
    stage.move_to(z_mm=-5.0, speed_mm_s=5.0)
    assert _height_mm(world) == pytest.approx(before_mm, abs=0.01), "the switch is where it was"


def test_a_carriage_that_runs_on_moves_without_a_command() -> None:
    world = VirtualWorld("grbl")
    stage = _homed(world)
    world.mechanics = FaultyCarriage(world, "z runs on")
    stage.move_to(z_mm=-5.0, speed_mm_s=5.0)
    runner.at_rest(world)
    assert _height_mm(world) < world.config.stage.travel_mm[2] - 5.0 - world.config.frame.apex_z_mm
    assert _height_mm(world) == pytest.approx(7.0 - 0.25, abs=0.02)


def _homed(world: VirtualWorld):  # type: ignore[no-untyped-def]
    stage = world.connected().stage
    stage.connect()
    stage.home()
    return stage


def _height_mm(world: VirtualWorld) -> float:
    return world.pose_mm(world.clock.monotonic_s())[1]


# --- the judge ---

FINE: Record = {
    "worst_gwt": 8.0,
    "drag_mm": 0.0,
    "report_true": True,
    "record_true": True,
    "lost": 0,
    "repeated": 0,
    "mixed": 0,
    "resumed": None,
    "exit": "tripped",
    "mechanics": "none",
    "cell": "none",
    "struck_gwt": 0.0,
}


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        ({}, []),
        ({"worst_gwt": BOUND_GWT + 0.01}, ["force"]),
        ({"drag_mm": 0.01}, ["sideways"]),
        ({"report_true": False}, ["report"]),
        ({"record_true": False}, ["report"]),
        ({"lost": 1}, ["lost or repeated"]),
        ({"repeated": 1}, ["lost or repeated"]),
        ({"mixed": 1}, ["lost or repeated"]),
        ({"resumed": True}, []),
        ({"resumed": False}, ["not resumed"]),
        ({"exit": "crashed"}, ["crash"]),
    ],
)
def test_each_violation_of_a_campaign_case_is_named(changed: Record, found: list[str]) -> None:
    assert violations({**FINE, **changed}) == found


@pytest.mark.parametrize(
    ("scenario", "mechanics", "cell", "struck_gwt", "spared"),
    [
        ("press", "none", "reads 0.1", 0.0, True),
        ("press", "z runs on", "none", 0.0, True),
        ("press", "z travels 2", "frozen", 0.0, True),
        ("press", "z travels 2", "frozen", 8.0, False),
        ("press", "z travels 2", "late", 0.0, False),
        ("press", "z travels 0.8", "frozen", 0.0, False),
        ("press", "none", "reads 0.5", 0.0, False),
        ("press", "none", "frozen", 0.0, False),
        ("press", "z stalls", "saturated", 0.0, False),
        ("press", "z travels 2", "reads 0.5", 0.0, False),
        ("ramp", "z travels 2", "reads 0.5", 0.0, True),
        ("ramp", "z travels 2", "saturated", 0.0, False),
        ("ramp", "z travels 2", "late", 0.0, False),
        ("ramp", "none", "reads 0.5", 0.0, False),
    ],
)
def test_only_the_listed_campaign_cases_are_exempt(
    scenario: str, mechanics: str, cell: str, struck_gwt: float, spared: bool
) -> None:
    record = {**FINE, "scenario": scenario, "mechanics": mechanics, "cell": cell, "struck_gwt": struck_gwt}
    assert (exemption_of(record) is not None) is spared


@pytest.mark.parametrize(
    ("at", "force_gwt", "true"),
    [
        (FinalPosition("lifted", 0.0, 2.0, True, False), 0.0, True),
        (FinalPosition("lifted", 0.0, 2.0, True, False), 0.06, False),
        (FinalPosition("held", 0.0, 2.0, False, True), 3.0, True),
        (FinalPosition("held", 0.0, 2.0, False, True), 0.0, True),
        (FinalPosition("held", None, None, False, None), 5.0, True),
        (FinalPosition("not moved"), 5.0, True),
        (None, 5.0, True),
    ],
)
def test_the_campaign_judges_a_claim_true_only_if_the_force_agrees(
    at: FinalPosition | None, force_gwt: float, true: bool
) -> None:
    assert true_claim(claim_of(at), force_gwt) is true


def test_a_load_cell_that_reads_half_may_hide_twice_the_touch_threshold() -> None:
    assert true_claim("clear", 0.09, "reads 0.5")
    assert not true_claim("clear", 0.11, "reads 0.5")


# --- a program that is bad is found out ---


@dataclass(frozen=True)
class Careless:
    """A program that sends its lines as they are, looks at nothing, and says that all is well."""

    name: str = "careless"

    def play(self, world: VirtualWorld, folder: Path) -> Finished:
        """Down to a press, up again, aside."""
        stage, wire = _homed(world), world.wire("stage")
        stage.move_to(x_mm=-30.0, z_mm=-12.9, speed_mm_s=5.0)
        for phase, line in (("lift", b"G53G1G90G21Z-11.900F300\n"), ("sideways", b"G53G1G90G21X-29.000F300\n")):
            world.phase = phase
            wire.write(line)
            world.clock.wait_s(5.0)
            with (state_folder() / "remembered").open("a", encoding="ascii") as file:
                file.write(f"{phase}, ")
        remembered = (state_folder() / "remembered").read_text(encoding="ascii")
        return Finished("done", remembered, FinalPosition("lifted", 1.0, 1.0, True, False))

    def take_up(self, world: VirtualWorld, folder: Path) -> Finished:
        """There is nothing to take up."""
        return Finished("done", "", None)


@pytest.fixture
def careless(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Record]:
    """What the campaign finds of it, by the name of the case."""
    monkeypatch.setattr(runner, "SCENARIOS", (Careless(),))
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "state"))
    wanted = ("stage to flip 14.1", *(f"{mechanics} + none" for mechanics in ("none", "z stalls", "z runs on")))
    chosen = [case for case in cases("grbl", tmp_path, (Careless(),)) if case.name.split("/")[3] in wanted]
    runner.carry_out(chosen, tmp_path / "found.jsonl", 1)
    found = {record["case"]: record for record in records_of(tmp_path / "found.jsonl")}
    assert set(found) == {case.name for case in chosen}
    return found


def test_the_campaign_finds_the_violations_of_a_careless_program(careless: dict[str, Record]) -> None:
    """A flipped bit makes Z-11.9 a Z-13.9: pressed beyond the bound. A motor that stalls makes its report untrue."""
    lift = {name.split("/", 3)[3]: record for name, record in careless.items() if record["phase"] == "lift"}
    flipped = lift["stage to flip 14.1"]  # 1 becomes 3
    assert bytes.fromhex(flipped["data"])[14:15] == b"1"
    assert "force" in flipped["violations"]
    assert flipped["worst_gwt"] == pytest.approx(10 * 1.6**1.5, abs=0.1)
    stalled = lift["z stalls + none"]
    assert {"report", "sideways"} <= set(stalled["violations"])
    assert stalled["left_gwt"] > 4.0
    assert stalled["drag_mm"] == pytest.approx(1.0, abs=0.05)
    assert lift["none + none"]["violations"] == []
    assert lift["z runs on + none"]["exempt"] is not None
    assert {record["reason"] for record in careless.values()} == {"lift, sideways, "}, "no case remembers another"


def test_the_campaign_records_a_crashed_worker_as_a_violation(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A child that ends in any other way than it should is a record, and a violation."""
    monkeypatch.setattr(runner, "SCENARIOS", (Careless(),))
    monkeypatch.setattr(runner, "at_rest", lambda world: 1 / 0)
    chosen = [case for case in cases("grbl", tmp_path, (Careless(),)) if case.fault == WireFault("drop", 3)][:1]
    runner.carry_out(chosen, tmp_path / "found.jsonl", 1)
    (record,) = records_of(tmp_path / "found.jsonl")
    assert record["violations"] == ["crash"]


@dataclass(frozen=True)
class Halting:
    """A program that ends at the first answer that is not `ok`, and does all of it again when it is taken up."""

    name: str = "halting"

    def play(self, world: VirtualWorld, folder: Path) -> Finished:
        """Twelve moves aside."""
        _homed(world)
        wire, world.phase = world.wire("stage"), "move"
        for n in range(12):
            wire.write(b"G53G1G90G21X-%dF600\n" % (20 + n))
            world.clock.wait_s(5.0)
            if wire.read(0.0) != b"ok\r\n":
                return Finished("failed", f"move {n}", None)
        return Finished("done", "", None)

    def take_up(self, world: VirtualWorld, folder: Path) -> Finished:
        """The same again."""
        return self.play(world, folder)


def test_a_campaign_case_is_judged_by_its_first_ending(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Eight commands as in the undisturbed run absorb a fault, but not those of the program that resumes it."""
    monkeypatch.setattr(runner, "SCENARIOS", (Halting(),))
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "state"))
    every = [case for case in cases("grbl", tmp_path, (Halting(),)) if case.fault == WireFault("drop", 0)]
    chosen = [case for case in every if case.way == "to" and b"G53" in case.data][:1]
    runner.carry_out(chosen, tmp_path / "found.jsonl", 1)
    (record,) = records_of(tmp_path / "found.jsonl")
    assert (record["exit"], record["reason"], record["resumed"]) == ("failed", "move 0", True)


def test_the_shards_of_a_campaign_cover_every_case_once() -> None:
    found = [[n for n in range(1000) if in_shard(f"grbl/lift/{n}/stage to drop 1", one, 7)] for one in range(1, 8)]
    assert sorted(itertools.chain(*found)) == [*range(1000)]
    assert min(map(len, found)) > 100


def test_a_continued_campaign_skips_the_cases_of_its_commit(tmp_path: Path) -> None:
    """At this commit; a line that is torn counts as nothing."""
    lines = [
        '{"commit": "a1", "case": "grbl/lift/1/x"}',
        '{"commit": "b2", "case": "rtu/lift/1/x"}',
        '{"commit": "a1"',
    ]
    (tmp_path / "found.jsonl").write_text("\n".join(lines), encoding="ascii")
    assert [record["case"] for record in records_of(tmp_path / "found.jsonl")] == ["grbl/lift/1/x", "rtu/lift/1/x"]
    assert names_in(tmp_path / "found.jsonl", "a1") == {"grbl/lift/1/x"}
    assert names_in(tmp_path / "found.jsonl", "a1", "rtu/") == set()


def test_a_campaign_summary_counts_violations_that_are_not_exempt() -> None:
    about = {**FINE, "commit": "a1", "bench": "grbl", "phase": "lift", "claim": "clear", "exempt": None, "s": 0.5}
    bad = {**about, "case": "bad", "worst_gwt": 20.0, "violations": ["force"]}
    spared = {**bad, "case": "spared", "worst_gwt": 30.0, "exempt": EXEMPTIONS[0].name}
    found = CampaignSummary([{**about, "case": f"fine {n}", "violations": []} for n in range(60)] + [bad, spared])
    assert (found.bad, found.cases.total(), found.spared.total(), found.took_s) == (1, 62, 1, 31.0)
    assert found.phases() == [["phase", "GRBL: cases", "worst, gwt"], ["lift", "62", "20.00"], ["all", "62", ""]]
    assert found.exceptions()[1][:4] == [EXEMPTIONS[0].name, "1", "1", "30.00"]
    assert list(tables_in(found.table())) == [found.phases(), found.exceptions()]


WHOLE = ("grbl", "rtu", "tcp")
"""Benches of which every case was carried out; of the others a sample was."""


def test_the_stored_campaign_tables_have_the_rows_of_a_summary() -> None:
    about = {**FINE, "commit": "a1", "claim": "clear", "exempt": None, "violations": [], "case": "one"}
    found = CampaignSummary({**about, "bench": bench, "phase": "lift"} for bench in WHOLE)
    head, *rows, total = read_table("faults/campaign")
    assert head == found.phases()[0]
    assert [total[n] for n in (1, 3, 5)] == [
        f"{sum(int(row[n].replace(' ', '')) for row in rows):,}".replace(",", " ") for n in (1, 3, 5)
    ]
    assert max(float(row[n]) for row in rows for n in (2, 4, 6)) <= BOUND_GWT
    stored = read_table("faults/exceptions")
    assert [(row[0], row[4]) for row in stored] == [(row[0], row[4]) for row in found.exceptions()]


# --- the program ---

SAMPLED = 1
"""Of each bench, scenario and kind: few seconds of the suite. `make shake` does all on every bench."""
PLAYED = dict.fromkeys(BENCHES, ("press",)) | {
    "grbl": ("press", "hand", "ramp"),
    "rtu": ("again",),
    "tcp": ("press", "resume"),
}
"""Scenarios of each bench; of a kind that is in no other bench, a press."""


def _alone(case: FaultCase) -> bool:
    """A carriage or a cell that fails by itself."""
    return case.fault is None and "none" in (case.mechanics, case.cell)


def _told_to_leave(case: FaultCase) -> bool:
    """A command to the stage on its way up, aside, or back to the finger."""
    return (case.wire, case.way) == ("stage", "to") and case.phase in ("lift", "sideways", "return")


def test_the_campaign_benches_cover_every_device_kind() -> None:
    configs = [config_of(bench) for bench in BENCHES]
    assert {one.stage.kind for one in configs} == set(BUILT_IN["stage"])
    assert {one.force.kind for one in configs} == set(BUILT_IN["force"])


# Drivers and faults of the other kinds: tests/rig/test_faults_in_a_press.py, tests/contracts.
@pytest.mark.quick(rows=lambda bench: bench in ("grbl", "rtu"))
@pytest.mark.parametrize("bench", PLAYED)
def test_a_sample_of_the_campaign_has_no_violation(
    bench: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No case presses beyond the bound, reports what is not so, or loses or repeats a press; see judge.py."""
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "state"))
    whole = list(cases(bench, tmp_path, [one for one in SCENARIOS if one.name in PLAYED[bench]]))
    number = SAMPLED * len(PLAYED[bench])
    groups = (whole, list(filter(_alone, whole)), list(filter(_told_to_leave, whole)))
    picked = {case.name: case for group in groups for case in sample(group, number, seed=0)}
    chosen = sorted(picked.values(), key=lambda case: (case.scenario, case.message))
    runner.carry_out(chosen, tmp_path / "found.jsonl", 1)
    found = list(records_of(tmp_path / "found.jsonl"))
    assert len(found) == len(chosen)
    bad = [told(record) for record in found if record["violations"] and not record["exempt"]]
    assert not bad, "\n".join(bad)
