"""The source, figure by figure: every entry of the list has what the matrix promises, and rules judge as they say."""

import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.cli import program
from rig.compare.pressure_formula import ContactSamples
from rig.protocol.script import find_script
from sim.config import FingertipConfig
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip
from sim.models.result import median_of_four
from studies.coding.two_samples import SEED, errors_of, sampled_operator
from studies.registry import expanded
from studies.source import pages, pressure_fits
from studies.source.matrix import HEADER, matrix
from studies.source.printed import answers as presses
from studies.source.printed import bars, chapter_6, cylinders, drawing, profiles, steps, table, under_steps
from studies.source.printed.answers import FingerAnswers, PrintedPress, deep, forced, once
from studies.source.printed.catalogue import ENTRIES, named
from studies.source.printed.entry import (
    VERDICTS,
    CheckedClaim,
    Claim,
    Entry,
    MatrixRow,
    found,
    scenes_of,
    together,
    typeset,
)
from studies.source.printed.rules import Above, Below, Measured, Near, Rule, Same, Within
from tests.sim.coarse_mesh import coarse_mesh

ROOT = Path(__file__).parents[2]
CLAIMS = [(entry.key, claim) for entry in ENTRIES for claim in entry.claims]


@pytest.fixture(scope="module")
def coarse() -> Fingertip:
    return presses.load(FingertipConfig(mesh=coarse_mesh(0.4, 0.6)))


@pytest.fixture(scope="module")
def answered(coarse: Fingertip) -> FingerAnswers:
    """What is asked for is pressed."""
    return FingerAnswers(coarse)


@pytest.fixture(scope="module")
def all_answered(coarse: Fingertip) -> FingerAnswers:
    """Every scene of every entry, seconds of presses."""
    all_of_them = FingerAnswers(coarse)
    all_of_them.press_all(scenes_of(ENTRIES), cores=1)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(chapter_6, "DRAWS", 2)
        for snr_db in (10, 20):
            chapter_6.under_noise(all_of_them, snr_db=snr_db)
    return all_of_them


# --- the list ---


def made_up(rule: Rule) -> list[Measured]:
    """Values from far below to far above what a rule looks at, or words it knows and one that it does not."""
    if isinstance(rule, Same):
        return [*rule.agrees, *rule.partly, "something else"]
    numbers = [abs(getattr(rule, name, 0.0)) for name in ("value", "limit", "partly")]
    return [float(v) for v in max(numbers) * np.linspace(-3, 3, 6001)]


def test_every_entry_has_a_number_of_its_own() -> None:
    assert len({entry.key for entry in ENTRIES}) == len({entry.number for entry in ENTRIES}) == len(ENTRIES)
    assert all(re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", entry.key) for entry in ENTRIES)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.key)
def test_an_entry_is_described(entry: Entry) -> None:
    """It shows something in a sentence, has claims or a reason why not, and a command that is there."""
    assert entry.shows.endswith(".")
    reasons = [why for why in (entry.missing, entry.outside, entry.elsewhere) if why]
    assert len(reasons) <= 1
    assert entry.claims or reasons
    assert command_is_there(entry)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.key)
def test_an_entry_has_its_verdict_and_figures(entry: Entry, all_answered: FingerAnswers) -> None:
    row = found(entry, all_answered)
    assert row.verdict in VERDICTS
    assert [len(one.row) for one in row.found] == [6] * len(entry.claims)
    figures = entry.figures(all_answered)
    assert all(figure.caption.rstrip().endswith(".") for figure in figures)
    if entry.claims and entry.number not in ("Table 5.2", "ch. 5, survivors"):
        assert figures


def command_is_there(entry: Entry) -> bool:
    words = entry.command.split()
    if words[0] == "make":
        return f"\n{words[1]}:" in (ROOT / "Makefile").read_text(encoding="utf-8")
    if words[0] == ".venv/bin/rig":
        return words[1] in program.COMMANDS
    if words[0] == ".venv/bin/python":
        assert words[1:3] == ["-m", "studies.source.pages"]
        return [one.key for one in named(pages.parser().parse_args(words[3:]).only)] == [entry.key]
    return bool(entry.outside)


