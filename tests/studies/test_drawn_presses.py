"""Presses drawn at random: within their ranges, the same again, and what is counted over them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from studies.coding import drawn_presses
from studies.coding.drawn_presses import (
    CHOOSING_SEED,
    NEAR,
    WIDER,
    Population,
    anywhere,
    cell,
    drawn,
    held,
    near,
    with_noise,
)
from studies.coding.profiles_read_back import CHOSEN_SEED, SCENES, SEED, SNRS_DB, ProfilePress, ProfileRow, ReadBack

MANY = 300


def row(held_share: float) -> ProfileRow:
    return ProfileRow(ReadBack(0.123, held_share, 0.256, 17.6), ReadBack(0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("kind", range(len(SCENES)))
def test_near_presses_lie_all_over_half_a_millimetre_and_a_fifth(kind: int) -> None:
    scenes = drawn(NEAR, kind, MANY, 5)
    assert {scene.shape for scene in scenes} == {SCENES[kind].shape}
    aside = np.array([scene.x_mm - SCENES[kind].x_mm for scene in scenes])
    deeper = np.array([scene.doi_mm - SCENES[kind].doi_mm for scene in scenes])
    for offset, most in ((aside, 0.5), (deeper, 0.2)):
        assert_allclose([offset.min(), offset.max()], [-most, most], atol=0.03 * most)
        assert np.abs(offset).max() <= most
    assert abs(np.corrcoef(aside, deeper)[0, 1]) < 0.2
    assert scenes[3] == near(kind, 8)
    assert near(kind, 8) != near((kind + 1) % 6, 8)._replace(shape=SCENES[kind].shape)


@pytest.mark.parametrize(
    ("kind", "name", "sizes", "middle"),
    [(0, "bar", (1.2, 3.2), 0.0), (1, "cylinder", (2.5, 12.0), 0.0), (2, "step", (1.0, 5.0), -1.4)],
)
def test_wider_presses_are_of_any_size_place_and_depth(
    kind: int, name: str, sizes: tuple[float, float], middle: float
) -> None:
    assert WIDER.kinds[kind] == name
    scenes = drawn(WIDER, kind, MANY, 5)
    assert {scene.shape.split(":")[0] for scene in scenes} == {name}
    size = np.array([float(scene.shape.split(":")[1]) for scene in scenes])
    assert_allclose([size.min(), size.max()], sizes, rtol=0.03)
    x_mm, doi_mm = np.array([[scene.x_mm, scene.doi_mm] for scene in scenes]).T
    assert_allclose([x_mm.min(), x_mm.max()], [middle - 0.7, middle + 0.7], atol=0.02)
    assert_allclose([doi_mm.min(), doi_mm.max()], [0.4, 0.9], atol=0.01)
    if name == "cylinder":
        assert_allclose(np.median(size), np.sqrt(2.5 * 12.0), rtol=0.1)  # small ones as often as large
    if name == "step":
        assert set(size) == {1.0, 3.0, 5.0}
    assert scenes[2] == anywhere(kind, 7)


def test_the_seeds_of_a_population_are_not_those_chosen_on() -> None:
    begins = sorted([NEAR.seed, WIDER.seed, CHOOSING_SEED, SEED, CHOSEN_SEED, 3000, 5000])
    assert min(np.diff(begins)) >= 200  # of 200 draws none is of two


def test_each_press_has_noise_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    told = []
    monkeypatch.setattr(drawn_presses, "read_back", lambda *what: told.append(what) or ReadBack(0.1, 0.9, 0.2, 5.0))
    one, two = (np.ones(2), np.ones(3)), (np.zeros(2), np.zeros(3))
    rows = with_noise(lambda _: pytest.fail("not asked"), [one, two], 70)
    assert len(rows) == len(SNRS_DB)
    assert [(what[3], what[4]) for what in told] == [(snr, 70 + k) for snr in SNRS_DB for k in (0, 1)]
    assert told[0][1] is one[0]
    assert told[1][2] is two[1]


def test_cells_say_error_coverage_width_and_time() -> None:
    assert cell(row(0.876)) == "12%, 88%, 0.26, 18"


def test_what_is_held_is_pooled_by_snr_and_the_least_cell_named() -> None:
    found = [[row(0.9), row(0.79)], [row(1.0), row(0.8)]]
    assert held(found) == ("Coverage pooled 87.2% (95.0%, 79.5% by SNR); of 4 cells the least 79.0%, 1 below 80%.")


def test_the_table_is_printed_by_kind(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(drawn_presses, "default_section", lambda: None)
    monkeypatch.setattr(drawn_presses, "finer_section", lambda: "finer")
    monkeypatch.setattr(drawn_presses, "frictionless", lambda *_: None)
    monkeypatch.setattr(drawn_presses, "decoders", lambda _: {drawn_presses.OURS: None})
    monkeypatch.setattr(drawn_presses, "pressed", lambda finer, scene: (finer, scene))
    asked = []

    def counted(_: object, presses: list[tuple[str, ProfilePress]], seed: int) -> list[ProfileRow]:
        asked.append((presses, seed))
        return [row(0.9)] * len(SNRS_DB)

    monkeypatch.setattr(drawn_presses, "with_noise", counted)
    drawn_presses.main(2, Population(("one", "two"), near, "Somewhere", 1), 30)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Somewhere; 2 presses a row, each with its own noise, seeds 30 … 31"
    assert lines[1] == "| shape | 0 dB | 10 dB | 20 dB | 30 dB | 40 dB |"
    assert lines[2] == "|---|---|---|---|---|---|"
    assert [line.split(" | ")[0] for line in lines[3:5]] == ["| one", "| two"]
    assert lines[3].endswith(5 * " | 12%, 90%, 0.26, 18" + " |")
    assert lines[-1].startswith("Coverage pooled 90.0%")
    assert asked == [([("finer", near(kind, 30)), ("finer", near(kind, 31))], 30) for kind in (0, 1)]
