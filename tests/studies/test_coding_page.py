"""The page of chapter 6: what is worked out for it, in which order it is shown, and what is kept beside it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.report.page import Section
from rig.session.resume import commit
from sim.coding.all_sites import all_sites, deformed_by
from sim.coding.operators import centred
from sim.coding.point_loads import LoadedFinger
from sim.coding.point_spread import MovedResponse, receptor_sheet
from sim.coding.pressure import borne_by
from sim.config import FingertipConfig
from studies.coding import (
    curvature_read_back,
    decoding_part,
    edge_place,
    pages,
    profiles_part,
    profiles_read_back,
    shapes_part,
    shapes_read_back,
    spread_part,
)
from studies.coding.bands import drawn_presses
from studies.coding.decoding_part import NoisyDecoding
from studies.coding.profiles_read_back import SNRS_DB, ProfilePress, ProfileRow, ReadBack, default_section
from tests.sim.coarse import coarse_mesh

DRAWS = 3


@pytest.fixture(scope="module")
def spreads() -> spread_part.Spreads:
    finger = LoadedFinger(FingertipConfig(mesh=coarse_mesh(0.5, 0.5)))
    sites = all_sites(MovedResponse.of(finger, receptor_sheet(finger, 0.5)), 1.0, 2.0)
    return spread_part.Spreads(sites, deformed_by(finger, sites.sites[9], 1.0), [("bar:3.0", "1", "2", "3", "4")], 77)


@pytest.fixture(scope="module")
def noise() -> NoisyDecoding:
    return decoding_part.noisy("[20 14] ± 3", 30, DRAWS)


def cells(section: Section, row: str) -> tuple[str, ...]:
    return next(cells for cells in section.rows if cells[0] == row)


# --- shift invariance ---


def test_every_site_stands_beside_its_printed_numbers(spreads: spread_part.Spreads) -> None:
    table, error_map, shapes = spread_part.spread_sections(spreads)
    assert len(table.rows) == 26
    assert cells(table, "10")[-3:] == ("12.80", "3.96", "0.961")  # Raju 1998, Table 6.1
    assert cells(table, "19, tip")[-2] == "4.19"
    for where, name, printed in (
        ("pulp", "mean, 18 of the pulp", "3.89 ± 4.9%"),
        ("all", "mean, all 24", "3.98 ± 6.2%"),
    ):
        row = cells(table, name)
        m = np.array([law.m for law in spreads.sites.laws(where)])  # type: ignore[arg-type]
        assert row[2] == f"{m.mean():.2f} ± {m.std(ddof=1) / m.mean():.1%}"
        assert row[9] == printed
    assert cells(table, "mean, 18 of the pulp")[1].startswith("12.04 ± ")  # by the common factor
    assert {len(row) for row in table.rows} == {len(table.header)}
    assert table.figures[0].plot.svg.startswith("<?xml")
    assert error_map.figures[0].plot.svg.startswith("<?xml")
    assert shapes.rows == (("bar:3.0", "1", "2", "3", "4"),)


def test_the_plane_that_is_drawn_moves_down_where_it_is_pressed(spreads: spread_part.Spreads) -> None:
    at, moved = spreads.deformed
    assert at.shape == moved.shape
    most = np.unravel_index(np.linalg.norm(moved, axis=-1).argmax(), moved.shape[:2])
    load = spreads.sites.sites[9].spread.load_mm
    assert most[1] == 0  # of the skin
    assert np.linalg.norm(at[most] - load[:2]) < 0.5
    assert moved[most][1] < 0


# --- decoding ---


def test_the_worked_example_ends_where_the_source_says_and_sticks_on_grids() -> None:
    found = decoding_part.searched()
    rows = {row[0]: row for row in found.rows}
    assert rows["univariate, converged"][1] == "[20.00 14.00]"
    assert rows["univariate, converged"][5] == "[23.9 10.0]"  # the source prints [24 10]
    assert rows["univariate, grid of 1"][1] == "[24.00 10.00]"
    assert found.samples == 50
    assert found.converged_error < 1e-9 < found.grid_errors.min()
    (section,) = decoding_part.search_sections(found)
    assert {len(row) for row in section.rows} == {len(section.header)}
    assert [figure.plot.svg[:5] for figure in section.figures] == ["<?xml"] * 2


def test_draws_are_of_the_distribution_and_the_same_again(noise: NoisyDecoding) -> None:
    again = decoding_part.noisy("[20 14] ± 3", 30, 2)
    np.testing.assert_array_equal(again.found, noise.found[:, :2])
    assert noise.found.shape == (3, DRAWS, 2)
    assert noise.errors[1:].max() < 0.005 < noise.errors[0].min()  # a grid of 1 sticks
    fixed = decoding_part.noisy("", 40, 2)
    np.testing.assert_allclose(fixed.found[1], [[20, 14]] * 2, atol=1.0)
    np.testing.assert_allclose(
        fixed.errors[1], ((fixed.found[1] - [20, 14]) ** 2).sum(axis=1) / (20**2 + 14**2), rtol=1e-12
    )


def test_noise_is_told_per_cell(noise: NoisyDecoding) -> None:
    (section,) = decoding_part.noise_sections({"one": {10: noise, 20: noise}}, {10: noise}, 50)
    assert [row[:2] for row in section.rows] == [("one", "10"), ("one", "20")]
    ours, theirs = noise.errors[2], noise.errors[1]
    assert section.rows[0][4] == f"{ours.mean():.4f} ± {ours.std(ddof=1):.4f}"
    apart = ours - theirs
    assert section.rows[0][5] == f"{apart.mean():+.4f} ± {apart.std(ddof=1) / np.sqrt(DRAWS):.4f}"
    assert {len(row) for row in section.rows} == {len(section.header)}
    assert f"{DRAWS} draws a cell, M = 50 samples" in section.text
    assert len(section.figures) == 2


# --- the page ---


def test_all_that_is_shown_is_worked_out_once() -> None:
    asked = pages.works(7)
    assert len(set(asked)) == len(asked) == 3 + 6 + 2 * 7 + 3 + 2 * 6 + 3
    assert {name for name, _ in asked} == set(pages._WORKS)
    assert (pages.NOISE, ("U(0, 30)²", 0, 7)) in asked
    assert (pages.NOISE, ("", 20, 7)) in asked


def test_work_is_told_of_as_it_is_done(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(pages, "spread", map)
    monkeypatch.setitem(pages._WORKS, pages.NOISE, lambda *arguments: arguments)
    work = (pages.NOISE, ("", 20, 7))
    told: list[Any] = []
    assert pages.carry_out([work], lambda *what: told.append(what)) == {work: ("", 20, 7)}
    assert told == [(1, 1, work)]
    pages._say(0.0, 1, 4, work)
    assert capsys.readouterr().out.endswith("1 of 4  decoding under noise 20 7\n")


def test_the_page_its_pdf_and_tables_say_what_made_them(tmp_path: Path) -> None:
    page = [Section("One", "Text.", ("a", "b"), (("1", "2"),)), Section("Two", "No table.")]
    made = {"command": "the command", "draws": 7, "nodes": 5, "e_epidermis_mpa": 0.18, "versions": {"numpy": "1"}}
    pages.write(tmp_path, page, made)
    html = (tmp_path / "coding.html").read_text(encoding="utf-8")
    assert html.index('<h2 id="s1">One') < html.index('<h2 id="s2">Two') < html.index("<code>the command</code>")
    assert (tmp_path / "coding.pdf").read_bytes().startswith(b"%PDF")
    assert "| 1 | 2 |" in (tmp_path / "coding_tables.md").read_text(encoding="utf-8")
    kept = json.loads((tmp_path / "coding_tables.json").read_text(encoding="utf-8"))
    assert (kept["draws"], kept["command"]) == (7, "the command")
    assert kept["tables"] == [{"title": "One", "text": "Text.", "header": ["a", "b"], "rows": [["1", "2"]]}]


@pytest.mark.parametrize("draws", ["1", "0", "-3", "some"])
def test_too_few_draws_are_refused(draws: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        pages.main([str(tmp_path / "new"), "--draws", draws])
    assert ended.value.code == 2
    assert "--draws" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_it_is_shown_in_the_order_of_the_chapter(
    spreads: spread_part.Spreads, noise: NoisyDecoding, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pages.section_part, "section_sections", lambda _: [Section("Encoding", "")])
    done: dict[Any, Any] = {(pages.NOISE, job): noise for job in decoding_part.jobs(DRAWS)}
    monkeypatch.setattr(pages.profiles_part, "profile_sections", lambda *_: [Section("Decoding: whole profiles", "")])
    done |= {(pages.PROFILE, job): None for job in pages.profiles_part.jobs(DRAWS)}
    done |= {(pages.AGAINST_NOISE, job): ROWS for job in pages.shapes_part.noise_jobs(DRAWS)}
    done |= {work: [("a", "b")] for work in pages.shape_works(DRAWS)}
    done |= {(pages.SHIFT, ()): spreads, (pages.SEARCH, ()): decoding_part.searched(), (pages.SECTION, ()): None}
    titles = [section.title for section in pages.sections(done, DRAWS)]
    shift, decoding = ["Shift invariance"] * 2, ["Decoding"] * 8
    expected = [*shift, "Convolution under presses of the finger", "Encoding", *decoding]
    assert [title.split(":")[0] for title in titles] == expected
    told = pages.provenance(done, DRAWS)
    assert (told["nodes"], told["draws"]) == (77, DRAWS)
    assert told["command"] == "python -m studies.coding.pages --draws 3"
    assert told["commit"] == commit(Path(pages.__file__))
    assert told["seeds"] == pages.SEEDS


# --- past the source ---


ROWS = [ProfileRow(ReadBack(0.1 * k, 0.9, 0.2, 5.0), ReadBack(0.0, 0.0, 0.0, 0.0)) for k in range(1, 6)]


def test_profiles_against_noise_have_a_cell_for_each_snr() -> None:
    jobs = shapes_part.noise_jobs(40)
    found = dict.fromkeys(jobs, ROWS)
    found[jobs[0]] = [*ROWS[:4], ProfileRow(ReadBack(0.5, 0.6, 0.2, 5.0), ROWS[0].sd)]
    drawn, fixed = shapes_part.noise_sections(found, 40)
    for section, job, last in ((drawn, jobs[6], ROWS[4]), (fixed, jobs[0], found[jobs[0]][4])):
        assert section.header == ("shape", "0 dB", "10 dB", "20 dB", "30 dB", "40 dB")
        first = [f"{10 * k}%, 90%, 0.20, 5" for k in range(1, 5)]
        end = f"50%, {last.mean.held:.0%}, 0.20, 5"
        assert section.rows[0] == (job[0].shape, *first, end)
        assert [row[0] for row in section.rows] == [scene.shape for scene in profiles_read_back.SCENES]
        assert "40 draws a cell" in section.text
    assert drawn.title.endswith("drawn presses")
    assert (
        "within ± 0.5 mm and depths within ± 0.2 mm of the fixed ones, with its own noise (seeds 61000" in drawn.text
    )
    assert "Coverage pooled 90.0%" in drawn.text
    assert "of 30 cells the least 90.0%, 0 below 80%" in drawn.text
    assert fixed.title.endswith("fixed presses")
    assert "(seeds 1000" in fixed.text
    assert "Coverage pooled 89.0% (90.0%, 90.0%, 90.0%, 90.0%, 85.0% by SNR)" in fixed.text
    assert "of 30 cells the least 60.0%, 1 below 80%" in fixed.text


def test_less_noise_is_read_back_better() -> None:
    scene = ProfilePress("cylinder:9", 0.0, 0.67)
    rows = shapes_part.against_noise(scene, 2, "fixed")
    assert len(rows) == len(SNRS_DB)
    assert rows[-1].mean.relative_l2 < 0.5 * rows[0].mean.relative_l2


def test_drawn_presses_are_each_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[ProfilePress] = []
    noise: list[int] = []

    def pressed(_: object, scene: ProfilePress) -> tuple[ProfilePress, ProfilePress]:
        asked.append(scene)
        return scene, scene

    def read_back(_: object, scene: ProfilePress, *told: Any) -> ReadBack:
        noise.append(told[-1])
        return ReadBack(scene.x_mm, 0.9, 0.2, 5.0)

    monkeypatch.setattr(shapes_part, "pressed", pressed)
    monkeypatch.setattr(drawn_presses, "read_back", read_back)
    scene = profiles_read_back.SCENES[4]
    rows = shapes_part.against_noise(scene, 3, "drawn")
    assert asked == [drawn_presses.near(4, 61_000 + k) for k in range(3)]
    assert noise == [61_000, 61_001, 61_002] * len(SNRS_DB)
    assert rows[0].mean.relative_l2 == pytest.approx(np.mean([one.x_mm for one in asked]))
    asked.clear()
    noise.clear()
    shapes_part.against_noise(scene, 3, "fixed")
    assert asked == [scene]  # pressed once
    assert noise == [1000, 1001, 1002] * len(SNRS_DB)


@pytest.mark.parametrize(("draws", "scenes", "noise", "edge"), [(40, 20, 8, 4), (200, 100, 40, 20), (2, 2, 2, 1)])
def test_tables_past_the_source_take_their_part_of_the_draws(draws: int, scenes: int, noise: int, edge: int) -> None:
    arguments = dict(pages.shape_works(draws))
    assert arguments == {pages.SHAPES: (scenes,), pages.CURVATURE: (noise,), pages.EDGES: (edge,)}
    assert {job[1] for job in shapes_part.noise_jobs(draws)} == {draws}
    assert [job[2] for job in shapes_part.noise_jobs(draws)] == 6 * ["fixed"] + 6 * ["drawn"]
    texts = [section.text for section in shapes_part.shape_sections([[], [], []], draws)]
    for text, number in zip(texts, (f"{scenes} bars", f"{noise} draws", f"{edge} draws at each of 6"), strict=True):
        assert number in text


def test_tables_past_the_source_are_as_wide_as_their_headers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapes_read_back, "TEMPLATES", 3)
    monkeypatch.setattr(shapes_read_back, "EVERY", (1, 7))
    monkeypatch.setattr(edge_place, "EVERY", (1, 7))
    monkeypatch.setattr(edge_place, "PLACES_MM", edge_place.PLACES_MM[:2])
    monkeypatch.setattr(curvature_read_back, "DIAMETERS_MM", (6.0,))
    tables = [shapes_part.shapes(1), shapes_part.curvatures(2), shapes_part.edges(1)]
    sections = shapes_part.shape_sections(tables, 2)
    for section, rows in zip(sections, (7, 2, 6), strict=True):
        assert len(section.rows) == rows
        assert {len(row) for row in section.rows} <= {len(section.header)}
    apart, by = zip(*(row[:2] for row in sections[0].rows), strict=True)
    assert apart == ("0.17 mm",) * 2 + ("1.19 mm",) * 2 + ("0.17 mm",) * 3
    assert by[:2] == ("skin", "templates of SED")
    assert by[4] == "skin, convolution"
    assert [row[:3] for row in sections[1].rows] == [("6", "0.5", "0.33"), ("6", "0.8", "0.33")]
    assert [row[:2] for row in sections[2].rows[:2]] == [("0.17 mm", "20"), ("0.17 mm", "30")]


def test_curvature_comes_from_the_skin_and_from_the_formula() -> None:
    section = default_section()
    press = section.finger.indent("cylinder:6", 0.2, doi_mm=0.8)
    true = borne_by(section, press).means(centred(39, 0.17))
    skin, formula = curvature_read_back.both(true)
    assert skin == pytest.approx(1 / 3, rel=0.08)
    assert formula == pytest.approx(1 / 3, rel=0.3)
    inside, down = curvature_read_back.displaced(curvature_read_back.default_operator().skin, true)
    pressed_at = np.flatnonzero(true > 0.2 * true.max())
    np.testing.assert_array_equal(np.flatnonzero(inside), pressed_at[2:-2])
    assert down[inside].max() == pytest.approx(0.8, abs=0.02)
    alone = np.zeros(39)
    alone[20] = 100.0
    assert np.isnan(curvature_read_back.both(alone)[1])


# --- whole profiles ---


def test_a_profile_is_read_back_by_every_decoder_and_drawn_once() -> None:
    scene = profiles_part.jobs(2)[0][0]
    found = profiles_part.profile(scene, 2)
    assert next(iter(found.rows)) == "within contacts, frictionless"
    assert found.drawn.pressure.shape == found.drawn.true.shape == (39,)  # type: ignore[union-attr]
    assert found.receptors == 49 == len(found.drawn.reading)
    error = np.linalg.norm(found.drawn.pressure - found.drawn.true) / np.linalg.norm(found.drawn.true)  # type: ignore[operator, arg-type]
    mean, sd = found.rows["within contacts, frictionless"]
    assert error == pytest.approx(mean.relative_l2, abs=sd.relative_l2)  # one of two draws: ± sd / √2
    (section,) = profiles_part.profile_sections({scene: found}, 2)
    assert section.rows[0][:2] == ("cylinder:9 at 0, 0.67 mm deep", "within contacts, frictionless")
    assert section.rows[0][2] == f"{mean.relative_l2:.1%} ± {sd.relative_l2:.1%}"
    assert {len(row) for row in section.rows} == {len(section.header)}
    assert "39 pressures, 170 µm apart, from noisy SED at M = 49 receptors, 30 dB, 2 draws a row" in section.text