def test_every_rule_can_give_each_verdict() -> None:
    for key, claim in CLAIMS:
        verdicts = {claim.rule.verdict(value) for value in made_up(claim.rule)}
        assert verdicts == {"agrees", "partly", "differs"}, f"{key}: {claim.says}"
        assert claim.source, f"{key}: {claim.says}"
        assert claim.rule.bounds, f"{key}: {claim.says}"


def test_an_entry_can_have_each_verdict() -> None:
    rule = Below(1, 2)
    told = {
        together([rule.verdict(value) for value in values]) for values in ((0.0, 1.0), (0.0, 9.0), (2.0, 2.0), (9.0,))
    }
    assert told == {"agrees", "partly", "differs"}


@pytest.mark.parametrize("number", ["1", "3", "5"])
def test_steps_stand_where_the_protocol_moves_them(number: str) -> None:
    protocol = runpy.run_path(str(find_script("steps")))
    assert protocol["POSITIONS_MM"][number] == steps.POSITIONS_MM[number]


@pytest.mark.parametrize("width", ["1.5", "3.0"])
def test_bars_stand_where_the_protocol_moves_them(width: str) -> None:
    assert runpy.run_path(str(find_script("bars")))["POSITIONS"] == profiles.BAR_POSITIONS
    places = [scene.x_mm for scene in profiles.BARS[width]]
    np.testing.assert_allclose(np.diff(places), -0.17, atol=1e-9)
    assert places[0] == -places[-1]


def test_what_is_announced_is_pressed_once() -> None:
    scenes = scenes_of(ENTRIES)
    assert len(scenes) == len(set(scenes))
    assert all(scene in scenes for entry in ENTRIES for scene in entry.scenes)


# --- rules ---


@pytest.mark.parametrize(
    ("rule", "agrees", "partly", "differs"),
    [
        (Near(10, 0.1, 0.2), (9.0, 11.0), (8.0, 12.0), (7.9, 12.1)),
        (Within(-1.0, 0.5, 1.0), (-1.5, -0.5), (-2.0, 0.0), (-2.1, 0.1)),
        (Below(1.0, 2.0), (1.0, -5.0), (1.1, 2.0), (2.1, np.inf)),
        (Above(1.0, 0.5), (1.0, 5.0), (0.9, 0.5), (0.4, -np.inf)),
        (Same(("a", "b"), ("c",)), ("a", "b"), ("c",), ("d", "none")),
    ],
)
def test_bounds_belong_to_the_better_verdict(
    rule: Rule, agrees: tuple[Any, ...], partly: tuple[Any, ...], differs: tuple[Any, ...]
) -> None:
    for word, values in (("agrees", agrees), ("partly", partly), ("differs", differs)):
        assert [rule.verdict(value) for value in values] == [word] * len(values)


@pytest.mark.parametrize("rule", [Near(10, 0.1, 0.2), Within(1, 1, 2), Below(1, 2), Above(1, 0)])
def test_what_is_no_number_differs(rule: Rule) -> None:
    assert rule.verdict(np.nan) == "differs"


@pytest.mark.parametrize(
    ("rule", "ours", "told", "bounds"),
    [
        (Near(2000, 0.15, 0.35), 2640.0, "+32 %", "± 15 %, ± 35 %"),
        (Within(-1.6, 0.17, 0.51), -1.19, "+0.41", "± 0.17, ± 0.51"),
        (Below(1000, 1200), 677.0, "−323", "≤ 1000, ≤ 1200"),
        (Above(0.75, 0.4), 0.5, "−0.25", "≥ 0.75, ≥ 0.4"),
        (Same(("none",), ("left",)), "left", "–", "none; in part left"),
    ],
)
def test_differences_and_bounds_as_a_table_has_them(rule: Rule, ours: Measured, told: str, bounds: str) -> None:
    one = CheckedClaim(Claim("x", "y", rule, lambda _: ours), ours)
    assert (one.difference, one.row[-1]) == (told, bounds)


def test_the_claim_farthest_from_the_source_is_shown() -> None:
    rule = Below(1, 2)
    claims = [Claim(name, "≤ 1", rule, lambda _: 0.0) for name in "abcd"]
    values = (0.0, 2.0, 3.0, 9.0)
    row = MatrixRow(Entry("1-1", "It shows."), tuple(CheckedClaim(c, v) for c, v in zip(claims, values, strict=True)))
    assert row.headline is not None
    assert row.headline.claim.says == "c"
    assert row.told == "partly (1 of 4)"
    table_of = matrix([row])
    assert table_of.header == HEADER
    assert table_of.rows[0][:6] == ("1-1", "It shows.", "c", "≤ 1", "3.00", "+2")


