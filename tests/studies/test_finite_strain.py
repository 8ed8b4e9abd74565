"""The nonlinear reference: bricks against closed forms, the linear twin against the model, CalculiX where it is."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.config import Contact, FingertipConfig, MeshSpec
from sim.contact.shapes import parse_shape
from sim.fem.elements import lame, stiffness
from sim.measures.measures import Elastic, measures_from_strain
from sim.models.catalogue import load
from studies.finite_strain import confirmed, states
from studies.finite_strain.judged import among
from studies.finite_strain.ratios import envelope
from studies.finite_strain.reading import extent
from studies.finite_strain.solver.bricks import Dilatation, Moduli, bricks
from studies.finite_strain.solver.clearance import along, clearance
from studies.finite_strain.solver.inside import cauchy, finite_measures
from studies.finite_strain.solver.laws import Law, NeoHookean, Yeoh
from studies.finite_strain.solver.ogden import Ogden
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.rigid import clearance as skin_clearance
from studies.finite_strain.solver.rubbing import Rubbing
from studies.finite_strain.solver.scene import Specimen
from studies.finite_strain.tables import kept_ratios

COARSE = FingertipConfig(
    contact=Contact(between_nodes=False), mesh=MeshSpec(spacing_mm=0.4, epidermis_elements=1, dermis_spacing_mm=0.4)
)
MODULI = Moduli(*lame(np.ones(8), 0.48))


def patch() -> tuple[np.ndarray, np.ndarray]:
    """Eight bricks in a cube of side 1 whose inner node is out of place."""
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    grid[13] += [0.07, -0.05, 0.04]
    number = np.arange(27).reshape(3, 3, 3)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    return grid, np.stack([number[a : a + 2, b : b + 2, c : c + 2].ravel() for a, b, c in corners], axis=1)


@pytest.mark.parametrize("law", [NeoHookean(), Yeoh(3.0, 2.0), Ogden(((0.7, -3.0), (0.3, 11.0)))])
@pytest.mark.parametrize("dilatation", ["bbar", "full"])
def test_forces_and_stiffness_are_derivatives_of_the_energy(law: Law, dilatation: Dilatation) -> None:
    rng = np.random.default_rng(1)
    nodes, elements = patch()
    one = bricks(nodes, elements[:1], Moduli(MODULI.mu[:1], MODULI.kappa[:1]), law, dilatation)
    at = elements[0]
    u = rng.normal(size=(27, 3)) * 0.05
    force, matrix = one.tangent(u)
    h, k = 1e-6, 5  # one degree of freedom stands for all
    aside = np.zeros((27, 3))
    aside[at[k // 3], k % 3] = h
    assert (one.energy(u + aside) - one.energy(u - aside)) / (2 * h) == pytest.approx(force[0, k], abs=1e-7)
    column = (one.tangent(u + aside)[0][0] - one.tangent(u - aside)[0][0]) / (2 * h)
    np.testing.assert_allclose(column, matrix[0, :, k], atol=1e-7 * np.abs(matrix).max())
    at_rest = one.tangent(np.zeros((27, 3)))[1]
    expected = stiffness(nodes, elements[:1], np.ones(1), 0.48, dilatation)
    np.testing.assert_allclose(at_rest, expected, atol=1e-12)


@pytest.mark.parametrize("dilatation", ["bbar", "full"])
def test_a_patch_in_simple_shear_carries_the_shear_of_rivlin(dilatation: Dilatation) -> None:
    """Homogeneous at finite strain: nothing is left over inside, and σ₁₂ = μγ whatever γ (Rivlin 1948)."""
    nodes, elements = patch()
    gamma = 0.6
    u = np.zeros((27, 3))
    u[:, 0] = gamma * nodes[:, 1]
    body = bricks(nodes, elements, MODULI, NeoHookean(), dilatation)
    force, _ = body.tangent(u)
    total = np.zeros((27, 3))
    np.add.at(total, elements, force.reshape(8, 8, 3))
    np.testing.assert_allclose(total[13], 0, atol=1e-14)
    top = nodes[:, 1] == 1
    assert total[top, 0].sum() == pytest.approx(MODULI.mu[0] * gamma, rel=1e-12)
    assert body.energy(u) == pytest.approx(0.5 * MODULI.mu[0] * gamma**2, rel=1e-12)


def test_stiffening_tissue_carries_more_and_turned_elements_nothing_finite() -> None:
    nodes, elements = patch()
    u = np.zeros((27, 3))
    u[:, 0] = 0.6 * nodes[:, 1]
    i = 0.36  # Ī₁ − 3 in simple shear
    yeoh = bricks(nodes, elements, MODULI, Yeoh(2.0, 1.0))
    assert yeoh.energy(u) == pytest.approx(0.5 * MODULI.mu[0] * (i + 2 * i**2 + i**3), rel=1e-12)
    assert yeoh.energy(-2 * nodes) == np.inf


@pytest.mark.parametrize("dilatation", ["bbar", "full"])
def test_ogden_of_exponent_two_is_neo_hookean(dilatation: Dilatation) -> None:
    nodes, elements = patch()
    u = np.random.default_rng(3).normal(size=(27, 3)) * 0.05
    neo, ogden = (bricks(nodes, elements, MODULI, law, dilatation) for law in (NeoHookean(), Ogden.of(2.0)))
    assert ogden.energy(u) == pytest.approx(neo.energy(u), rel=1e-12)
    for of_ogden, of_neo in zip(ogden.tangent(u), neo.tangent(u), strict=True):
        np.testing.assert_allclose(of_ogden, of_neo, atol=1e-14 * np.abs(of_neo).max() * len(nodes))
    f = np.eye(3) + 0.2 * np.random.default_rng(4).normal(size=(5, 3, 3))
    moduli = Moduli(np.full(5, 2.0), np.full(5, 50.0))
    expected = finite_measures(f, moduli, NeoHookean())
    for name, values in finite_measures(f, moduli, Ogden.of(2.0)).items():
        np.testing.assert_allclose(values, expected[name], rtol=1e-9, atol=1e-10, err_msg=name)


@pytest.mark.parametrize("alpha", [9.78, -4.0])
@pytest.mark.parametrize("stretch", [0.7, 1.0, 1.3])
def test_ogden_tissue_in_plain_and_in_equal_tension_bears_the_closed_form(alpha: float, stretch: float) -> None:
    """σ = 2μ/α (λ^α − λ^{−α/2}) and 2μ/α (λ^α − λ^{−2α}) (Ogden 1972), two stretches being equal, or three."""
    mu, one = 1.7, np.ones(1)
    for across, other in ((stretch**-0.5, stretch**-0.5), (stretch, stretch**-2)):
        f = np.diag([stretch, across, other])[None]
        stress = cauchy(f, Moduli(mu * one, 50 * one), Ogden.of(alpha))[0]
        for k, here in enumerate((stretch, across)):
            expected = 2 * mu / alpha * (here**alpha - other**alpha)
            assert stress[k, k] - stress[2, 2] == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_stiffness_of_ogden_tissue_is_the_derivative_of_its_forces_where_two_stretches_are_equal() -> None:
    nodes, elements = patch()
    one = bricks(nodes, elements, MODULI, Ogden.of(9.78))
    u, way = nodes * np.array([0.2, 0.2, -0.3]), np.random.default_rng(5).normal(size=(27, 3))
    matrix = one.tangent(u)[1]
    column = (one.tangent(u + 1e-6 * way)[0] - one.tangent(u - 1e-6 * way)[0]) / 2e-6
    expected = np.einsum("nij,nj->ni", matrix, way[elements].reshape(len(elements), -1))
    np.testing.assert_allclose(column, expected, atol=1e-7 * np.abs(expected).max())


def test_terms_of_ogden_share_the_shear_modulus() -> None:
    for terms in (((0.5, 3.0), (0.4, -2.0)), ((1.0, 0.0),)):
        with pytest.raises(ValueError, match="shares of the shear modulus"):
            Ogden(terms)


def test_measures_in_simple_shear_and_after_a_turn() -> None:
    gamma, mu, kappa = 0.5, 2.0, 50.0
    f = np.eye(3)
    f[0, 1] = gamma
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    found = finite_measures(np.stack([f, turn @ f]), Moduli(np.full(2, mu), np.full(2, kappa)), NeoHookean())
    for values in found.values():
        assert values[0] == pytest.approx(values[1], abs=1e-12)  # in the material's axes
    stretch = 0.5 * (gamma + np.sqrt(gamma**2 + 4))
    assert found["ep3"][0] == pytest.approx(stretch - 1)
    assert found["ep1"][0] == pytest.approx(1 / stretch - 1)
    assert found["sed"][0] == pytest.approx(0.5 * mu * gamma**2)
    assert found["mean"][0] == pytest.approx(0.0, abs=1e-12)
    assert found["sp3"][0] - found["sp1"][0] == pytest.approx(mu * (stretch**2 - stretch**-2))


def test_measures_at_small_strain_are_the_linear_ones() -> None:
    strain = 1e-6 * np.array([1.0, -2, 0.5, 0.3, -0.4, 0.7])
    f = np.eye(3)
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]):
        f[i, j] += strain[k]
    mu, kappa = lame(np.full(1, 3.0), 0.48)
    found = finite_measures(f[None], Moduli(mu, kappa), NeoHookean())
    for name, value in measures_from_strain(strain, Elastic(3.0, 0.48)).items():
        assert found[name][0] == pytest.approx(float(value), rel=2e-5), name


@pytest.fixture(scope="module")
def section() -> Specimen:
    return Specimen(COARSE, "section")


def test_the_linear_twin_is_the_model(section: Specimen) -> None:
    """The penalty lets nodes 1e-5 of the depth in: 1e-4 of the force."""
    finger = load("section", COARSE, cached=False)
    body = section.body(None)
    for shape in ("cylinder:9", "bar:3.0"):
        (found,) = presses(body, section.skin, section.touch(shape), [0.3])
        expected = finger.indent(shape, 0.0, doi_mm=0.3).force_n / finger.e_epidermis_mpa
        assert found.force == pytest.approx(expected, rel=1e-4)


def test_finite_strain_begins_as_small_strain_and_leaves_it(section: Specimen) -> None:
    linear, finite = (
        list(presses(section.body(law), section.skin, section.touch("cylinder:9"), [0.01, 0.6]))
        for law in (None, NeoHookean())
    )
    assert finite[0].force == pytest.approx(linear[0].force, rel=2e-3)
    assert linear[1].force / finite[1].force < 0.95


def test_friction_holds_no_more_than_its_coefficient_and_none_is_the_model() -> None:
    finger = load("section", COARSE, cached=False)
    touch = finger.touch_height_mm("cylinder:9", 0.5)
    indentor = parse_shape("cylinder:9")
    *_, free = Rubbing(finger.model.patch, indentor, 0.5, touch, 0.0).presses(0.4)
    expected = finger.indent("cylinder:9", 0.5, doi_mm=0.4).force_n / finger.e_epidermis_mpa
    assert free.normal_force == pytest.approx(expected, rel=1e-4)
    *_, held = Rubbing(finger.model.patch, indentor, 0.5, touch, 0.3).presses(0.4)
    bears = held.force[1] < 0
    slope = indentor.evaluate((finger.model.patch.x - 0.5)[None]).slope[0]
    angle = np.abs(np.arctan2(held.force[0], -held.force[1]) - np.arctan(slope))[bears]
    assert angle.max() < np.arctan(0.3) + 0.05  # the slope is taken where the node was
    assert held.normal_force > free.normal_force


def test_distance_from_a_bar_and_place_along_it() -> None:
    """Face, edge and wall of a 3 mm bar whose edges have a radius of 0.05 mm, on either side."""
    bar, r = parse_shape("bar:3.0"), 0.05
    s = np.array([1.0, 1.45 + 0.04, 1.5 + 0.02, 1.44, 1.45 + 0.01])
    above = np.array([-0.02, r - 0.03, 0.3, 0.2, 0.3])
    found = clearance(bar, s[None], above)
    np.testing.assert_allclose(found.mm, [0.02, 0.0, 0.02, -0.2, -0.04], atol=1e-12)
    np.testing.assert_allclose(found.gradient[:, 0], [0, 0.8, 1, 0, 1], atol=1e-12)
    np.testing.assert_allclose(found.gradient[:, 1], [-1, -0.6, 0, -1, 0], atol=1e-12)
    place, _ = along(bar, s, above)
    quarter = r * np.pi / 2
    arc = r * np.arctan2(0.04, 0.03)
    np.testing.assert_allclose(place, [1.0, 1.45 + arc, 1.45 + quarter + 0.25, 1.44, 1.45 + quarter + 0.25])
    mirrored = clearance(bar, -s[None], above)
    np.testing.assert_allclose(mirrored.mm, found.mm)
    np.testing.assert_allclose(mirrored.gradient, found.gradient * [-1, 1, 1])
    np.testing.assert_allclose(along(bar, -s, above)[0], -place)


def test_slopes_of_clearance_and_place_are_their_derivatives() -> None:
    rng = np.random.default_rng(2)
    s, above, h = rng.uniform(-1.6, 1.6, 300), rng.uniform(-0.04, 0.04, 300), 1e-7
    s[:200] = np.sign(s[:200]) * (1.45 + 0.06 * rng.random(200))
    for shape in ("bar:3.0", "cylinder:9"):
        indentor = parse_shape(shape)
        found, (_, growth) = clearance(indentor, s[None], above), along(indentor, s, above)
        for axis, (dx, dy) in enumerate(((h, 0.0), (0.0, h))):
            before, after = (clearance(indentor, s[None] + n * dx, above + n * dy) for n in (-1, 1))
            np.testing.assert_allclose((after.mm - before.mm) / (2 * h), found.gradient[:, axis], atol=1e-6)
            turned = (after.gradient - before.gradient) / (2 * h)
            np.testing.assert_allclose(turned, found.hessian[:, axis], atol=1e-5)
            low, high = (along(indentor, s + n * dx, above + n * dy)[0] for n in (-1, 1))
            np.testing.assert_allclose((high - low) / (2 * h), growth[axis], atol=1e-6)


def test_a_gap_from_what_is_no_bar_is_vertical_and_so_is_that_of_a_bar_across() -> None:
    for shape in ("cylinder:9", "bar:3.0,across"):
        indentor = parse_shape(shape)
        offset, above = np.array([[0.3, 1.48]]), np.array([0.01, -0.02])
        found = clearance(indentor, offset, above)
        there = indentor.evaluate(offset)
        np.testing.assert_array_equal(found.mm, there.height_mm - above)
        np.testing.assert_array_equal(found.gradient[:, indentor.axes[0]], there.slope[0])
        np.testing.assert_array_equal(found.gradient[:, 1], -1)
        np.testing.assert_array_equal(found.hessian[:, indentor.axes[0], indentor.axes[0]], there.curvature[0, 0])


def test_skin_slides_round_the_edges_of_a_bar(section: Specimen) -> None:
    """Deep enough for nodes to leave the face: the press goes on, they lie beside its walls, and none is inside."""
    touch = section.touch("bar:1.5", 0.2)
    (found,) = presses(section.body(NeoHookean()), section.skin, touch, [0.8])
    np.testing.assert_allclose(found.touched.normal[:, 0], [1, 0, 0, 0, -1], atol=1e-9)  # on both walls
    there = replace(touch, height_mm=touch.height_mm - 0.8)
    assert skin_clearance(section.skin, there, found.unknowns).mm.min() > -1e-3
    across = found.touched.load_n[:, None] * found.touched.normal
    assert found.force == pytest.approx(-across[:, 1].sum())


def test_a_world_is_compared_at_the_places_where_both_were_pressed() -> None:
    x = np.arange(5.0)
    base = {("step:1", "8 gwt"): (x, np.arange(10.0).reshape(2, 1, 5)), ("bar:3.0", "1 mm"): (x, np.zeros((2, 1, 5)))}
    kept = among(base, {("step:1", "8 gwt"): (x[::2], np.zeros((2, 1, 3)))})
    assert list(kept) == [("step:1", "8 gwt")]
    np.testing.assert_array_equal(kept["step:1", "8 gwt"][0], [0, 2, 4])
    np.testing.assert_array_equal(kept["step:1", "8 gwt"][1][1, 0], [5, 7, 9])


def test_ep1_and_sed_survive_in_every_world_that_is_kept() -> None:
    kept = json.loads((Path(states.__file__).parent / "kept" / "verdicts.json").read_text("utf-8"))
    assert {"section, friction 0.3", "finger, nu 0.499", "finger, friction 0.3"} <= {row["world"] for row in kept}
    assert all({"ep1", "sed"} <= set(row["candidates"]) for row in kept)
    assert max(one["rank"] for row in kept for one in row["ranks"]) <= 2


def test_friction_on_a_bar_and_round_its_edge() -> None:
    """Without friction the model's force; with it every force within the cone about the normal at its place."""
    finger, bar = load("section", COARSE, cached=False), parse_shape("bar:1.5")
    touch = finger.touch_height_mm("bar:1.5", 0.35)
    *_, free = Rubbing(finger.model.patch, bar, 0.35, touch, 0.0).presses(1.0)
    expected = finger.indent("bar:1.5", 0.35, doi_mm=1.0).force_n / finger.e_epidermis_mpa
    assert free.normal_force == pytest.approx(expected, rel=1e-4)
    touch = finger.touch_height_mm("bar:1.5", 0.3)
    *_, held = Rubbing(finger.model.patch, bar, 0.3, touch, 0.3).presses(1.0)
    bears = ~np.isnan(held.anchor_mm)
    place = held.anchor_mm[bears]
    turned = np.sign(place) * np.maximum(np.abs(place) - 0.7, 0.0) / 0.05
    assert 0.1 < turned.max() < 0.5  # one has slid on to the edge
    angle = np.arctan2(held.force[0], -held.force[1])[bears] - turned
    assert np.abs(angle).max() == pytest.approx(np.arctan(0.3), abs=0.01)


