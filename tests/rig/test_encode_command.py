"""`rig encode`: numbers, files and presses in, SED and rates out, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from tests.program import Program, program_of

QUICK = ("--half-length", 8)


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Program:
    monkeypatch.chdir(tmp_path)
    return program_of(monkeypatch, capsys)


def test_two_samples_by_both_operators(rig: Program) -> None:
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


def test_a_press_says_how_far_the_operator_is_from_finite_elements(rig: Program) -> None:
    press = ("encode", "--shape", "cylinder:3", "--doi-mm", 0.4, *QUICK)
    felt = rig(*press, "--operator", "influence", "--json").json["against_finite_elements"]
    assert abs(felt["relative_l2"]) < 1e-6
    assert abs(felt["peak"]) < 1e-6
    folded = rig(*press, "--x-mm", 0.5, "--snr-db", 20, "--threshold", 0.1, "--picture", "encoded.svg")
    assert "  difference from finite elements: " in folded.out
    assert "noise added to the receptor: 20 dB over M = " in folded.out
    assert "of the peak, seed 0" in folded.out
    assert Path("encoded.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_a_press_far_off_the_middle_is_felt_too(rig: Program) -> None:
    """On a wider patch of skin than the section begins with, and on a mesh of its own: not to round-off."""
    press = ("encode", "--shape", "bar:1.5", "--x-mm", 4, "--doi-mm", 0.3, "--operator", "influence", *QUICK)
    assert rig(*press, "--json").json["against_finite_elements"]["relative_l2"] < 0.01


def test_pressures_from_a_file(rig: Program) -> None:
    Path("p.csv").write_text("place_mm,pressure\n-0.085,20\n0.085,14\n", encoding="utf-8")
    options = (*QUICK, "--snr-db", 10, "--seed", 3, "--noise", "output", "--gain", 2, "--threshold", 0, "--json")
    by_file, by_hand = (rig("encode", "--pressure", given, *options).json for given in ("p.csv", "20,14"))
    assert by_file == by_hand
    assert min(by_file["rate"]) == 0
    assert by_file["noise_share_of_peak"] > 0.05
