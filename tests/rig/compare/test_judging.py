"""From recordings to an answer, on stimuli made by hand: what went wrong before, and what belongs together."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.comparison import compare
from rig.compare.comparison_rows import answers_as_json
from rig.compare.exceptions import ComparisonError
from rig.compare.likelihood import Form
from rig.compare.make_verdict import answers
from rig.compare.plausible_fingers import PlausibleFingers
from rig.compare.recordings.recording import Recording, recording
from rig.compare.stimuli import CONTROLS, StimulusRow
from rig.compare.verdict import A_CONSTANT, AfferentVerdict, PairRow
from rig.compare.verdict_text import sentence
from rig.report.page_parts import Section
from rig.report.verdict_section import answer_sections
from sim.measures.measures import MEASURES
from tests.error_codes import raises

Array = NDArray[np.float64]
Make = Callable[..., StimulusRow]

X = np.linspace(-4, 4, 81)
RECEPTORS = np.array([-0.5, 0.0, 0.5])
POSITIONS = np.linspace(-2.4, 2.4, 17)


def peak(centre: float, width: float) -> Array:
    """(n, 3) of a receptor's own x."""
    return np.exp(-(((X[:, None] - RECEPTORS - centre) / width) ** 2))


def profiles(scale: float = 1.0, shift: float = 0.0) -> dict[str, Array]:
    """ep1 is the truth of what follows, sp3 is alike in shape and wrong, s11 something else, all others flat."""
    truth = scale * (peak(0.6 + shift, 0.8) - 0.4 * peak(-1.2 + shift, 0.6))
    return {"ep1": truth, "sp3": np.tanh(2 * truth) + 0.3 * peak(-2, 0.4), "s11": scale * peak(-1.5, 0.5)}


@pytest.fixture
def steps(make_stimulus: Make) -> list[StimulusRow]:
    return [
        _controlled(make_stimulus(f"step:{n}", X, RECEPTORS, profiles(scale, shift)), scale)
        for n, scale, shift in (("1", 1.0, 0.0), ("3", 0.8, 0.1), ("5", 0.6, 0.2))
    ]


def _controlled(stimulus: StimulusRow, scale: float) -> StimulusRow:
    displacement = scale * (peak(0.3, 1.6) + 0.15 * peak(-1.6, 0.5))
    controls = np.stack([scale * peak(0, 0.2), displacement, np.zeros_like(displacement), scale * peak(0, 0.3)])
    return replace(stimulus, controls=controls)


def rates(stimulus: StimulusRow, source: str = "ep1", receptor: int = 1, k: float = 50.0, eps0: float = 0.2) -> Array:
    """(p,) mean rates at `POSITIONS`."""
    values = (
        stimulus.controls_at(POSITIONS)[CONTROLS.index(source)]
        if source in CONTROLS
        else stimulus.at(POSITIONS)[MEASURES.index(source)]
    )
    return np.maximum(0.0, k * (values[:, receptor] - eps0))


def counted(mean: Array, seed: int, presses: int = 5, window_s: float | None = 1.0) -> Recording:
    counts = np.random.default_rng(seed).poisson(mean, size=(presses, len(mean)))
    rows = [(float(x), float(n), np.nan) for row in counts for x, n in zip(POSITIONS, row, strict=True)]
    return recording("synthetic.csv", rows, window_s)


def answer(stimuli: Sequence[StimulusRow], recordings: dict[str, Recording], **options: bool) -> AfferentVerdict:
    (found,) = answers(compare(stimuli, recordings), Form(**options))
    return found


def of_truth(stimuli: Sequence[StimulusRow], seed: int = 0, **how: float) -> dict[str, Recording]:
    return {s.shape: counted(rates(s, **how), seed + n) for n, s in enumerate(stimuli)}  # type: ignore[arg-type]


def row(found: AfferentVerdict, name: str, receptor_mm: float | None = 0.0) -> PairRow:
    return next(one for one in found.rows if (one.name, one.receptor_mm) == (name, receptor_mm))