# --- answers ---


def test_a_fact_is_measured_once(coarse: Fingertip) -> None:
    calls: list[float] = []

    @once
    def fact(_: FingerAnswers, value: float) -> float:
        calls.append(value)
        return 2 * value

    one, other = FingerAnswers(coarse), FingerAnswers(coarse)
    assert [fact(one, 1.0), fact(one, 1.0), fact(one, 2.0), fact(other, 1.0)] == [2.0, 2.0, 4.0, 2.0]
    assert calls == [1.0, 2.0, 1.0]


def test_a_press_without_an_answer_is_named(coarse: Fingertip) -> None:
    with pytest.raises(RuntimeError, match=r"bar:3\.0.*value=5"):
        FingerAnswers(coarse).press(deep("bar:3.0", 5.0))


def test_presses_are_those_of_the_finger(coarse: Fingertip, answered: FingerAnswers) -> None:
    by_depth, by_force = coarse.indent("bar:3.0", 0.0, doi_mm=1.0), coarse.indent("step:1", -1.63, force_gwt=2.33)
    assert answered.press(deep("bar:3.0", 1.0)).force_gwt == pytest.approx(by_depth.force_gwt, rel=1e-9)
    assert answered.press(forced("step:1", 2.33, -1.63)).doi_mm == pytest.approx(by_force.doi_mm, rel=1e-9)
    x, values = answered.beneath(deep("bar:3.0", 1.0), "e22")
    np.testing.assert_allclose(x, presses.ROW_X_MM, atol=1e-9)
    row = coarse.model.receptors.depths_mm == 0.75
    at = np.isin(coarse.model.receptors.position_mm[:, 0].round(6), presses.ROW_X_MM)
    np.testing.assert_allclose(values, -by_depth.receptor_measures["e22"][row & at], rtol=1e-9)


def test_profiles_are_at_the_ten_receptors(answered: FingerAnswers) -> None:
    stimulus = profiles.under_bar(answered, "1.5")
    assert stimulus.receptor_mm.tolist() == [-2.0, -1.5, -1.25, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0]
    assert stimulus.title == "bar:1.5 at 1 mm"
    assert len(stimulus.x_mm) == 25
    assert (np.diff(stimulus.x_mm) > 0).all()
    scene = profiles.BARS["1.5"][0]
    places = answered.finger.model.receptors
    ten = (places.depths_mm == 0.76) & np.isin(places.position_mm[:, 0].round(6), stimulus.receptor_mm)
    np.testing.assert_allclose(
        answered.press(scene).receptor_measures["sed"][ten],
        stimulus.measures[MEASURES.index("sed"), np.argmax(stimulus.x_mm)],
    )


# --- what is measured ---


@pytest.mark.parametrize(
    ("left", "right", "told"),
    [
        (0.0, 1.0, "none"),
        (1.01, 0.5, "left slightly"),
        (1.5, 1.0, "left fully"),
        (0.9, 1.2, "right slightly"),
        (2.5, 1.36, "left fully, right slightly"),
        (1.2, 1.2, "both slightly"),
        (1.5, 9.0, "both fully"),
    ],
)
def test_which_edges_are_touched(left: float, right: float, told: str) -> None:
    assert bars.in_words(left, right) == told


def test_shares_of_the_force_add_up(answered: FingerAnswers) -> None:
    for scene in (*steps.MOVED["1"][::6], *steps.MOVED["5"][::6]):
        assert sum(steps.shares(answered, scene)) == pytest.approx(1.0)
    assert steps.shares(answered, steps.MOVED["1"][0]) == pytest.approx((1, 0, 0, 0))  # the lower flat
    assert steps.shares(answered, steps.MOVED["1"][-1]) == pytest.approx((0, 0, 0, 1))


def test_the_thick_cylinder_needs_more_force(answered: FingerAnswers) -> None:
    thick, thin = (answered.press(deep(f"cylinder:{d}", 1.0)).force_gwt for d in (9, 3))
    assert cylinders.more_force(answered, 1) == pytest.approx(thick / thin - 1)
    assert answered.press(cylinders.equal_force(answered)).force_gwt == pytest.approx(
        answered.press(cylinders.THICK[-1]).force_gwt
    )


