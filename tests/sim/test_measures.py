"""The eighteen measures at states known by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sim.measures.measures import BY_NAME, MEASURES, Elastic, measures_from_strain, stress_from_strain

SKIN = Elastic(young=10_000.0, poisson=0.48)
G = 10_000.0 / (2 * 1.48)


def at(*strain: float, material: Elastic = SKIN) -> dict[str, float]:
    return {name: float(value) for name, value in measures_from_strain(np.array(strain), material).items()}


def test_the_measures_have_fixed_names_order_and_units() -> None:
    # Raju (1998, ch. 5): the 18 candidates.
    assert " ".join(MEASURES) == "e11 e22 e33 e12 e23 e13 ep1 ep2 ep3 s11 s22 s33 sp1 sp2 sp3 mean sed third"
    magnitudes = [name for name, measure in BY_NAME.items() if measure.as_magnitude]
    assert " ".join(magnitudes) == "e22 ep1 s11 s22 s33 sp1 sp2 sp3 mean third"
    assert (BY_NAME["ep1"].unit, BY_NAME["sed"].unit, BY_NAME["third"].unit) == ("1", "pseudo-unit", "pseudo-unit³")
    assert tuple(at(0, 0, 0, 0, 0, 0)) == MEASURES


def test_the_measures_of_uniaxial_compression_are_those_by_hand() -> None:
    # σ22 = −100 alone: ε22 = −100 / E, ε11 = ε33 = +ν 100 / E.
    e = 100 / SKIN.young
    m = at(0.48 * e, -e, 0.48 * e, 0, 0, 0)
    for name, value in {
        "s11": 0.0,
        "s22": -100.0,
        "s33": 0.0,
        "sp1": -100.0,
        "sp2": 0.0,
        "sp3": 0.0,
        "mean": -100 / 3,
        "third": 0.0,
    }.items():
        assert m[name] == pytest.approx(value, abs=1e-8), name  # λ = 24 μ: cancelling sums of ~ 1e3
    for name, value in {"ep1": -e, "ep2": 0.48 * e, "ep3": 0.48 * e, "e22": -e}.items():
        assert m[name] == pytest.approx(value, rel=1e-12), name
    assert m["sed"] == pytest.approx(0.5 * 100 * e, rel=1e-12)


@pytest.mark.parametrize("component", [3, 4, 5])
def test_the_measures_of_pure_shear_are_those_by_hand(component: int) -> None:
    # Raju (1998): e12 = s12 / G, so γ = 0.02 is a tensor component of 0.01 and principals ± 0.01.
    strain = np.zeros(6)
    strain[component] = 0.02
    m = at(*strain)
    np.testing.assert_allclose([m["ep1"], m["ep2"], m["ep3"]], [-0.01, 0, 0.01], rtol=0, atol=1e-17)
    np.testing.assert_allclose([m["sp1"], m["sp2"], m["sp3"]], [-0.02 * G, 0, 0.02 * G], rtol=1e-14, atol=1e-12)
    assert stress_from_strain(strain, SKIN)[component] == pytest.approx(G * 0.02, rel=1e-15)
    assert m["sed"] == pytest.approx(0.5 * G * 0.02**2, rel=1e-14)
    assert m["mean"] == pytest.approx(0.0, abs=1e-15)
    assert m["third"] == pytest.approx(0.0, abs=1e-9)


def test_the_measures_of_hydrostatic_pressure_are_those_by_hand() -> None:
    # κ = E / 3(1 − 2ν): equal strains −e give σ = −3κe on every plane.
    kappa, e = 10_000 / (3 * 0.04), 1e-4
    m = at(-e, -e, -e, 0, 0, 0)
    for name in ("s11", "s22", "s33", "sp1", "sp2", "sp3", "mean"):
        assert m[name] == pytest.approx(-3 * kappa * e, rel=1e-12), name
    assert m["sed"] == pytest.approx(0.5 * kappa * (3 * e) ** 2, rel=1e-12)
    assert m["third"] == pytest.approx(-((3 * kappa * e) ** 3), rel=1e-12)
    assert [m["ep1"], m["ep2"], m["ep3"]] == pytest.approx([-e, -e, -e])


strains = arrays(float, (4, 6), elements=st.floats(-0.5, 0.5).map(lambda e: 0.0 if abs(e) < 1e-100 else e))
"""Strains; LAPACK's eigenvalues lose half their digits where squares of elements underflow, far below any strain."""


@settings(max_examples=100, deadline=None)
@given(strains)
def test_the_measures_of_any_strain_satisfy_their_identities(strain: np.ndarray) -> None:
    m = measures_from_strain(strain, SKIN)
    stress = stress_from_strain(strain, SKIN)
    assert (m["ep1"] <= m["ep2"]).all()
    assert (m["ep2"] <= m["ep3"]).all()
    assert (m["sp1"] <= m["sp2"]).all()
    assert (m["sp2"] <= m["sp3"]).all()
    size = 1e-12 * max(np.abs(stress).max(), 1e-300)
    np.testing.assert_allclose(m["ep1"] + m["ep2"] + m["ep3"], strain[:, :3].sum(axis=1), rtol=0, atol=1e-14)
    np.testing.assert_allclose(3 * m["mean"], m["sp1"] + m["sp2"] + m["sp3"], rtol=0, atol=10 * size)
    # σ and ε of an isotropic solid share their axes: σp = 2μ εp + λ tr ε
    lam = 2 * G * 0.48 / 0.04
    for p in "123":
        expected = 2 * G * m[f"ep{p}"] + lam * strain[:, :3].sum(axis=1)
        np.testing.assert_allclose(m[f"sp{p}"], expected, rtol=0, atol=10 * size)
    # ½ σ:ε with each shear twice in the tensors, once in engineering components; determinant by cofactors
    s = np.moveaxis(stress, -1, 0)
    energy = 0.5 * (s[0] * strain[:, 0] + s[1] * strain[:, 1] + s[2] * strain[:, 2])
    energy += 0.5 * (s[3] * strain[:, 3] + s[4] * strain[:, 4] + s[5] * strain[:, 5])
    np.testing.assert_allclose(m["sed"], energy, rtol=1e-12, atol=size)
    assert (m["sed"] >= -size).all()
    det = s[0] * (s[1] * s[2] - s[4] ** 2) - s[3] * (s[3] * s[2] - s[4] * s[5]) + s[5] * (s[3] * s[4] - s[1] * s[5])
    np.testing.assert_allclose(m["third"], det, rtol=0, atol=1e-10 * max(np.abs(stress).max(), 1e-100) ** 3)


def test_stress_measures_scale_with_stiffness_and_strain_measures_do_not() -> None:
    strain = np.array([0.01, -0.03, 0.02, 0.004, -0.01, 0.02])
    soft, hard = (measures_from_strain(strain, Elastic(e, 0.48)) for e in (1_000.0, 10_000.0))
    for name in MEASURES:
        power = 3 if name == "third" else 1 if name[0] in "sm" else 0
        assert hard[name] == pytest.approx(10.0**power * soft[name], rel=1e-9, abs=1e-12), name
