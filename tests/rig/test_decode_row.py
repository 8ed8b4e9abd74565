"""`rig decode --readings` with --axial: a row of receptors of the whole finger under a named axial shape."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rig.cli import decode
from rig.cli.decode import axial_of
from rig.errors import BadInputError
from sim.coding.operators import centred
from sim.coding.section import SkinLine
from sim.coding.sheet import HALF_LENGTHS_MM, ROW_ERROR
from sim.config import FingertipConfig
from sim.contact.patch import X
from sim.models.catalogue import load
from tests.error_codes import raises
from tests.program import Program, program_of
from tests.sim.coarse_mesh import as_toml, coarse_mesh

MESH = coarse_mesh(0.2, 0.35, patch_x_mm=3.0, patch_z_mm=2.6)
CONFIG = FingertipConfig(mesh=MESH)
PLACES = centred(25, 0.2)
FILE = Path("r.csv")


@pytest.fixture(scope="module")
def _one_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """An empty cache, which the tests of this file share: they ask for the same finger."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def cylinder(_one_cache: None) -> str:
    """What a cylinder of 6 mm at 0.2 mm is felt as in the receptor plane, with a hundredth of noise."""
    line = SkinLine(load("halfspace", CONFIG).surface, CONFIG.receptor_plane_mm, "skin")
    x_mm = line.below(line.angles(PLACES), 0.76)[:, X]
    finger = load("finger", CONFIG, receptor_x_mm=x_mm.tolist())
    sed = finger.indent("cylinder:6", 0.2, doi_mm=0.6).receptor_measures["sed"]
    sd = 0.01 * float(sed.max())
    said = sed + sd * np.random.default_rng(0).normal(size=len(sed))
    rows = [f"{p:.9g},0.76,{s:.9g},{sd:.9g}" for p, s in zip(PLACES, said, strict=True)]
    return "\n".join(["place_mm,depth_mm,sed,sd", *rows]) + "\n"


@pytest.fixture
def rig(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, cylinder: str
) -> Program:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    Path("coarse.toml").write_text(as_toml(MESH), encoding="utf-8")
    FILE.write_text(cylinder, encoding="utf-8")
    return program_of(monkeypatch, capsys)


def test_a_row_is_decoded_under_the_shape_that_is_named_or_that_explains_it_best(
    rig: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = ("decode", "--readings", "r.csv", "--config", "coarse.toml", "--spacing-mm", "0.2")
    ended = rig(*given, "--axial", "ellipse:1.5")
    assert ended.code == 0
    assert ended.err.startswith("fingertip: loading from the cache, or building …\n")
    assert "; contact along the finger: ellipse:1.5\n" in ended.out
    assert "24 pressures from M = 25 readings" in ended.out
    monkeypatch.setattr(decode, "HALF_LENGTHS_MM", (0.8, 1.5, 3.0))
    best = rig(*given, "--axial", "ellipse", "--json").json
    assert best["axial"] == "ellipse:1.5"
    assert_allclose(best["place_mm"], centred(24, 0.2), atol=1e-9)
    pressure = np.array(best["pressure_pseudo"])
    assert best["place_mm"] @ pressure / pressure.sum() == pytest.approx(0.2, abs=0.2)
    alone = rig(*given, "--json").json  # in the section's one plane
    assert alone["axial"] is None
    assert np.linalg.norm(alone["pressure_pseudo"] - pressure) > 0.1 * np.linalg.norm(pressure)


def _with_z(text: str) -> str:
    return "\n".join(line + (",z_mm" if not k else f",{6.9}") for k, line in enumerate(text.split("\n")[:-1]))


def _short(text: str) -> str:
    return "\n".join(text.split("\n")[:7])


@pytest.mark.parametrize(
    ("change", "options", "code"),
    [
        (str, ("--axial", "sphere"), "bad_value"),
        (str, ("--axial", "ellipse:"), "bad_value"),
        (str, ("--axial", "ellipse:0.2"), "bad_value"),
        (str, ("--axial", "ellipse:nan"), "bad_value"),
        (str, ("--axial", "ellipse:x"), "bad_value"),
        (str, ("--axial", "ellipse", "--decoder", "table"), "not_this_decoder"),
        (str, ("--axial", "ellipse", "--threshold", "1"), "receptor_mismatch"),
        (_short, ("--axial", "ellipse"), "too_short"),
    ],
)
def test_what_cannot_be_meant_is_one_line(
    rig: Program, change: Callable[[str], str], options: tuple[str, ...], code: str
) -> None:
    FILE.write_text(change(FILE.read_text(encoding="utf-8")), encoding="utf-8")
    ended = rig("decode", "--readings", "r.csv", "--config", "coarse.toml", *options, "--json")
    assert (ended.code, ended.json["code"]) == (2, code)
    assert len(ended.err.splitlines()) == 1


def test_a_sheet_and_what_is_not_read_from_a_file_have_no_axial_shape(rig: Program) -> None:
    text = FILE.read_text(encoding="utf-8").replace("place_mm", "x_mm")
    FILE.write_text(_with_z(text), encoding="utf-8")
    ended = rig("decode", "--readings", "r.csv", "--config", "coarse.toml", "--axial", "ellipse", "--json")
    assert ended.json["code"] == "axial_of_sheet"
    with raises(BadInputError, "needs_option", option="--axial", needs="--readings"):
        axial_of("ellipse", "bayes", None)


def test_names_of_axial_shapes() -> None:
    assert axial_of(None, "table", FILE) == ()
    assert axial_of("ellipse", "bayes", FILE) == HALF_LENGTHS_MM == (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.3)
    assert axial_of("ellipse:1.4", "bayes", FILE) == (1.4,)
    assert axial_of("ellipse:0.3", "bayes", FILE) == (0.3,)
    assert axial_of("ellipse:10", "bayes", FILE) == (10.0,)


def test_a_row_is_wrong_by_more_than_a_section() -> None:
    assert (ROW_ERROR.share, ROW_ERROR.length_mm) == (0.06, 1.0)