def test_where_a_gap_opens() -> None:
    x = np.arange(-2.0, 2.01, 0.25)
    gap = np.where(np.abs(x) <= 0.8, -1e-5, np.abs(np.abs(x) - 0.8) ** 1.5)
    assert extent(x, gap, opens=True) == pytest.approx(1.6)
    assert extent(x, gap, opens=False) == pytest.approx(1.5)
    assert extent(x, gap + 1, opens=True) == 0.0


def test_the_note_is_of_the_ratios_that_are_kept() -> None:
    curves = json.loads((Path(states.__file__).parents[2] / "sim/data/small_strain.json").read_text("utf-8"))[
        "curves"
    ]
    from studies.finite_strain.tables import SAID

    for kind, (mesh, fewest) in SAID.items():
        kept = envelope(kept_ratios(), mesh, fewest)
        assert [row["doi_mm"] for row in kept] == [row["doi_mm"] for row in curves[kind]]
        for ours, said in zip(kept, curves[kind], strict=True):
            assert (ours["force"], ours["sed"]) == (said["force"], said["sed"])


def test_every_shape_was_compared_to_a_millimetre_and_calculix_says_the_same() -> None:
    reached = {(one.mesh, one.shape) for one in kept_ratios() if one.doi_mm >= 1.0}
    assert {("finger 0.35", shape) for shape in states.SHAPES} <= reached
    kept = states.read(Path(states.__file__).parent / "kept" / "calculix.jsonl")
    assert ("finger 0.35", "bar:3.0", 1.0) in {(row["mesh"], row["shape"], row["doi_mm"]) for row in kept}
    assert max(row["off"] for row in kept if row["what"] == "equilibrium") < 1e-4
    contacts = [row["theirs"] / row["ours"] - 1 for row in kept if row["what"] == "contact"]
    assert len(contacts) == len(confirmed.CONTACTS)
    assert np.abs(contacts).max() < 1e-3