def test_peaks_are_counted_by_how_far_they_stand_out() -> None:
    x = np.linspace(0, 1, 201)
    two = np.exp(-(((x - 0.3) / 0.05) ** 2)) + 0.5 * np.exp(-(((x - 0.7) / 0.05) ** 2))
    assert drawing.maxima(two) == 2
    assert drawing.second(two) == pytest.approx(0.5, abs=0.001)
    assert drawing.second(x * (1 - x)) == 0.0
    assert drawing.maxima(two - 0.47 * np.exp(-(((x - 0.7) / 0.05) ** 2))) == 1


def test_the_filter_lies_where_its_values_come_from(answered: FingerAnswers) -> None:
    result = answered.press(deep("cylinder:9", 1.0))
    x, values = drawing.filtered(result)
    np.testing.assert_array_equal(values, median_of_four(*result.pressure_profile))
    raw_x, pressure = result.pressure_profile
    assert abs(np.average(x, weights=values) - np.average(raw_x, weights=pressure)) < 0.15


class Fake:
    """Answers with one profile under every scene."""

    def __init__(self, *tops: float) -> None:
        self.x = np.linspace(-2, 2, 401)
        self.profile = sum(
            (top * np.exp(-(((self.x - at) / 0.2) ** 2)) for top, at in zip(tops, (-1.0, 1.0), strict=False)),
            np.zeros(401),
        )

    def beneath(self, scene: PrintedPress, measure: str) -> tuple[np.ndarray, np.ndarray]:
        return self.x, self.profile * (scene.value if scene.kind == "force_gwt" else 1.0)


def test_peaks_of_two_places_are_compared() -> None:
    scene: Any = deep("step:1", 1.0)
    assert under_steps.two_highest(Fake(1.0, 0.25), scene) == pytest.approx(0.25, abs=1e-4)  # type: ignore[arg-type]
    assert under_steps.two_highest(Fake(1.0), scene) == 0.0  # type: ignore[arg-type]


def test_growth_is_from_the_low_to_the_high_force() -> None:
    fake: Any = Fake(1.0)
    assert under_steps.growth(fake, "sed") == pytest.approx([8.0 / 2.33] * 4)
    assert under_steps.alike(fake, -1.63) == pytest.approx(1.0)
    assert under_steps.widths(fake)[0] == pytest.approx(2 * 0.2 * np.sqrt(np.log(2)), abs=0.005)


