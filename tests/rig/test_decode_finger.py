"""`rig decode --readings` on the whole finger: a row under an axial shape, a sheet over x and z, and bad files."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rig.cli import decode
from sim.coding.operators import centred
from sim.coding.readings_file import read_readings
from sim.coding.section import SkinLine
from sim.config import FingertipConfig
from sim.contact.patch import X, Z
from sim.models.catalogue import load
from tests.program import Program, program_of
from tests.sim.coarse_mesh import as_toml, coarse_mesh

ROW_MESH = coarse_mesh(0.2, 0.35, patch_x_mm=3.0, patch_z_mm=2.6)
SHEET_MESH = coarse_mesh(0.3, 0.3, patch_x_mm=2.5, patch_z_mm=2.5, round_patch_mm=2.5)
CONFIG = FingertipConfig(mesh=ROW_MESH)
PLACES = centred(25, 0.2)
FILE = Path("r.csv")
PLANE = FingertipConfig().receptor_plane_mm
SIDE = centred(7, 0.6)
Cells = dict[str, np.ndarray]


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
    Path("row.toml").write_text(as_toml(ROW_MESH), encoding="utf-8")
    Path("sheet.toml").write_text(as_toml(SHEET_MESH), encoding="utf-8")
    FILE.write_text(cylinder, encoding="utf-8")
    return program_of(monkeypatch, capsys)


# --- a row ---


def test_a_row_of_readings_is_decoded_under_the_named_or_the_best_axial_shape(
    rig: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = ("decode", "--readings", "r.csv", "--config", "row.toml", "--spacing-mm", "0.2")
    ended = rig(*given, "--axial", "ellipse:1.5")
    assert ended.code == 0
    assert ended.err.startswith("fingertip: ")
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


# --- a sheet ---


@pytest.fixture(scope="module")
def sphere(_one_cache: None) -> Cells:
    """What a sphere of 4 mm is felt as, with a hundredth of noise."""
    places = {"receptor_x_mm": SIDE.tolist(), "receptor_z_mm": (PLANE + SIDE).tolist()}
    finger = load("finger", FingertipConfig(mesh=SHEET_MESH), slopes=(X, Z), **places)
    pressed = finger.indent("sphere:2", 0.2, z_mm=PLANE + 0.2, doi_mm=0.5)
    sed, at = pressed.receptor_measures["sed"], pressed.model.receptors.position_mm
    sd = 0.01 * float(sed.max())
    noise = sd * np.random.default_rng(0).normal(size=(2, 49))
    depth = np.full(49, 0.76)
    return {
        "x_mm": at[:, X].round(6) + 0.0,
        "z_mm": at[:, Z],
        "depth_mm": depth,
        "sed": sed + noise[0],
        "at_rest": noise[1],
    }


def written(cells: Cells, order: np.ndarray | None = None) -> str:
    rows = np.stack(list(cells.values()), axis=1)[slice(None) if order is None else order]
    lines = [",".join(cells), *(",".join(f"{v:.9g}" for v in row) for row in rows.tolist())]
    FILE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(FILE)


def test_a_sheet_of_readings_gives_pressures_over_x_and_z_with_band_and_contact_extent(
    rig: Program, sphere: Cells
) -> None:
    shuffled = written(sphere, np.random.default_rng(1).permutation(49))
    ended = rig("decode", "--readings", shuffled, "--config", "sheet.toml", "--picture", "sheet.svg")
    assert ended.code == 0
    assert ended.err.startswith("fingertip: ")
    assert "bayes, influence, SED finite: 169 pressures from M = 49 readings in " in ended.out
    (printed_mm,) = re.findall(r" sphere, ([\d.]+) mm", ended.out)
    rows = [line.split() for line in ended.out.splitlines()]
    header = next(row for row in rows if row[:4] == ["x", "\\", "z", "(mm)"])
    assert header[4:] == [f"{z:.1f}" for z in PLANE + centred(13, 0.3)]
    table = [row for row in rows[rows.index(header) + 1 :] if len(row) == 14]
    assert [row[0] for row in table] == [f"{x:.1f}" for x in centred(13, 0.3)]
    assert Path("sheet.svg").read_text(encoding="utf-8").startswith("<?xml")

    found = rig("decode", "--readings", written(sphere), "--config", "sheet.toml", "--json").json
    pressure = np.array(found["pressure_pseudo"]).reshape(13, 13)
    assert_allclose(np.array([row[1:] for row in table], dtype=float), pressure, atol=0.51)
    place = np.array(found["place_mm"])
    assert_allclose(place[[0, 1, 13]], [[-1.8, PLANE - 1.8], [-1.8, PLANE - 1.5], [-1.5, PLANE - 1.8]], atol=1e-6)
    assert_allclose(place.T @ np.array(found["pressure_pseudo"]) / pressure.sum(), [0.2, PLANE + 0.2], atol=0.15)
    assert found["felt"]["shape_class"] == "sphere"
    assert found["felt"]["size_mm"] == pytest.approx(4.0, rel=0.3)
    assert float(printed_mm) == pytest.approx(found["felt"]["size_mm"], abs=0.051)
    assert len(found["felt"]["extent_mm"]) == 2
    assert (found["converged"], found["problems_text"]) == (True, [])
    assert len(found["receptor_mm"]) == 49
    assert found["noise"]["known_text"] == "measured from 49 receptors at rest"
    low, high = (np.array(found["band_90"][end]) for end in ("low_pseudo", "high_pseudo"))
    assert ((low <= found["pressure_pseudo"]) & (high >= found["pressure_pseudo"])).all()


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda c: {"place_mm": c["x_mm"], **{k: v for k, v in c.items() if k != "x_mm"}}, "sheet_without_x"),
        (lambda c: c | {"z_mm": np.full(49, 40.0)}, "z_outside"),
        (lambda c: c | {"x_mm": np.ones(49), "z_mm": np.full(49, 7.0)}, "same_place"),
        (lambda c: c | {"x_mm": c["x_mm"] / 10}, "too_short"),
    ],
)  # fmt: skip
def test_readings_that_form_no_sheet_are_refused_in_one_line(
    rig: Program, sphere: Cells, change: Callable[[Cells], Cells], code: str
) -> None:
    ended = rig("decode", "--readings", written(change(sphere)), "--config", "sheet.toml", "--json")
    assert (ended.code, ended.json["code"]) == (2, code)
    assert ended.json["error_text"].startswith("--readings")


def test_readings_at_the_same_x_and_another_z_belong_to_different_receptors(rig: Program, sphere: Cells) -> None:
    given = read_readings(Path(written(sphere)), FingertipConfig())
    assert given.z_mm is not None
    assert_allclose(given.place_mm, np.repeat(SIDE, 7), atol=1e-6)
    assert_allclose(given.z_mm, np.tile(PLANE + SIDE, 7))
    order = np.lexsort((sphere["z_mm"], sphere["x_mm"].round(6)))
    assert_allclose(given.reading, sphere["sed"][order], rtol=1e-6)
    assert given.at_rest is not None
    assert_allclose(given.at_rest, sphere["at_rest"][order], rtol=1e-6)