# --- what went wrong before ---


def test_a_pair_whose_lack_of_fit_is_plain_is_not_in_the_set(steps: list[StimulusRow]) -> None:
    """(a) The set kept what five repeats reject at p < 0.001."""
    found = answer(steps, of_truth(steps))
    truth = row(found, "ep1")
    assert truth.fits
    assert truth in found.set
    rejected = [one for one in found.measures if one.p_fit < 0.001]
    assert len(rejected) > 40
    assert not [one for one in found.set if one.p_fit < 0.05]
    assert row(found, "sp3") in rejected
    assert found.headline is truth
    assert found.worse_by > 10


def test_the_right_measure_stays_when_the_finger_is_another(make_stimulus: Make) -> None:
    """(b) Recorded on a finger between those of the design, where the default finger's fit is rejected."""
    fingers = PlausibleFingers("f.toml", {"tissue.epidermis_mm": (0.3, 0.5)})
    kept = np.zeros(2)
    for seed in range(8):
        shift = np.random.default_rng(seed).uniform(-0.2, 0.2)
        here = [make_stimulus(f"step:{n}", X, RECEPTORS, profiles(1 / int(n), 0.0)) for n in "13"]
        there = [make_stimulus(f"step:{n}", X, RECEPTORS, profiles(1 / int(n), shift)) for n in "13"]
        on_all = [
            replace(s, on_fingers=np.stack([_measures(make_stimulus, 1 / int(s.indentor[-1]), at)
                                            for at in (-0.2, 0.0, 0.2)]))
            for s in here
        ]  # fmt: skip
        recordings = {s.shape: counted(rates(s, k=80), seed) for s in there}
        given, stated = (answers(compare(on_all, recordings, plausible=some))[0] for some in (None, fingers))
        kept += [row(one, "ep1").in_set for one in (given, stated)]
        assert stated.fingers == 3
        assert row(stated, "ep1").finger is not None
        assert row(given, "ep1").finger is None
    assert kept[1] >= 7
    assert kept[0] <= 5


def _measures(make_stimulus: Make, scale: float, shift: float) -> Array:
    return make_stimulus("step:1", X, RECEPTORS, profiles(scale, shift)).measures


def test_table_sentence_and_json_are_of_one_set(steps: list[StimulusRow]) -> None:
    """(c) The table said no of pairs that the sentence above it listed."""
    found = answer(steps[:1], of_truth(steps[:1], k=12.0))
    (told,) = answers_as_json([found])
    in_rows = {(r["measure"], r["receptor_mm"]) for r in told["rows"] if r["in_set"] and not r["control"]}
    assert in_rows == {(one.name, one.receptor_mm) for one in found.set}
    assert told["set"] == [{"measure": one.name, "receptor_mm": one.receptor_mm} for one in found.set]
    assert len(found.set) > 1
    for name in {one.name for one in found.set}:
        assert f"{name} at " in sentence(found)
    out = {one.name for one in found.measures} - {one.name for one in found.set}
    assert not [name for name in out if f"{name} at " in sentence(found)]
    assert [len(one.eps) for one in found.rows] == [len(found.places.rate)] * len(found.rows)
    in_table = [cells[1] for cells in _sections(found)["Fits to the recording"].rows]
    assert in_table.count("yes") == len(found.set) + len(found.controls_in_set)
    assert in_table == sorted(in_table, reverse=True)  # they come first


def _sections(found: AfferentVerdict) -> dict[str, Section]:
    return {one.title: one for one in answer_sections([found], "no offset", recorded=True)}


