"""A sphere with friction beside Cattaneo's and Mindlin's closed form."""

import pytest

from studies.verification import mindlin


def test_a_sphere_is_cattaneos_and_mindlins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mindlin, "ACROSS", 15)  # the page has 21; errors of both are within what is asked for
    rows = list(mindlin.rows())
    assert len(rows) == len(mindlin.PARTS_OF_SLIDING)
    for row in rows:
        assert row.residual < 1e-8
        assert row.force == pytest.approx(row.closed_force, rel=0.01)
        assert row.tangential == pytest.approx(row.closed_tangential, rel=0.02)