@pytest.mark.parametrize(
    ("peak", "dip", "told"),
    [(1.0, 0.5, "passes"), (1.0, 0.0, "no dip"), (0.5, 1.0, "dip exceeds peak"), (0.0, 1.0, "only a dip")],
)
def test_a_profile_in_words(peak: float, dip: float, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.arange(9.0)
    profile = np.array([0, 0, -dip, 0, 0, 0, peak, 0, 0], dtype=float)  # steps move towards −x

    class One:
        indentor, x_mm, receptor_mm = "step:1", x, np.array([0.0])

        def ssrp(self, measure: str, k: int) -> np.ndarray:
            return profile

    monkeypatch.setattr(profiles, "under_step", lambda answers, number: One())
    assert profiles.step_in_words(None, 0.0) == told  # type: ignore[arg-type]


def test_mirror_images_correlate_by_their_parity(monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.linspace(-2, 2, 41)

    class Symmetric:
        x_mm, receptor_mm = x, np.array([-2.0, 2.0])

        def ssrp(self, measure: str, k: int) -> np.ndarray:
            one = np.exp(-((x - 0.5) ** 2)) + 0.2 * x
            other = (-1.0 if measure in ("e12", "e13") else 1.0) * one[::-1]
            return (one, other)[k]

    monkeypatch.setattr(profiles, "under_bar", lambda answers, width: Symmetric())
    fake = type("A", (), {"facts": {}})()
    assert min(profiles.mirrored(fake, "3.0").values()) == pytest.approx(1.0)


def test_overlap_is_of_what_either_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "survivors", lambda answers, bars: ["e23", "ep1", "ep3", "sed"])
    assert table.overlap(None, True, table.OF_ALL) == 0.75  # type: ignore[arg-type]


# --- chapter 6 ---


def test_the_search_under_noise_is_that_of_the_study(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chapter_6, "DRAWS", 2)
    errors, _ = errors_of(sampled_operator(), chapter_6.TRUTHS, 20, range(SEED, SEED + 2))
    alone = chapter_6.under_noise(FingerAnswers(None), snr_db=20)  # type: ignore[arg-type]
    assert alone == pytest.approx(errors[0].mean(), rel=1e-12)
    assert errors[0].min() > 0


def test_the_worked_example_goes_where_the_source_goes(answered: FingerAnswers) -> None:
    assert chapter_6.first_move(answered) == pytest.approx(23.9, abs=0.05)
    stuck = (4**2 + 4**2) / (20**2 + 14**2)  # at [24 10]
    assert chapter_6.ends_off(answered, chapter_6.GRID) == pytest.approx(stuck)


def test_shift_invariance_is_told_of_the_sites(answered: FingerAnswers) -> None:
    m = np.array([site.linear.m for site in chapter_6.sites(answered).sites])
    on_pulp = np.array([site.spread.site.on_pulp for site in chapter_6.sites(answered).sites])
    assert (on_pulp.sum(), len(m)) == (18, 24)
    assert chapter_6.exponent(answered, "pulp") == pytest.approx(m[on_pulp].mean())
    assert chapter_6.exponents_spread(answered, "all") == pytest.approx(m.std(ddof=1) / m.mean())
    a = np.array([site.linear.a for site in chapter_6.sites(answered).sites])
    assert chapter_6.sizes_spread(answered, "all") == pytest.approx(a.std(ddof=1) / a.mean())
    assert chapter_6.site_10(answered, "m") == m[9]


def test_what_passes_low_frequencies_has_the_most_of_them(answered: FingerAnswers) -> None:
    h, g, f = (chapter_6.at_rest(answered, k) for k in range(3))
    assert min(h, g) > 0.7 > 0.3 > f
    strain = chapter_6.responses(answered).strain
    assert f == pytest.approx(abs(strain[2].sum()) / np.abs(np.fft.rfft(strain[2])).max())


# --- the page ---


@pytest.mark.parametrize(
    ("entry", "judged"), [({}, True), ({"missing": "a datum"}, False), ({"outside": "x"}, False)]
)
def test_where_nothing_can_be_said_no_claim_has_a_verdict(entry: dict[str, str], judged: bool) -> None:
    one = CheckedClaim(Claim("x", "y", Below(1, 2), lambda _: 9.0), 9.0)
    (cells,) = MatrixRow(Entry("1-1", "It shows.", **entry), (one,)).claims
    assert cells == ("x", "y", "9.00", "+8", *(("differs", "≤ 1, ≤ 2") if judged else ("–", "–")))


def test_the_page_opens_with_the_matrix(
    coarse: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(pages, "load", lambda: coarse)
    pages.main([str(tmp_path), "--only", "4-7", "psychophysics"])
    html = (tmp_path / "only" / "study.html").read_text(encoding="utf-8")
    places = [html.index(text) for text in ("<h1>", 'id="matrix"', 'href="#4-7"', "<figure ", 'id="4-7"')]
    assert places == sorted(places)
    assert "Out of scope: the model ends at the receptor." in html
    assert (tmp_path / "only" / "study.pdf").read_bytes().startswith(b"%PDF")
    tables = (tmp_path / "only" / "tables.md").read_text(encoding="utf-8")
    assert "| 4-7 | SED under step 5" in tables
    printed = capsys.readouterr().out
    assert "2 of 2 presses" in printed
    assert "**4-7: " in printed


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.key)
def test_the_docs_have_every_entry(entry: Entry) -> None:
    """Number, what it shows and the claims with the source's words are those of the list."""
    text = expanded((ROOT / "docs" / "validation" / "source.md").read_text(encoding="utf-8"))
    assert f"| {entry.number} | {entry.shows} |" in text
    for claim in entry.claims:
        assert f"| {typeset(claim.says)} | {claim.source} | " in text


def test_the_formulas_constants_by_shape() -> None:
    d = np.linspace(0.1, 0.4, 4)
    parts = [ContactSamples(np.full(4, doi), d + doi, d, 300 * doi + 700 * d, d, d) for doi in (0.5, 1.0)]
    assert pressure_fits.slope_of_peak(parts) == pytest.approx(300)
    assert pressure_fits.k2_alone(parts) == pytest.approx(700)
    assert np.isnan(pressure_fits.k2_alone([part.where(d < 0.25) for part in parts]))