def test_residuals_of_neighbours_are_correlated_as_the_page_states(steps: list[StimulusRow]) -> None:
    """Products of neighbours of one stimulus in order of position, over squares."""
    found = answer(steps, of_truth(steps))
    best, places = found.headline, found.places
    assert best is not None
    products = squares = 0.0
    for stimulus in range(3):
        mine = np.flatnonzero(places.stimulus == stimulus)
        residual = best.residual[mine[np.argsort(places.position_mm[mine])]]
        products, squares = products + residual[1:] @ residual[:-1], squares + residual @ residual
    point = _sections(found)["Residuals by position"].points[0]
    assert point.endswith(f" r = {products / squares:.2f}.".replace("-", "−"))


def test_the_answer_is_the_recording_s(steps: list[StimulusRow]) -> None:
    """(d) The first verdicts ignored what was recorded."""
    one, other = answer(steps, of_truth(steps)), answer(steps, of_truth(steps, source="s11", eps0=0.1))
    assert one.headline is not None
    assert other.headline is not None
    assert (one.headline.name, other.headline.name) == ("ep1", "s11")
    assert answers(compare(steps, {})) == ()


HARDLY_FIRED = {
    "no spike": (0, 1.0, 0),
    "one spike": (1, 1.0, 1),
    "four spikes in windows of half a second": (4, 0.5, 4),
    "rates that are all zero": (0, None, None),
}
"""Spikes, window (s), and the number of spikes that the verdict states."""


@pytest.mark.parametrize("name", HARDLY_FIRED)
def test_an_afferent_that_hardly_fired_has_no_verdict(name: str, steps: list[StimulusRow]) -> None:
    spikes, window_s, stated = HARDLY_FIRED[name]
    found = answer(steps, {"step:1": _fired(spikes, window_s), "step:3": _fired(0, window_s)})
    assert (found.outcome, found.spikes) == ("silent", stated)
    assert found.set == found.controls_in_set == found.measures == []
    (as_json,) = answers_as_json([found])
    assert as_json["outcome"] == "silent"
    assert (as_json["set"], as_json["rows"], as_json["intervals"], as_json["headline"]) == ([], [], [], None)
    assert (as_json["answer_text"], "\n" in as_json["answer_text"]) == (sentence(found), False)
    assert not set(as_json["answer_text"].replace(".", "").split()) & {*MEASURES, *CONTROLS}
    (section,) = answer_sections([found], "no offset", recorded=True)
    assert (section.text, section.figures, section.rows) == (sentence(found), (), ())


def _fired(spikes: int, window_s: float | None) -> Recording:
    rows = [(float(x), 0.0, np.nan) for x in POSITIONS for _ in range(3)]
    rows[20] = (rows[20][0], spikes / (window_s or 1.0), np.nan)
    return recording("synthetic.csv", rows, window_s)


def test_from_five_spikes_on_measures_are_compared(steps: list[StimulusRow]) -> None:
    found = answer(steps, {"step:1": _fired(5, 1.0)})
    assert (found.outcome, found.spikes, len(found.measures)) == ("not beyond controls", 5, 3 * len(MEASURES))


def test_positions_are_those_that_were_used(steps: list[StimulusRow]) -> None:
    """(e) "On 58 positions", where 47 were used. Receptors at ±0.5 mm do not see positions near ±4 mm."""
    rows = [(float(x), 20.0 + n, np.nan) for x in (*POSITIONS, 3.6, -3.8) for n in range(3)]
    found = answer(steps[:1], {"step:1": recording("wide.csv", rows, 1.0)})
    assert (len(found.places.rate), found.recorded) == (17, 19)
    assert [one[:3] for one in found.left_out] == [("step:1 at 2.33 gwt", (-3.8, 3.6), (21.0, 21.0))]
    (told,) = answers_as_json([found])
    assert (told["positions"], told["positions_recorded"]) == (17, 19)
    assert answer(steps, of_truth(steps)).left_out == ()


# --- controls ---


