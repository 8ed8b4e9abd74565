"""What `--columns` says: names, units, and what it cannot say."""

from typing import Any

import pytest

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import column_map
from tests.error_codes import raises


@pytest.mark.parametrize(
    ("said", "name", "factor"),
    [
        ("position=x:nm", "x", 1e-6),
        ("position=x:µm", "x", 1e-3),  # micro sign
        ("position=x:μm", "x", 1e-3),  # the Greek letter
        ("position=x:CM", "x", 10.0),
        ("position=x (um)", "x (um)", 1e-3),
        ("position=x (um):micron", "x (um)", 1e-3),
        ("rate=rate_per_s:Hz", "rate_per_s", 1.0),
        ("rate=FR (norm):a.u.", "FR (norm)", 1.0),
        ("position=x (parsec):mm", "x (parsec)", 1.0),
        ("position=x", "x", 1.0),
        ("position=a:b:um", "a:b", 1e-3),
        (" position = x : um ", "x", 1e-3),
        ("rate=FR:imp/s", "FR", 1.0),
        ("rate=FR:1/ms", "FR", 1000.0),
        ("rate=FR (/min)", "FR (/min)", 1 / 60),
        ("rate=FR [imp·s⁻¹]", "FR [imp·s⁻¹]", 1.0),
        ("rate=FR (impulses per second)", "FR (impulses per second)", 1.0),
        ("rate=static_rate_per_s", "static_rate_per_s", 1.0),
        ("rate=FR (% of maximum):%", "FR (% of maximum)", 1.0),
        ("time=t:µs", "t", 1e-6),
        ("time=t_s", "t_s", 1.0),
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
    assert column_map(["rate=FR:1/ms,sd=s"])["sd"][:3] == ("s", "1/ms", 1000.0)
    assert column_map(["rate=FR:1/ms,sd=s:1/s"])["sd"][:3] == ("s", "1/s", 1.0)
    assert column_map(["sd=s"])["sd"][:3] == ("s", "", 1.0)


ROLES = "position, rate, sd, repeat, count, window, time, kind, unit, sync, observed, invalid, segment"
LENGTHS = "nm, um, mm, cm, m, in"
RATES = "1/s, Hz, spikes/s, imp/s, 1/ms, 1/min, a.u."


@pytest.mark.parametrize(
    ("said", "code", "fields"),
    [
        (["speed=v"], "no_role", {"given": "speed=v", "roles": ROLES}),
        ([""], "no_role", {"given": ""}),
        (["rate=a", "rate=b"], "role_twice", {"given": "rate=b", "role": "rate"}),
        (["position=x:ft"], "unknown_unit", {"given": "position=x:ft", "unit": "ft", "units": LENGTHS}),
        (["rate=r:kg"], "unknown_unit", {"given": "rate=r:kg", "unit": "kg", "units": RATES}),
        (["position=position_um:mm"], "two_units", {"named": "um", "unit": "mm"}),
        (["position=position_mm:um"], "two_units", {"named": "mm", "unit": "um"}),
        (["position=x (ms):mm"], "two_units", {"named": "ms", "unit": "mm"}),
        (["rate=rate_per_ms:Hz"], "two_units", {"named": "per ms", "unit": "Hz"}),
        (["rate=rate (a.u.):Hz"], "two_units", {"named": "a.u.", "unit": "Hz"}),
        (["rate=rate (Hz):a.u."], "two_units", {"named": "Hz", "unit": "a.u."}),
        (["rate=FR,sd=sd (1/s):1/ms"], "two_units", {"named": "1/s", "unit": "1/ms"}),
        (["time=t_ms:s"], "two_units", {"named": "ms", "unit": "s"}),
        (["window=w_s:ms"], "two_units", {"named": "s", "unit": "ms"}),
        (["sync=pulses (ms):us"], "two_units", {"named": "ms", "unit": "us"}),
        (["observed=obs_s:ms"], "two_units", {"named": "s", "unit": "ms"}),
        (["position=x_ms"], "unknown_unit", {"remedy": "call the column 'x (UNIT)'"}),
        (["window=500"], "beyond_a_finger", {"window": "500"}),
        (["count=n:1"], "unknown_unit", {"given": "count=n:1", "unit": "1", "units": ""}),
        (["position=x,rate=x"], "column_twice", {"column": "x"}),
        (["count=n,rate=r"], "counts_and_rates", {}),
        (["window=-1"], "window_not_above_0", {"window": "-1"}),
        (["window=nan"], "window_not_above_0", {"window": "nan"}),
    ],
)
def test_what_it_cannot_say(said: list[str], code: str, fields: dict[str, Any]) -> None:
    with raises(RecordingError, code, **fields) as caught:
        column_map(said)
    assert "\n" not in str(caught.value)
