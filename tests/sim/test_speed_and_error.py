"""Speed against error: the arithmetic, the reference, and the errors that `auto` promises."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from sim.benchmark import (
    FAMILIES,
    QUANTITIES,
    QUICK_SCENES,
    SCENES,
    BenchmarkScene,
    Candidate,
    SceneResult,
    answered,
    coarse,
    from_levels,
    measure,
    nested,
    rows,
    stored,
)
from sim.cheapest_model import Situation, bundled
from sim.config import FingertipConfig
from sim.contact.shapes import parse_shape
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip

SMOOTH, SHARP = ("smooth",), ("bar", "step")


def answer(force: float) -> SceneResult:
    return SceneResult(force, 1.0, (force, 2.0), (-force, 0.1), 0.0, 1, 0.01, 0.001)


def test_benchmark_errors_and_error_bars_are_ratios_of_largest_values() -> None:
    scenes = [BenchmarkScene(family, "bar:3.0", 0.0, 0.5) for family in FAMILIES]
    reference = from_levels(dict.fromkeys(scenes, answer(3.3)), dict.fromkeys(scenes, answer(3.0)), {})
    found = answer(2.7)
    assert reference.error(scenes[0], "force", found) == pytest.approx(0.1)
    assert reference.error(scenes[0], "sed", found) == pytest.approx(0.1)
    assert reference.bars["step"]["ep1"] == pytest.approx(0.1)
    assert reference.largest_errors(dict.fromkeys(scenes, found))["bar"]["width"] == 0.0


@pytest.mark.parametrize("kind", [SMOOTH, SHARP])
@pytest.mark.parametrize("quantity", ["force", "sed", "ep1"])
def test_a_further_mesh_level_lies_inside_the_error_bars_of_the_reference(
    kind: tuple[str, ...], quantity: str
) -> None:
    # It takes no part in the reference; studies/accuracy/reference_levels.py measures it and stores what it
    # found. Smooth and sharp are the kinds for which aims are set and errors promised;
    # docs/validation/performance.md has the families.
    reference = stored()
    further = max(reference.provenance["further"][family][quantity] for family in kind)
    bar = max(reference.bars[family][quantity] for family in kind)
    aim = {"force": 0.02, "sed": 0.03, "ep1": 0.03} if kind == SMOOTH else {"force": 0.05, "sed": 0.08, "ep1": 0.08}
    assert further <= bar < 0.3 * aim[quantity]


Answers = Callable[[str, BenchmarkScene], SceneResult]


@pytest.fixture(scope="module")
def answers(finger: Fingertip) -> Answers:
    """What a model, by its name, says to a scene; solved once, however often it is asked."""

    @cache
    def model(name: str) -> Fingertip:
        return finger if name == "finger" else load(name)

    @cache
    def said(name: str, scene: BenchmarkScene) -> SceneResult:
        return answered(model(name).indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm))

    return said


def held(answers: Answers, model: str, scenes: tuple[BenchmarkScene, ...]) -> dict[str, dict[str, float]]:
    """Largest errors by quantity and family."""
    reference, worst = stored(), dict[str, dict[str, float]]()
    for scene in scenes:
        for quantity in QUANTITIES:
            of = worst.setdefault(quantity, {})
            error = reference.error(scene, quantity, answers(model, scene))
            of[scene.family] = max(of.get(scene.family, 0.0), error)
    return worst


def test_the_default_finger_is_within_the_target_errors(answers: Answers) -> None:
    worst = held(answers, "finger", SCENES)
    for family, aims in {"smooth": (0.02, 0.03, 0.03), "bar": (0.05, 0.08, 0.08), "step": (0.05, 0.08, 0.08)}.items():
        for quantity, aim in zip(("force", "sed", "ep1"), aims, strict=True):
            assert worst[quantity][family] <= aim, (family, quantity)


@pytest.mark.parametrize("shape", ["cylinder:9", "bar:3.0", "step:1"])
@pytest.mark.parametrize("quantity", ["force", "sed", "ep1"])
def test_the_stated_errors_of_the_finger_hold_in_every_reference_scene(
    answers: Answers, shape: str, quantity: str
) -> None:
    scenes = tuple(scene for scene in SCENES if scene.shape == shape)
    assert max(held(answers, "finger", scenes)[quantity].values()) <= promised(scenes[0], "finger")[quantity]


def test_the_stated_errors_of_the_half_space_hold_in_nine_of_ten_scenes(answers: Answers) -> None:
    reference = stored()
    kept = [
        reference.error(scene, quantity, answers("halfspace", scene)) <= promised(scene, "halfspace")[quantity]
        for scene in SCENES
        for quantity in ("force", "sed", "ep1")
    ]
    assert np.mean(kept) >= 0.9


def promised(scene: BenchmarkScene, model: str) -> dict[str, float]:
    """Errors of a model's default level in scenes of a kind."""
    situation = Situation.of(parse_shape(scene.shape), scene.x_mm, None, scene.doi_mm, FingertipConfig())
    return {rung.model: of for rung, of in bundled().errors(situation).items() if rung.level == "default"}[model]


def test_speed_benchmark_measures_each_candidate_in_its_own_process() -> None:
    scenes = QUICK_SCENES[:2]
    candidates = (Candidate("section", "0.28 mm", coarse(0.28)),)
    measured = list(measure(candidates, scenes))
    found = list(rows(measured, stored()))
    assert {(row["model"], row["quantity"]) for row in found} == {
        ("section", quantity) for quantity in QUANTITIES if quantity != "force"
    }
    assert all(row["total_s"] > row["contact_s"] > 0 and 50 < row["memory_mb"] < 4000 for row in found)


def test_the_nail_is_fixed_at_the_same_place_on_every_nested_mesh(skin: FingertipSurface) -> None:
    # Where rows of nodes miss the nail's edge, force moves by 1 % from mesh to mesh: docs/validation/performance.md.
    for n in (2, 3):
        mesh = build_mesh(FingertipConfig(mesh=nested(n)), skin)
        held_skin = mesh.fixed.reshape(mesh.grid)[1:, :, 0]
        rows_held, columns = held_skin.any(axis=1), held_skin.any(axis=0)
        assert mesh.z_mm[1:][rows_held].min() == pytest.approx(5.0, abs=1e-5)
        turned = np.degrees((mesh.phi[columns] + 1.5 * np.pi) % (2 * np.pi) - np.pi)
        assert (turned.min(), turned.max()) == pytest.approx((-70.0, 70.0), abs=1e-6)