def test_rates_made_by_a_control_are_explained_by_no_measure(steps: list[StimulusRow]) -> None:
    rng = np.random.default_rng(0)
    recordings = {}
    for stimulus in steps:
        mean = rates(stimulus, "skin displacement", eps0=0.0)
        rows = [(float(x), float(r), np.nan) for _ in range(5)
                for x, r in zip(POSITIONS, mean * (1 + 0.08 * rng.normal(size=len(mean))), strict=True)]  # fmt: skip
        recordings[stimulus.shape] = recording("x", rows)
    found = answer(steps, recordings)
    assert found.noise.kind == "rates"
    assert (found.set, found.outcome) == ([], "nothing")
    assert row(found, "skin displacement") in found.controls_in_set
    assert next(m for m in found.power.mimics if m.control.startswith("skin displacement")).probability > 0.8


def test_where_noise_hides_it_the_power_is_told(steps: list[StimulusRow]) -> None:
    """The skin moves nearly as ep1 does."""
    alike = [replace(s, controls=np.stack([s.measures[6] + 0.02 * peak(0, 1)] * len(CONTROLS))) for s in steps]
    found = answer(alike, of_truth(alike, source="skin displacement", k=20.0))
    assert found.outcome == "not beyond controls"
    assert {one.name for one in found.set} == {"ep1"}
    assert "skin displacement" in {one.name for one in found.controls_in_set}
    assert max(m.probability for m in found.power.mimics) < 0.8
    assert found.power.detectable > 0.05


def test_controls_are_marked_and_a_constant_is_one_of_them(steps: list[StimulusRow], make_stimulus: Make) -> None:
    found = answer(steps, of_truth(steps))
    assert {one.name for one in found.controls} == {*CONTROLS, A_CONSTANT}
    assert {one.name for one in found.measures} == set(MEASURES)
    assert len(found.rows) == (len(MEASURES) + len(CONTROLS)) * 3 + 1
    assert [m.control.split(" at ")[0] for m in found.power.mimics] == list(CONTROLS)
    bare = make_stimulus("step:1", X, RECEPTORS, profiles())
    assert [one.name for one in answer([bare], of_truth([bare])).controls] == [A_CONSTANT]
    mixed = answer([steps[0], replace(steps[1], controls=None)], of_truth(steps[:2]))
    assert [one.name for one in mixed.controls] == [A_CONSTANT]


# --- what belongs together ---


def test_one_afferent_is_fitted_once_over_all_that_was_recorded(
    steps: list[StimulusRow], make_stimulus: Make
) -> None:
    bar = _controlled(make_stimulus("bar:3.0", X, RECEPTORS, profiles(0.9, -0.2), kind="doi_mm", commanded=1.0), 1.0)
    found = answer([*steps, bar], of_truth([*steps, bar]))
    assert found.stimuli == ("bar:3.0 at 1 mm", *(f"step:{n} at 2.33 gwt" for n in "135"))
    together = found.together
    assert together is not None
    assert together.p > 0.05
    assert [one.stimulus for one in together.separate] == list(found.stimuli)
    assert min(one.left_out for one in together.separate) > 0.9
    assert found.closest.name == "ep1"
    assert found.closest.left_out > 0.95
    np.testing.assert_allclose([one.k for one in together.separate], 50, rtol=0.2)
    assert together.freedom == (6.0, found.noise.freedom)


def test_separate_fits_that_differ_are_found_out(steps: list[StimulusRow]) -> None:
    recordings = {s.shape: counted(rates(s, k=k), 3) for s, k in zip(steps, (30, 60, 90), strict=True)}
    together = answer(steps, recordings).together
    assert together is not None
    assert together.p < 0.001
    k = [abs(one.k) for one in together.separate]
    assert max(k) > 2 * min(k)
    assert together.ratio > 10


def test_one_stimulus_has_nothing_to_differ_from(steps: list[StimulusRow]) -> None:
    assert answer(steps[:1], of_truth(steps[:1])).together is None


