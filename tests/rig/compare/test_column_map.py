"""What `--columns` says: names, units, and what it cannot say."""

import pytest

from rig.compare.errors import RecordingError
from rig.compare.recordings.column_map import ColumnMap, column_map


def test_what_is_not_named_has_its_usual_name() -> None:
    usual = ColumnMap()
    roles = ("position", "rate", "sd", "repeat", "count", "window", "time", "kind", "sync")
    names = ["position_mm", "rate", "sd", "repeat", "count", "window_s", "time_s", "kind", "sync_pulses"]
    assert usual.names(*roles) == names
    assert {usual[role].factor for role in roles} == {1.0}
    assert usual.changes(*roles) == ()
    assert column_map([]) == usual


@pytest.mark.parametrize(
    ("said", "name", "factor"),
    [
        ("position=x:nm", "x", 1e-6),
        ("position=x:um", "x", 1e-3),
        ("position=x:µm", "x", 1e-3),  # micro sign
        ("position=x:μm", "x", 1e-3),  # the Greek letter
        ("position=x:mm", "x", 1.0),
        ("position=x:CM", "x", 10.0),
        ("position=x:m", "x", 1000.0),
        ("position=x (um)", "x (um)", 1e-3),
        ("position=x [µm]", "x [µm]", 1e-3),
        ("position=x_cm", "x_cm", 10.0),
        ("position=x (um):mm", "x (um)", 1.0),
        ("position=x (left)", "x (left)", 1.0),
        ("position=x", "x", 1.0),
        ("position=a:b:um", "a:b", 1e-3),
        (" position = x : um ", "x", 1e-3),
        ("rate=FR:Hz", "FR", 1.0),
        ("rate=FR:1/s", "FR", 1.0),
        ("rate=FR:/s", "FR", 1.0),
        ("rate=FR:spikes/s", "FR", 1.0),
        ("rate=FR:imp/s", "FR", 1.0),
        ("rate=FR:1/ms", "FR", 1000.0),
        ("rate=FR:/ms", "FR", 1000.0),
        ("rate=FR:1/min", "FR", 1 / 60),
        ("rate=FR (/min)", "FR (/min)", 1 / 60),
        ("time=t:us", "t", 1e-6),
        ("time=t:µs", "t", 1e-6),
        ("time=t:ms", "t", 1e-3),
        ("time=t_s", "t_s", 1.0),
        ("time=t:min", "t", 60.0),
        ("window=w_ms", "w_ms", 1e-3),
        ("count=n_ms", "n_ms", 1.0),  # a number of spikes has no unit
    ],
)
def test_names_and_units(said: str, name: str, factor: float) -> None:
    role = said.partition("=")[0].strip()
    column = column_map([said])[role]
    assert column.name == name
    assert column.factor == pytest.approx(factor, rel=1e-12)
    assert column.changed is (factor != 1)


def test_the_unit_of_rates_is_their_sd_s() -> None:
    assert column_map(["rate=FR:1/ms,sd=s"])["sd"] == ("s", "1/ms", 1000.0)
    assert column_map(["rate=FR:1/ms,sd=s:1/s"])["sd"] == ("s", "1/s", 1.0)
    assert column_map(["sd=s"])["sd"] == ("s", "", 1.0)


def test_what_was_converted_is_told() -> None:
    found = column_map(["position=x:um,rate=FR:Hz", "sd=s:1/min"])
    assert found.changes("position", "rate", "sd") == ("position from um", "sd from 1/min")


def test_what_is_named_must_be_there() -> None:
    found = column_map(["sd=s"])
    assert found.split(("position", "rate"), ("sd", "repeat")) == (["position_mm", "rate", "s"], ["repeat"])


@pytest.mark.parametrize(
    ("said", "seconds"),
    [("window=0.5", 0.5), ("window=500:ms", 0.5), ("window=w", None), ("window=0.5_ms", None), ("count=3", None)],
)
def test_a_window_that_is_a_number(said: str, seconds: float | None) -> None:
    assert column_map([said]).window_s == (None if seconds is None else pytest.approx(seconds))


ROLES = "position, rate, sd, repeat, count, window, time, kind, sync"


@pytest.mark.parametrize(
    ("said", "complaint"),
    [
        (["speed=v"], f"--columns 'speed=v': expected ROLE=COLUMN[:UNIT], ROLE one of {ROLES}"),
        (["position"], "--columns 'position': expected ROLE=COLUMN[:UNIT]"),
        (["position="], "--columns 'position=': expected ROLE=COLUMN[:UNIT]"),
        ([""], "--columns '': expected ROLE=COLUMN[:UNIT]"),
        (["rate=a,rate=b"], "--columns 'rate=b': rate is given twice"),
        (["rate=a", "rate=b"], "--columns 'rate=b': rate is given twice"),
        (["position=x:ft"], "--columns 'position=x:ft': unit 'ft', expected a unit of nm, um, µm, mm, cm, m"),
        (["position=x:s"], "--columns 'position=x:s': unit 's', expected a unit of nm"),
        (["time=t:mm"], "--columns 'time=t:mm': unit 'mm', expected a unit of us, µs, ms, s, min"),
        (["rate=r:kg"], "--columns 'rate=r:kg': unit 'kg', expected a unit of 1/s, /s, Hz"),
        (["position=:mm"], "--columns 'position=:mm': unit 'mm', expected a unit of"),
        (["count=n:1"], "--columns 'count=n:1': unit '1', expected no unit"),
        (["position=x,rate=x"], "--columns: 'x' is named twice, expected a column for each"),
        (["count=n,rate=r"], "--columns: count beside rate or sd, expected counts (with window) or rates (with sd)"),
        (["count=n,sd=r"], "--columns: count beside rate or sd, expected counts"),
        (["window=0"], "--columns window=0: expected a number of seconds above 0"),
        (["window=-1"], "--columns window=-1: expected a number of seconds above 0"),
        (["window=inf"], "--columns window=inf: expected a number of seconds above 0"),
        (["window=nan"], "--columns window=nan: expected a number of seconds above 0"),
    ],
)
def test_what_it_cannot_say(said: list[str], complaint: str) -> None:
    with pytest.raises(RecordingError) as caught:
        column_map(said)
    assert str(caught.value).startswith(complaint)
    assert "\n" not in str(caught.value)
