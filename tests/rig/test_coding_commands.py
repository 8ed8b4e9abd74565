"""`rig encode`, `rig impulse` and `rig shift-invariance`: what goes in, and the numbers that come out."""

from pathlib import Path

import numpy as np
import pytest

import sim.coding.raju_table_6_1 as kept
from rig.cli import encode
from tests.program import Program, program_of
from tests.sim.coarse_mesh import as_toml, coarse_mesh

QUICK = ("--half-length", 8)
COARSE = ("--config", "coarse.toml", "--spacing-mm", 0.5, "--half-width-mm", 2)


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Program:
    monkeypatch.chdir(tmp_path)
    Path("coarse.toml").write_text(as_toml(coarse_mesh(0.5, 0.5)), encoding="utf-8")
    return program_of(monkeypatch, capsys)


def test_encode_turns_two_pressures_into_sed_by_convolution_and_influence_alike(rig: Program) -> None:
    folded = rig("encode", "--pressure", "20,14", *QUICK, "--json").json
    assert (folded["operator"], folded["energy"], folded["samples"]) == ("convolution", "finite", 18)
    assert folded["pressure"] == {"place_mm": pytest.approx([-0.085, 0.085]), "pseudo": [20, 14]}
    assert len(folded["receptor_mm"]) == len(folded["sed_pseudo"]) == 18
    assert folded["sed_pseudo"] == folded["rate"]
    assert folded["against_finite_elements"] is None

    felt = rig("encode", "--pressure", "20,14", "--operator", "influence", *QUICK, "--json").json
    assert felt["pressure"]["pseudo"] == [20, 14, 0, 0]
    at = np.interp(felt["receptor_mm"], folded["receptor_mm"], folded["sed_pseudo"])
    # near the middle the response hardly depends on the place; receptors lie half a sample apart, read linearly
    assert np.abs(at - felt["sed_pseudo"]).max() < 0.1 * max(felt["sed_pseudo"])


