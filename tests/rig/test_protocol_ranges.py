"""Protocols over a range, so that the simulation covers a recording."""

from unittest.mock import MagicMock, call

import pytest

from rig.protocol import RangeParameters
from rig.protocol.script import load_script

STEPPED = {
    "bars": {"width_mm=3.0": (34, 2.805), "width_mm=1.5": (25, 2.04)},
    "gratings": {"periods=1": (10, 0.765), "periods=3": (27, 2.21)},
    "cylinders": {"x_mm=0.4": (1, 0.4)},
    "steps": {"step=1": (21, 2.0), "step=5": (21, 2.5)},
}
"""Every protocol that is stepped across the pad: settings, and the schedule's length and first position."""


def moved_to(name: str, *settings: str) -> list[float]:
    """x of each lateral move of a protocol, in order."""
    script = load_script(name, list(settings))
    rig = MagicMock(parameters=script.parameters)
    script.run(rig)
    return [one.kwargs["x_mm"] for one in rig.move_to.call_args_list]


@pytest.mark.parametrize(
    ("name", "setting", "n", "first"), [(p, s, *found) for p, all_ in STEPPED.items() for s, found in all_.items()]
)
def test_a_shipped_protocol_without_a_range_keeps_its_schedule(name: str, setting: str, n: int, first: float) -> None:
    found = moved_to(name, setting)
    assert (len(found), found[0]) == (n, first)


@pytest.mark.parametrize("name", STEPPED)
def test_a_shipped_protocol_presses_a_range_from_end_to_end(name: str) -> None:
    found = moved_to(name, "from_mm=1", "to_mm=-1.5", "spacing_mm=0.5")
    assert found == [1.0, 0.5, 0.0, -0.5, -1.0, -1.5]
    assert moved_to(name, "from_mm=-0.1", "to_mm=0.1") == [-0.1, 0.0, 0.1]  # 0.17 or less, in that order


def test_the_cylinders_protocol_presses_every_depth_or_one_force_at_each_place() -> None:
    script = load_script("cylinders", ["from_mm=0", "to_mm=1", "spacing_mm=1"])
    rig = MagicMock(parameters=script.parameters)
    script.run(rig)
    assert [one.kwargs["doi_mm"] for one in rig.indent.call_args_list] == 2 * [0.33, 1.0, 1.33]
    script = load_script("cylinders", ["from_mm=0", "to_mm=1", "spacing_mm=1", "force_gwt=5"])
    rig = MagicMock(parameters=script.parameters)
    script.run(rig)
    assert rig.indent.call_args_list == 2 * [call(force_gwt=5.0, hold_s=1.0)]


@pytest.mark.parametrize(
    ("begin", "end", "spacing", "n"),
    [
        (0, 0.17, None, 2),
        (0, 0.171, None, 3),
        (0, 0.34, None, 3),
        (0, 1, 5, 2),
        (5, -5, 0.02005, 500),
        (-20, 20, 1, 41),
    ],
)
def test_a_range_is_divided_into_steps_no_longer_than_the_spacing(
    begin: float, end: float, spacing: float | None, n: int
) -> None:
    found = RangeParameters(from_mm=begin, to_mm=end, spacing_mm=spacing).positions(())
    assert (len(found), found[0], found[-1]) == (n, begin, end)
