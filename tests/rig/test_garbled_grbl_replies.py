"""A reply of a GRBL board with one fault in it is read as something or as nothing; no reader fails on it."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices import grbl_link
from studies.faults.campaign.faults import wire_faults

REPLIES: dict[str, tuple[Callable[[str], Any], tuple[str, ...]]] = {
    "settings": (
        grbl_link.parse_setting,
        ("$0=10", "$11=0.010", "$20=1", "$27=1.000", "$100=400.000", "$110=300.000", "$132=22.400", "$130=60.000"),
    ),
    "statuses": (
        grbl_link.parse_status,
        (
            "<Idle|MPos:-1.000,-2.000,-3.000|FS:0,0|WCO:0.000,0.000,-24.630>",
            "<Run|MPos:0.000,0.000,-0.125|FS:60,0|Ov:100,100,100|Pn:D>",
            "<Hold:0|WPos:1.000,2.000,3.000|Bf:15,128|FS:0,0>",
        ),
    ),
    "modes": (lambda line: grbl_link.parse_modes([line]), ("[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F60 S0]",)),
    "alarms": (lambda line: grbl_link.number_after(line, "ALARM:"), ("ALARM:2", "ALARM:11")),
    "errors": (lambda line: grbl_link.number_after(line, "error:"), ("error:9", "error:31")),
    "banners": (grbl_link.is_banner, ("Grbl 1.1h ['$' for help]", "GrblHAL 1.1f ['$' or '$HELP' for help]")),
}


@pytest.mark.parametrize("kind", REPLIES)
def test_every_single_fault_of_a_reply_is_read_without_failing(kind: str) -> None:
    """Each bit flipped, each byte dropped, doubled and swapped, the line cut at each length (`wire_faults`)."""
    read, lines = REPLIES[kind]
    met = 0
    for line in lines:
        for fault in wire_faults(line.encode("ascii"), from_device=False):
            for _, arrived in fault.pieces(line.encode("ascii")):
                read(arrived.decode("ascii", "replace"))
                met += 1
    assert met > 100


@pytest.mark.parametrize(
    ("line", "read"),
    [
        ("$11=0.010", (11, 0.01)),
        ("$0=10 (step pulse, usec)", (0, 10.0)),
        ("$130=60.", (130, 60.0)),
        ("$11=0..010", None),
        ("$11=0.0.10", None),
        ("$11=.", None),
        ("$N0=G21", None),
    ],
)
def test_a_setting_is_one_number_or_none(line: str, read: tuple[int, float] | None) -> None:
    assert grbl_link.parse_setting(line) == read
