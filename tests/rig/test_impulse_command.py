"""`rig impulse`: what it prints, draws, and refuses."""

from pathlib import Path

import numpy as np
import pytest

from tests.program import Program, program_of


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Program:
    monkeypatch.chdir(tmp_path)
    return program_of(monkeypatch, capsys)


def test_it_says_h_g_f_in_both_axes_and_draws_them(rig: Program) -> None:
    ended = rig("impulse", "--half-length", 16, "--picture", "impulse.svg")
    assert ended.code == 0
    for axes in ("skin", "cartesian"):
        assert f"{axes} axes, 33 samples 0.17 mm apart" in ended.out
    assert "SED (finite)" in ended.out
    assert "2.04" in ended.out  # three quarters of the half length: 12 samples
    drawn = Path("impulse.svg").read_text(encoding="utf-8")
    assert drawn.startswith("<?xml")
    assert rig("impulse", "--picture", "impulse.svg", "--json").error_code == "exists_already"


def test_as_json_it_has_every_array(rig: Program) -> None:
    found = rig("impulse", "--half-length", 8, "--energy", "incompressible", "--json").json
    assert found["energy"] == "incompressible"
    for axes in ("skin", "cartesian"):
        mine = found[axes]
        assert mine["place_mm"][0] == pytest.approx(-8 * 0.17)
        assert len(mine["h"]) == len(mine["g"]) == len(mine["f"]) == 17
        assert np.argmax(mine["h"]) == 8
        assert len(mine["spectra"]["cycles_per_mm"]) == len(mine["spectra"]["f"]) == 9
        assert mine["g_is_minus_h"]["correlation"] < -0.99
        assert set(mine["tails_over_peak"]) == {"h", "g", "f"}
        assert len(mine["shift_errors_relative_l2"]["sed"]) == len(mine["shift_errors_relative_l2"]["e12"]) == 13