def test_what_calculix_prints_is_read() -> None:
    printed = " displacements\n\n 1 1.0 2.0 3.0\n 2 0.0 0.0 0.0\n\n 1 4.0 5.0 6.0\n 2 7.0 8.0 9.0\n"
    np.testing.assert_array_equal(confirmed.displacements(printed, 2), [[4, 5, 6], [7, 8, 9]])
    total = " total force (fx,fy,fz) for set NIND and time  0.1E+01\n\n        1.0 -2.5E+00  0.0\n"
    np.testing.assert_array_equal(confirmed.last_total("x\n" + total), [1.0, -2.5, 0.0])


def test_without_calculix_one_line_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    confirmed.main("unused")
    assert capsys.readouterr().out == f"{confirmed.MISSING}\n"


@pytest.mark.skipif(shutil.which("ccx") is None, reason="no ccx (Debian package calculix-ccx)")
@pytest.mark.xdist_group("calculix")
def test_calculix_has_the_same_equilibrium_at_finite_strain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its displacements under our contact forces are ours to the seven digits that it prints."""
    coarse = {"spacing_mm": 0.4, "epidermis_elements": 1, "dermis_spacing_mm": 0.4, "element": "full"}
    monkeypatch.setitem(states.MESHES, "section coarse full", coarse)
    found = confirmed.equilibrium(states.PressedShape("section coarse full", "cylinder:9"), 0.8)
    assert found["off"] < 5e-6
