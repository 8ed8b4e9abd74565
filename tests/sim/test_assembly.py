"""Sparse assembly against a dense loop."""

import numpy as np

from sim.fem.elements import assemble_upper, stiffness, symmetric
from sim.models.condensed import FiniteElements


def test_sparse_assembly_equals_a_dense_loop() -> None:
    # Three random symmetric "elements" on shuffled numbers: 1e-14 is the round-off of adding at most three terms.
    rng = np.random.default_rng(1)
    hexes = np.array([rng.permutation(13)[:8] for _ in range(3)])
    k = rng.normal(size=(3, 24, 24))
    k += k.swapaxes(1, 2)
    expected = np.zeros((42, 42))  # node 13 belongs to no element
    for matrix, element in zip(k, hexes, strict=True):
        for a in range(8):
            for b in range(8):
                for i in range(3):
                    for j in range(3):
                        expected[3 * element[a] + i, 3 * element[b] + j] += matrix[3 * a + i, 3 * b + j]
    upper = assemble_upper(k, hexes, 14)
    np.testing.assert_allclose(upper.toarray(), np.triu(expected), rtol=0, atol=1e-14)
    np.testing.assert_allclose(symmetric(upper).toarray(), expected, rtol=0, atol=1e-14)


def test_the_fixed_nodes_of_the_finger_are_not_unknowns(coarse_problem: FiniteElements) -> None:
    # Free unknowns only, ascending, patch unknowns are x and y of the patch's nodes.
    problem = coarse_problem
    assert not problem.mesh.fixed[problem.free // 3].any()
    assert (np.diff(problem.free) > 0).all()
    kept = problem.free[problem.kept]
    assert set(kept % 3) == {0, 1}
    np.testing.assert_array_equal(np.unique(kept // 3), np.sort(problem.mesh.patch_nodes))


def test_a_rigid_motion_needs_no_force(coarse_problem: FiniteElements) -> None:
    # Six motions of the whole, unheld finger; the sum of some 1e3 cancelling terms per row leaves ~1e-13.
    mesh = coarse_problem.mesh
    matrices = stiffness(mesh.nodes, mesh.hexes, np.ones(len(mesh.hexes)), 0.48, "bbar")
    k = symmetric(assemble_upper(matrices, mesh.hexes, len(mesh.nodes)))
    x, y, z = mesh.nodes.T
    nil, one = 0 * x, 0 * x + 1
    motions = [(one, nil, nil), (nil, one, nil), (nil, nil, one), (-y, x, nil), (nil, -z, y), (z, nil, -x)]
    for motion in motions:
        u = np.stack(motion, -1).ravel()
        assert np.abs(k @ u).max() <= 1e-12 * abs(k).max() * np.abs(u).max()