def test_encoding_a_press_states_the_difference_from_finite_elements(rig: Program) -> None:
    press = ("encode", "--shape", "cylinder:3", "--doi-mm", 0.4, *QUICK)
    felt = rig(*press, "--operator", "influence", "--json").json["against_finite_elements"]
    assert abs(felt["relative_l2"]) < 1e-6
    assert abs(felt["peak"]) < 1e-6
    folded = rig(*press, "--x-mm", 0.5, "--snr-db", 20, "--threshold", 0.1, "--picture", "encoded.svg")
    assert "  difference from finite elements: " in folded.out
    assert "noise added to the receptor: 20 dB over M = " in folded.out
    assert "of the peak, seed 0" in folded.out
    assert Path("encoded.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_encoding_a_press_far_off_the_middle_agrees_with_finite_elements(rig: Program) -> None:
    """On a wider patch of skin than the section begins with, and on a mesh of its own: not to round-off."""
    press = ("encode", "--shape", "bar:1.5", "--x-mm", 4, "--doi-mm", 0.3, "--operator", "influence", *QUICK)
    assert rig(*press, "--json").json["against_finite_elements"]["relative_l2"] < 0.01


def test_encode_reads_pressures_from_a_file_as_from_the_command_line(rig: Program) -> None:
    Path("p.csv").write_text("place_mm,pressure\n-0.085,20\n0.085,14\n", encoding="utf-8")
    options = (*QUICK, "--snr-db", 10, "--seed", 3, "--noise", "output", "--gain", 2, "--threshold", 0, "--json")
    by_file, by_hand = (rig("encode", "--pressure", given, *options).json for given in ("p.csv", "20,14"))
    assert by_file == by_hand
    assert min(by_file["rate"]) == 0
    assert by_file["noise_share_of_peak"] > 0.05


def test_encode_states_how_many_pressures_it_read_and_their_range(rig: Program) -> None:
    Path("p.csv").write_text("pressure\n0.5\n20\n14\n", encoding="utf-8")
    read = "3 pressures, 0.5 to 20 pseudo-units (first 0.5, last 14, sum 34.5), 0.17 mm apart"
    assert f"  read: {read}\n" in rig("encode", "--pressure", "p.csv", *QUICK).out
    assert rig("encode", "--pressure", "p.csv", *QUICK, "--json").json["source_text"] == read
    press = rig("encode", "--shape", "bar:3.0", "--doi-mm", 0.3, *QUICK, "--json").json
    assert press["source_text"] == "bar:3 (3 mm wide)"


def test_wrong_pressures_are_refused_in_one_clear_sentence(rig: Program) -> None:
    Path("p.csv").write_text("place_mm,pressure\n0.17,1\n0,2\n-0.17,1\n", encoding="utf-8")
    refused = rig("encode", "--pressure", "p.csv", *QUICK, "--json")
    assert refused.error_code == "other_place"
    assert refused.json["error_text"] == (
        "--pressure p.csv, line 2, column place_mm: 0.17 must be -0.17, since places must rise by 0.17 mm "
        "(--spacing-mm) about 0, the middle of the pad"
    )
    assert "; give numbers such as 20,14" in rig("encode", "--pressure", "20,x", *QUICK).err


def test_impulse_prints_and_draws_h_g_f_in_both_axes(rig: Program) -> None:
    ended = rig("impulse", "--half-length", 16, "--picture", "impulse.svg")
    assert ended.code == 0
    for axes in ("skin", "cartesian"):
        assert f"{axes} axes, 33 samples 0.17 mm apart" in ended.out
    assert "SED (finite)" in ended.out
    assert "2.04" in ended.out  # three quarters of the half length: 12 samples
    drawn = Path("impulse.svg").read_text(encoding="utf-8")
    assert drawn.startswith("<?xml")
    assert rig("impulse", "--picture", "impulse.svg", "--json").error_code == "exists_already"


def test_impulse_has_every_array_as_json(rig: Program) -> None:
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


def test_shift_invariance_prints_the_published_sites_beside_its_own(rig: Program) -> None:
    found = rig("shift-invariance", *COARSE, "--force-gwt", 2, "--receptor-depth-mm", 0.7, "--json").json
    assert found["sampled"] == {"spacing_mm": 0.5, "half_width_mm": 2.0, "depth_mm": 0.7, "force_gwt": 2.0}
    sites = found["sites"]
    assert [site["number"] for site in sites] == list(range(1, 25))
    assert sites[9]["printed"] == {"a": 12.805, "m": 3.959, "r2": 0.961}
    assert (sites[9]["x_mm"], sites[9]["z_mm"], sites[9]["on_pulp"]) == (0.098, 6.893, True)
    assert sites[23]["on_pulp"] is False
    assert set(sites[0]["linear"]) == set(sites[0]["logarithmic"]) == {"a_pseudo", "m", "r", "r2"}
    assert len(sites[0]["by_azimuth"]) == 8
    assert sites[0]["receptors"] > 40
    for where, chosen in (("pulp", sites[:18]), ("all", sites)):
        for kind in ("linear", "logarithmic", "printed"):
            m = np.array([site[kind]["m"] for site in chosen])
            assert found[where][kind]["m"] == pytest.approx(m.mean())
            assert found[where][kind]["m_spread"] == pytest.approx(m.std(ddof=1) / m.mean())
    scaled = found["common_factor"] * found["pulp"]["linear"]["a_pseudo"]
    assert scaled == pytest.approx(found["pulp"]["printed"]["a"])


def test_a_repeated_shift_invariance_solves_no_point_load_again(
    rig: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", "kept")
    monkeypatch.setattr(encode, "_LINE_EVERY", 100)
    made = rig("shift-invariance", *COARSE)
    assert "strain at 200 of " in made.err
    monkeypatch.setattr(kept, "LoadedFinger", None)  # no mesh is made again
    for more in ((), ("--picture", "spread.svg")):
        again = rig("shift-invariance", *COARSE, *more)
        assert (again.code, again.out) == (0, made.out)
    listed = rig("cache").out
    assert "sites       1 file" in listed
    assert "SED under point loads at the 24 sites of the source" in listed
