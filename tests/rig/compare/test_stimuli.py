"""SSRPs and population responses of a run, and the frame in which recordings are laid over them."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.compare.stimuli import Stimulus, stimuli
from rig.data import Run
from sim.measures.measures import MEASURES, shown
from sim.models.fingertip import Fingertip

Make = Callable[..., Stimulus]

RECEPTORS = np.array([-1.0, 0.0, 0.5])


def test_indentor_x_is_position_plus_receptor_x(make_stimulus: Make) -> None:
    """The measure is 100 times the receptor's number plus the indentor's x, so that it says where it was taken."""
    x = np.array([-2.0, -1.0, 0.0, 1.5, 2.0])
    stimulus = make_stimulus("step:1", x, RECEPTORS, {"ep1": x[:, None] + 100 * np.arange(3)})
    found = stimulus.at(np.array([-1.0, 0.25]))[MEASURES.index("ep1")]
    np.testing.assert_allclose(found, [[-2.0, 99.0, 199.5], [-0.75, 100.25, 200.75]], atol=1e-12)


def test_interpolation_is_linear_and_never_goes_outside(make_stimulus: Make) -> None:
    x = np.array([-1.0, 0.0, 1.0])
    stimulus = make_stimulus("bar:3.0", x, np.array([0.0]), {"sed": np.array([[0.0], [8.0], [4.0]])})
    found = stimulus.at(np.array([-1.001, -1.0, -0.25, 0.0, 0.5, 1.0, 1.001]))[MEASURES.index("sed"), :, 0]
    np.testing.assert_allclose(found, [np.nan, 0, 6, 8, 6, 4, np.nan])


def test_one_position_covers_nothing(make_stimulus: Make) -> None:
    stimulus = make_stimulus("bar:3.0", np.array([0.0]), RECEPTORS, {})
    assert np.isnan(stimulus.at(np.array([0.0, 1.0]))).all()


def test_a_run_gives_population_responses_and_ssrps(bar_run: Run, finger: Fingertip) -> None:
    (stimulus,) = stimuli(bar_run, finger)
    assert (stimulus.indentor, stimulus.shape, stimulus.condition) == ("bar:3.0", "bar:3", "0.4 mm")
    np.testing.assert_allclose(stimulus.x_mm, [-0.6, -0.2, 0.1, 0.4, 0.8])
    np.testing.assert_allclose(stimulus.doi_mm, 0.4, atol=0.02)
    np.testing.assert_allclose(stimulus.receptor_mm, [-2, -1.5, -1.25, -1, -0.5, 0, 0.5, 1, 1.5, 2])
    holds = {e["index"]: e for e in bar_run.stream("hold_end") if e["hold"] == 2}
    for index, column in ((0, 4), (4, 0)):  # pressed once: exactly the model's answer at the true pose
        alone = finger.indent("bar:3.0", holds[index]["true_x_mm"], doi_mm=holds[index]["true_doi_mm"])
        for m, name in enumerate(MEASURES):
            expected = shown(name, alone.receptor_measures[name])
            np.testing.assert_array_equal(stimulus.measures[m, column], expected)
        np.testing.assert_array_equal(stimulus.pressure[column], alone.pressure_profile[1])
        assert stimulus.contact_regions_mm(column) == alone.contact_regions_mm


def test_presses_at_one_place_are_averaged(bar_run: Run, finger: Fingertip) -> None:
    (stimulus,) = stimuli(bar_run, finger)
    holds = {e["index"]: e for e in bar_run.stream("hold_end") if e["hold"] == 2}
    both = [finger.indent("bar:3.0", holds[k]["true_x_mm"], doi_mm=holds[k]["true_doi_mm"]) for k in (2, 5)]
    sed = [result.receptor_measures["sed"] for result in both]
    np.testing.assert_allclose(stimulus.measures[MEASURES.index("sed"), 2], np.mean(sed, axis=0), rtol=1e-12)


def test_the_second_reading_comes_from_the_cache(
    bar_run: Run, finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    (before,) = stimuli(bar_run, finger)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("asked the model again")

    monkeypatch.setattr(Fingertip, "indent", refuse)
    (after,) = stimuli(bar_run, finger)
    np.testing.assert_array_equal(before.measures, after.measures)
    np.testing.assert_array_equal(before.pressure, after.pressure)
