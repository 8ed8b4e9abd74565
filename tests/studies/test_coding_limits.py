"""Limits beside decoders' errors: what a reader who is told more could do."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from sim.coding.decoder_results import decoding_errors
from sim.coding.operators import ForwardOperator, centred
from sim.coding.pressure import contact_pressure
from sim.coding.receptor_readings import Readings
from studies.coding import curvature_read_back, edge_place, shapes_read_back
from studies.coding.limits import bayes_found, profile_bound
from studies.coding.profiles_read_back import SCENES, SNRS_DB, WITHIN, baselines, default_section, frictionless
from studies.coding.two_samples import (
    ENDS,
    GRID_STEPS,
    SEED,
    TRUE,
    TRUTHS,
    errors_of,
    sampled_operator,
    worked_example,
)
from studies.registry import read_table

Array = NDArray[np.float64]


@pytest.fixture
def two() -> ForwardOperator:
    parts = np.random.default_rng(0).normal(size=(3, 12, 2))
    return ForwardOperator("convolution", "incompressible", parts, np.arange(2.0), np.arange(12.0))


def test_truths_lie_between_the_ends_that_the_limit_is_told() -> None:
    for name, draw in TRUTHS.items():
        low, high = ENDS[name]
        drawn = np.array([draw(np.random.default_rng(k)) for k in range(200)])
        assert (drawn >= low).all()
        assert (drawn <= high).all()
        assert_allclose(drawn.min(axis=0), low, atol=0.05 * (high - low).max())
        assert_allclose(drawn.max(axis=0), high, atol=0.05 * (high - low).max())


def test_with_hardly_any_noise_the_truth_is_found(two: ForwardOperator) -> None:
    """Finer than the first grid's steps of 0.49, and than the second's."""
    ends = ENDS["U(0, 30)²"]
    assert_allclose(bayes_found(two, two.sed(TRUE), 0.3, ends), TRUE, atol=0.002)


def test_with_nothing_to_go_by_what_is_found_has_the_least_expected_error(two: ForwardOperator) -> None:
    ends = (np.array([5.0, 1.0]), np.array([9.0, 3.0]))
    found = bayes_found(two, np.zeros(12), 1e9, ends)
    drawn = np.random.default_rng(0).uniform(*ends, (20_000, 2))
    weight = 1 / (drawn**2).sum(axis=1)
    assert_allclose(found, weight @ drawn / weight.sum(), rtol=0.01)


def test_nobody_is_better_than_the_limit_on_average(two: ForwardOperator) -> None:
    """Against the mean of the distribution, and against the likeliest pressures."""
    low, high = ENDS["[20 14] ± 3"]
    errors = []
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 40).T, indexing="ij"), axis=-1).reshape(-1, 2)
    sed_of_grid = np.array([two.sed(one) for one in grid])
    for k in range(60):
        rng = np.random.default_rng(k)
        true = rng.uniform(low, high)
        reading = two.sed(true) + 800 * rng.normal(size=12)
        likeliest = grid[((sed_of_grid - reading) ** 2).sum(axis=1).argmin()]
        found = (bayes_found(two, reading, 800.0, (low, high)), TRUE, likeliest)
        errors.append([decoding_errors(true, one).eq_6_8 for one in found])
    limit, middle, likely = np.mean(errors, axis=0)
    assert limit < middle
    assert limit < likely


def test_the_bound_of_a_profile_is_what_its_numbers_are_not_known_to() -> None:
    true, by_number = np.array([3.0, 4.0]), np.array([[1.0], [2.0]])
    sed = np.array([[2.0], [0.0], [1.0]])
    assert profile_bound(true, by_number, sed, 0.5) == pytest.approx(0.5 * np.sqrt(5 / 5) / 5)
    assert profile_bound(true, by_number, sed, 1.0) == pytest.approx(0.2)


SMOOTH = [0.0, 50, 150, 200, 200, 150, 50, 0]
LEVEL = [0.0, 100, 100, 100, 100, 100, 100, 0]


@pytest.mark.parametrize(("true", "within"), [(SMOOTH, {"smooth": 0.02}), (LEVEL, {"look-up": 0.2})])
def test_baselines_find_what_has_no_noise_and_is_as_they_know_it(true: list[float], within: dict[str, float]) -> None:
    """A look-up knows contacts as its table has them, level inside: a bell of pressure is none of them."""
    operator = frictionless(default_section(), np.linspace(-1.0, 1.0, 9), "finite")
    upright = operator.leaning(np.zeros(8))
    sed = upright.sed(np.array(true))
    said = Readings.of_sed(sed, 1e-3 * float(sed.max()))
    found = {name: decode(said) for name, decode in baselines(operator).items() if name != "univariate"}
    assert set(found) == {"smooth", "look-up", "dual annealing"}
    for name, one in found.items():
        assert one.shape == (8,)
        assert (one >= 0).all()
        assert one.max() <= WITHIN.high
        assert decoding_errors(np.array(true), one).relative_l2 < within.get(name, 1.0), name


def test_the_limit_is_below_every_decoder(two: ForwardOperator) -> None:
    operator = sampled_operator()
    errors, ms = errors_of(operator, "[20 14] ± 3", 0, range(SEED, SEED + 6))
    assert 0 < errors[2].mean() < errors[:2].mean(axis=1).min()
    assert ms > 0


def test_draws_are_of_the_distribution_and_the_same_again() -> None:
    operator = sampled_operator()
    first, again = (errors_of(operator, "[20 14] ± 3", 30, range(SEED, SEED + n))[0] for n in (4, 2))
    np.testing.assert_array_equal(first[:, :2], again)
    assert first.max() < 0.005  # a grid of 1 would stick


def test_the_worked_example_ends_where_the_source_says_and_sticks_on_grids() -> None:
    found = worked_example(sampled_operator())
    assert found["univariate, converged"].pressure == pytest.approx([20, 14], abs=0.005)
    first_move = found["univariate, converged"].path[1]
    assert first_move == pytest.approx([23.9, 10.0], abs=0.05)  # the source prints [24 10]
    assert found["univariate, grid of 1"].pressure == pytest.approx([24, 10])
    squared = {name: decoding_errors(TRUE, one.pressure).eq_6_8 for name, one in found.items()}
    assert squared["univariate, converged"] < 1e-9
    assert min(squared[f"univariate, grid of {step:g}"] for step in GRID_STEPS) > 1e-9


# --- curvature, and the tables of the page ---


def test_curvature_comes_from_the_skin_and_from_the_formula() -> None:
    section = default_section()
    press = section.finger.indent("cylinder:6", 0.2, doi_mm=0.8)
    true = contact_pressure(section, press).means(centred(39, 0.17))
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


def test_rows_are_as_wide_as_their_headers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapes_read_back, "TEMPLATES", 3)
    monkeypatch.setattr(shapes_read_back, "EVERY", (1, 7))
    monkeypatch.setattr(edge_place, "EVERY", (1, 7))
    monkeypatch.setattr(edge_place, "PLACES_MM", edge_place.PLACES_MM[:2])
    monkeypatch.setattr(curvature_read_back, "DIAMETERS_MM", (6.0,))
    for module, draws, count in ((shapes_read_back, 1, 7), (curvature_read_back, 2, 2), (edge_place, 1, 6)):
        rows = list(module.rows(draws))
        assert len(rows) == count
        assert {len(row) for row in rows} <= {len(module.HEADER)}


def test_bands_of_drawn_presses_hold_what_they_should() -> None:
    """85 to 95 % of all, 80 % and more of each cell of SNR × shape."""
    head, *rows = read_table("coding/bands_drawn")
    assert head[1:] == [f"{snr:g} dB" for snr in SNRS_DB]
    assert [row[0] for row in rows] == [scene.shape.replace(":", " ") for scene in SCENES]
    held = np.array([[float(cell.split(", ")[1].rstrip(" %")) for cell in row[1:]] for row in rows])
    assert held.min() >= 80
    assert 85 <= held.mean() <= 95
