"""Another finger in a moment: weights, what is summed with them, and how far it is from a full build."""

import logging
import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

from sim.config import FingertipConfig, Tissue
from sim.contact.indentor import ALONG
from sim.errors import ModelRangeError
from sim.measures.receptors import ReceptorPlaces
from sim.models.fingertip import Fingertip
from sim.models.interpolation import (
    FORCE_ERROR,
    INTERPOLATED,
    SED_ERROR,
    FingerWithReceptors,
    forget_kept,
    make_node,
    nodes_for,
    worth_interpolating,
)
from sim.models.interpolation_weights import (
    DERMIS,
    FAT,
    StiffnessAxis,
    largest_error,
)
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

AXES = {"dermis": DERMIS, "fat": FAT}
PLACES = ReceptorPlaces((-1.0, 0.0), (0.3, 0.76, 1.6))
BELOW = {"growth": 2.0, "far_growth": 3.0, "far_spacing_mm": 3.0}
MESH = coarse_mesh(0.7, 0.7, patch_x_mm=1.4, patch_z_mm=1.4, round_patch_mm=1.0, **BELOW)


def config(e_dermis: float = 0.1, e_fat: float = 0.1, **tissue: float) -> FingertipConfig:
    return FingertipConfig(mesh=MESH, tissue=Tissue(e_dermis=e_dermis, e_fat=e_fat, **tissue))  # type: ignore[arg-type]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(1)


# --- weights ---


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
def test_interpolation_weights_are_exact_for_their_functions(axis: StiffnessAxis) -> None:
    np.testing.assert_allclose(axis.weights(axis.nodes), np.eye(4), atol=1e-12)
    values = np.geomspace(axis.low, axis.high, 33)
    for pole in (0.0, axis.middle / np.e, axis.middle * np.e):
        np.testing.assert_allclose(axis.weights(values) @ (1 / (pole + axis.nodes)), 1 / (pole + values), rtol=1e-11)
    np.testing.assert_allclose(axis.weights(values).sum(axis=-1), 1.0, rtol=1e-12)
    assert axis.weights(0.1).shape == (4,)


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
def test_the_stated_interpolation_error_bounds_any_compliance(axis: StiffnessAxis, rng: np.random.Generator) -> None:
    assert axis.error == pytest.approx(0.004583, abs=1e-6)
    assert axis.growth == pytest.approx(2.33759, abs=1e-5)
    values = np.geomspace(axis.low, axis.high, 500)
    for _ in range(50):
        poles, share = axis.middle * 10 ** rng.uniform(-3, 3, 5), rng.random(5) ** 8

        def compliance(e: object, poles: object = poles, share: object = share) -> object:
            return (share / (poles + np.asarray(e)[:, None])).sum(axis=1)  # type: ignore[operator]

        right = compliance(values)
        assert np.abs(axis.weights(values) @ compliance(axis.nodes) / right - 1).max() < axis.error  # type: ignore


def test_interpolated_compliance_stays_within_two_percent_of_a_full_build() -> None:
    """Interpolated within 1.5 % of a full build in every direction, whatever the finger."""
    assert largest_error() == pytest.approx(0.004583 * (1 + 2.33759), abs=1e-5)
    other = StiffnessAxis(0.01, 1.0)
    assert other.error > 2 * DERMIS.error


# --- fingers ---


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with the coarse finger's nodes."""
    folder = tmp_path_factory.mktemp("nodes")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_CACHE_DIR", str(folder))
        for node in nodes_for(config(), PLACES):
            assert not node.kept
            make_node(node)
            assert node.kept
    return folder