def test_normalised_rates_are_of_one_family_each(steps: list[StimulusRow], make_stimulus: Make) -> None:
    bar = make_stimulus("bar:3.0", X, RECEPTORS, profiles(), kind="doi_mm", commanded=1.0)
    recordings = of_truth([*steps, bar])
    found = answers(compare([*steps, bar], recordings, normalize=True))
    assert [len(one.stimuli) for one in found] == [1, 3]
    assert all(one.noise.kind == "counts" for one in found)


def test_a_recording_laid_over_two_forces_is_not_two_recordings(
    steps: list[StimulusRow], make_stimulus: Make
) -> None:
    harder = make_stimulus("step:1", X, RECEPTORS, profiles(2.0), commanded=8.0)
    found = answers(compare([*steps, harder], of_truth(steps)))
    assert [one.title for one in found] == [
        "step:1 at 2.33 gwt, step:3 at 2.33 gwt, step:5 at 2.33 gwt", "step:1 at 8 gwt",
    ]  # fmt: skip


def test_a_recording_can_be_of_one_condition(steps: list[StimulusRow], make_stimulus: Make) -> None:
    """Two forces: one afferent, fitted over both."""
    harder = _controlled(make_stimulus("step:1", X, RECEPTORS, profiles(2.0), commanded=8.0), 2.0)
    recordings = {
        "step:1@2.33 gwt": counted(rates(steps[0]), 1),
        "step:1@8 gwt": counted(rates(harder), 2),
    }
    found = answer([steps[0], harder], recordings)
    assert found.stimuli == ("step:1 at 2.33 gwt", "step:1 at 8 gwt")
    assert found.closest.name == "ep1"
    assert found.together is not None
    assert found.together.p > 0.05
    with raises(ComparisonError, "never_pressed", shape="step:1@9 gwt", held=["step:1"]):
        compare([steps[0], harder], {"step:1@9 gwt": counted(rates(steps[0]), 1)})


# --- the rows ---


def test_a_row_holds_what_figures_need(steps: list[StimulusRow]) -> None:
    found = answer(steps, of_truth(steps))
    truth, places = row(found, "ep1"), found.places
    np.testing.assert_allclose(truth.predicted, np.maximum(0, truth.k * (truth.eps - truth.eps0)))
    error = np.sqrt(found.noise.dispersion * (truth.predicted + 0.1) / 5)
    np.testing.assert_allclose(truth.residual, (places.rate - truth.predicted) / error)
    np.testing.assert_allclose(places.error, np.sqrt(found.noise.dispersion * (places.rate + 0.1) / 5))
    np.testing.assert_array_equal(places.stimulus, np.repeat([0, 1, 2], 17))
    assert truth.k_interval[0] < 50 < truth.k_interval[1]
    assert truth.eps0_interval[0] < 0.2 < truth.eps0_interval[1]
    assert np.isnan(row(found, "sp3").k_interval).all()
    assert truth.r == pytest.approx(np.corrcoef(truth.eps, places.rate)[0, 1])
    left = ((places.rate - truth.predicted) ** 2).sum()
    assert truth.r2 == pytest.approx(1 - left / ((places.rate - places.rate.mean()) ** 2).sum(), abs=0.01)
    assert [one.deviance for one in found.rows] == sorted(one.deviance for one in found.rows)
    assert 0.9 < found.ceiling < 1
    assert found.ceiling_from == "repeats"
    once = answer(steps, {s.shape: counted(rates(s), 1, presses=1) for s in steps})
    assert (once.ceiling_from, once.noise.source) == ("monotone", "neighbours")
    assert 0.5 < once.ceiling < 1


def test_the_form_is_kept(steps: list[StimulusRow]) -> None:
    found = answer(steps[:1], of_truth(steps[:1]), saturating=True, silent_at_rest=True)
    assert (found.saturating, found.silent_at_rest) == (True, True)
    assert all(not one.k <= 0 and not one.eps0 < 0 for one in found.rows)
    plain = answer(steps[:1], of_truth(steps[:1]))
    assert any(one.eps0 < 0 for one in plain.rows)
    assert {one.saturation for one in plain.rows} == {0.0}
