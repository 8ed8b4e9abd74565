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
    assert len(folded["receptor_mm"]) == len(folded["sed"]) == 18
    assert folded["sed"] == folded["rate"]
    assert folded["against_finite_elements"] is None

    felt = rig("encode", "--pressure", "20,14", "--operator", "influence", *QUICK, "--json").json
    assert felt["pressure"]["pseudo"] == [20, 14, 0, 0]
    at = np.interp(felt["receptor_mm"], folded["receptor_mm"], folded["sed"])
    # near the middle the response hardly depends on the place; receptors lie half a sample apart, read linearly
    assert np.abs(at - felt["sed"]).max() < 0.1 * max(felt["sed"])


def test_a_press_says_how_far_the_operator_is_from_finite_elements(rig: Program) -> None:
    press = ("encode", "--shape", "cylinder:3", "--doi-mm", 0.4, *QUICK)
    felt = rig(*press, "--operator", "influence", "--json").json["against_finite_elements"]
    assert abs(felt["relative_l2"]) < 1e-6
    assert abs(felt["peak"]) < 1e-6
    folded = rig(*press, "--x-mm", 0.5, "--snr-db", 20, "--threshold", 0.1, "--picture", "encoded.svg")
    assert "against finite elements: " in folded.out
    assert "noise at the receptor: 20 dB over M = " in folded.out
    assert "of the peak, seed 0" in folded.out
    assert Path("encoded.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_a_press_far_off_the_middle_is_felt_too(rig: Program) -> None:
    """On a wider patch of skin than the section begins with, and on a mesh of its own: not to round-off."""
    press = ("encode", "--shape", "bar:1.5", "--x-mm", 4, "--doi-mm", 0.3, "--operator", "influence", *QUICK)
    assert rig(*press, "--json").json["against_finite_elements"]["relative_l2"] < 0.01


def test_pressures_from_a_file(rig: Program) -> None:
    Path("p.csv").write_text("place,pressure\n0,20\n1,14\n", encoding="utf-8")
    options = (*QUICK, "--snr-db", 10, "--seed", 3, "--noise", "output", "--gain", 2, "--threshold", 0, "--json")
    by_file, by_hand = (rig("encode", "--pressure", given, *options).json for given in ("p.csv", "20,14"))
    assert by_file == by_hand
    assert min(by_file["rate"]) == 0
    assert by_file["noise_share_of_peak"] > 0.05


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((), "expected exactly one of --pressure and --shape"),
        (("--pressure", "1", "--shape", "bar:3"), "expected exactly one of --pressure and --shape"),
        (("--shape", "bar:3"), "--shape: expected --doi-mm beside it"),
        (("--shape", "tube:3", "--doi-mm", 1), "tube:3"),
        (("--shape", "sphere:3", "--doi-mm", 0.3), "expected --model finger"),
        (("--pressure", "20,nan"), "--pressure nan: expected numbers that are not negative"),
        (("--pressure", "20,-1"), "--pressure -1: expected numbers that are not negative"),
        (("--pressure", "20,x"), "expected numbers, as 20,14, or a CSV with a column pressure"),
        (("--pressure", "words.csv"), "words.csv, line 2, pressure: expected a number, got 'high'"),
        (("--pressure", "1," * 400 + "1"), "401 samples, expected 1 … 400"),
        (("--pressure", "1", "--operator", "magic"), "--operator 'magic': expected convolution or influence"),
        (("--pressure", "1", "--noise", "skin"), "--noise 'skin': expected receptor or output"),
        (("--pressure", "1", "--energy", "free"), "--energy 'free': expected incompressible or finite"),
        (("--pressure", "1", "--snr-db", 101), "--snr-db 101: expected -40 … 100"),
        (("--pressure", "1", "--snr-db", -41), "--snr-db -41: expected -40 … 100"),
        (("--pressure", "1", "--snr-db", 1, "--seed", -1), "--seed -1: expected 0 … "),
        (("--pressure", "1", "--threshold", -0.1), "--threshold -0.1: expected 0 … 1e+09"),
        (("--pressure", "1", "--threshold", 1, "--gain", 0), "--gain 0: expected 1e-09 … 1e+09"),
    ],
)
def test_what_cannot_be_meant_is_one_line(rig: Program, options: tuple[object, ...], expected: str) -> None:
    Path("words.csv").write_text("pressure\nhigh\n", encoding="utf-8")
    ended = rig("encode", *options, *QUICK, "--json")
    assert ended.code == 2
    assert expected in ended.json["error"]
