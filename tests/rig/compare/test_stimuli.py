"""SSRPs and population responses of a run, and the frame in which recordings are laid over them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.compare.stimuli import StimulusRow, on_widest_skin, stimuli
from rig.data import Run, read_run
from rig.plan.config import load_config
from rig.plan.finger_model import responses
from sim.measures.measures import MEASURES, shown
from sim.models.fingertip import Fingertip
from tests.program import Program
from tests.sim.coarse_mesh import as_toml, coarse_mesh

Make = Callable[..., StimulusRow]

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
        np.testing.assert_array_equal(stimulus.pressure[column], alone.pressure_profile_kpa[1])
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


# --- profiles of unequal length: presses far from the center are solved on a wider patch ---


def test_profiles_of_unequal_length_are_put_on_the_widest_skin() -> None:
    """A piecewise linear profile, so that the interpolation is exact; outside of its own patch nothing is touched."""
    narrow = np.array([-1.0, 0.0, 1.0]), np.array([0.0, 4.0, 0.0])
    wide = np.array([-2.0, -0.5, 0.5, 2.0]), np.array([0.0, 3.0, 5.0, 0.0])
    skin_mm, pressure = on_widest_skin([narrow, wide])
    np.testing.assert_array_equal(skin_mm, wide[0])
    np.testing.assert_array_equal(pressure, [[0.0, 2.0, 2.0, 0.0], wide[1]])


WIDE = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("{shape}")
    rig.home()
    rig.zero()
    for x_mm in {x_mm}:
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.3, hold_s=0.1)
"""
RECORDED_MM = (-4.5, -1.5, 0.0, 0.4, 1.5, 4.5)  # beyond the run at both ends


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.quick(rows=lambda shape: shape == "bar:3.0")  # round patches: sim/test_patches.py
@pytest.mark.parametrize("shape", ["bar:3.0", "step:3", "cylinder:4", "sphere:4"])
def test_a_run_over_more_than_one_patch_is_compared_to_the_end(
    shape: str, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the smallest patch to the widest, and a recording that goes on where the run ends."""
    monkeypatch.chdir(tmp_path)
    mesh = coarse_mesh(0.4, 0.6, patch_x_mm=1.2, patch_z_mm=2.0, round_patch_mm=1.2)
    (tmp_path / "coarse.toml").write_text(as_toml(mesh), encoding="utf-8")
    (tmp_path / "wide.py").write_text(WIDE.format(shape=shape, x_mm=[0.0, 1.5, -1.5, 3.0, -3.0]), encoding="utf-8")
    ended = program("dry-run", "wide.py", "--config", "coarse.toml", "--json")
    assert ended.code == 0, ended.err
    folder = Path(ended.json["run"])
    finger = Fingertip.load(load_config(folder / "config.toml").finger)
    solved = [response.result.pressure_profile[0] for response in responses(read_run(folder), finger)]
    assert len({len(x_mm) for x_mm in solved}) > 1, "one patch is enough for this run: the test says nothing"
    rows = [f"{x:g},{10 + x:g}" for x in RECORDED_MM]
    (tmp_path / "recorded.csv").write_text("\n".join(["position_mm,rate", *rows, ""]), encoding="utf-8")
    ended = program("compare", folder, "--recorded", f"{shape}=recorded.csv", "--out", "page.html", "--json")
    assert ended.code == 0, ended.err
    assert len(ended.json["rows"]) == 180