@pytest.fixture
def nodes(built: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """That cache, nothing in memory."""
    monkeypatch.setenv("RIG_CACHE_DIR", str(built))
    forget_kept()
    return built


def load(finger: FingertipConfig, *, exact: bool) -> Fingertip:
    return Fingertip.load(finger, exact=exact, **PLACES.as_options())


@pytest.mark.parametrize(("e_dermis", "e_fat"), [(0.04, 0.02), (0.64, 0.02), (0.588, 0.25)])
def test_an_interpolated_finger_is_within_its_stated_errors_of_a_full_build(
    nodes: Path, e_dermis: float, e_fat: float
) -> None:
    near, full = (load(config(e_dermis, e_fat), exact=exact) for exact in (False, True))
    ratio = eigh(near.model.patch.compliance, full.model.patch.compliance, eigvals_only=True)
    assert np.abs(ratio - 1).max() < largest_error()
    np.testing.assert_array_equal(near.model.columns.young_ratio, full.model.columns.young_ratio)
    for shape in ("cylinder:9", "bar:1.5"):
        found, right = (finger.indent(shape, doi_mm=0.15) for finger in (near, full))
        assert found.state.converged
        assert (found.model.kind, right.model.kind) == (INTERPOLATED, "finger")
        assert found.force_n == pytest.approx(right.force_n, rel=FORCE_ERROR)
        sed = right.receptor_measures["sed"]
        np.testing.assert_allclose(found.receptor_measures["sed"], sed, atol=SED_ERROR * sed.max())
        assert found.force_n != right.force_n


def test_an_interpolated_finger_at_a_node_equals_the_full_build(nodes: Path) -> None:
    finger = config(float(DERMIS.nodes[1]), float(FAT.nodes[2]))
    near, full = (load(finger, exact=exact) for exact in (False, True))
    scale = np.abs(full.model.patch.compliance).max()
    np.testing.assert_allclose(near.model.patch.compliance, full.model.patch.compliance, atol=1e-6 * scale)
    columns = full.model.columns.per_skin_force
    np.testing.assert_allclose(near.model.columns.per_skin_force, columns, atol=1e-6 * np.abs(columns).max())
    found, right = (finger.indent("cylinder:9", doi_mm=0.4).force_n for finger in (near, full))
    assert found == pytest.approx(right, rel=1e-6)


def test_results_state_whether_the_finger_was_interpolated(nodes: Path) -> None:
    near = load(config(), exact=False)
    assert near.from_cache
    assert near.model.kind == INTERPOLATED == near.indent("cylinder:9", doi_mm=0.2).as_json()["solver"]["model"]
    assert repr(near).startswith("<Fingertip interpolated finger")
    assert load(config(), exact=True).model.kind == "finger"
    again: Fingertip = pickle.loads(pickle.dumps(near))
    assert again.model.kind == INTERPOLATED


def test_a_larger_patch_of_an_interpolated_finger_is_built_in_full(nodes: Path) -> None:
    near, full = (load(config(0.2, 0.05), exact=exact) for exact in (False, True))
    wide = (2.0, 1.5)
    assert near.model_for(ALONG, wide).kind == "finger"
    np.testing.assert_array_equal(
        near.model_for(ALONG, wide).patch.compliance, full.model_for(ALONG, wide).patch.compliance
    )


@pytest.mark.parametrize(("e_dermis", "e_fat"), [(0.03, 0.1), (0.1, 0.5)])
def test_moduli_beyond_the_interpolation_range_are_refused(e_dermis: float, e_fat: float) -> None:
    known = {"dermis_low": 0.04, "dermis_high": 0.64, "fat_low": 0.02, "fat_high": 0.32}
    with raises(ModelRangeError, "not_interpolated", e_dermis=e_dermis, e_fat=e_fat, **known):
        load(config(e_dermis, e_fat), exact=False)


def test_a_missing_build_of_an_interpolated_finger_is_made_and_logged(
    nodes: Path, caplog: pytest.LogCaptureFixture
) -> None:
    node = nodes_for(config(), PLACES)[6]
    node.files[0].unlink()
    with caplog.at_level(logging.INFO, "sim.models.interpolation"):
        assert not load(config(), exact=False).from_cache
    assert [record.args for record in caplog.records] == [(7, 16)]
    assert node.kept


# --- which of many ---


def asked(*moduli: tuple[float, float], epidermis_mm: float = 0.4) -> list[FingerWithReceptors]:
    return [FingerWithReceptors(config(*one, epidermis_mm=epidermis_mm), PLACES) for one in moduli]


NINE = [(e_dermis, e_fat) for e_dermis in (0.05, 0.1, 0.2) for e_fat in (0.05, 0.1, 0.2)]


@pytest.fixture
def nothing_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))


@pytest.mark.usefixtures("nothing_kept")
@pytest.mark.parametrize(
    ("fingers", "expected"),
    [
        (asked(*NINE), [True] * 9),
        (asked(*NINE[:8]), [False] * 8),
        (asked(*NINE[:8], (0.1, 0.5)), [False] * 9),  # one beyond the range
        (asked(*NINE[:4]) + asked(*NINE[4:], epidermis_mm=0.3), [False] * 9),
    ],
)
def test_nine_or_more_fingers_of_a_family_are_interpolated(
    fingers: list[FingerWithReceptors], expected: list[bool]
) -> None:
    assert worth_interpolating(fingers) == expected
