"""Ridge and crest of the skin are found once, then come from the cache."""

from pathlib import Path

import numpy as np
import pytest

from sim.config import Geometry
from sim.finger.surface import FingertipSurface
from sim.models.cache import keep_tops


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def not_found_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: FingertipSurface) -> None:
        raise AssertionError("looked for anew")

    monkeypatch.setattr(FingertipSurface, "_pulp", property(refuse))


@pytest.mark.parametrize("name", ["ridge", "crest"])
def test_from_the_cache_they_are_the_same_to_the_last_bit(
    empty_cache: Path, request: pytest.FixtureRequest, name: str
) -> None:
    found = getattr(FingertipSurface.fit(Geometry()), name)
    keep_tops(FingertipSurface.fit(Geometry()))
    assert len(list(empty_cache.glob("*.skin"))) == 1
    request.getfixturevalue("not_found_anew")
    surface = FingertipSurface.fit(Geometry())
    keep_tops(surface)
    kept = getattr(surface, name)
    at = np.linspace(found.x[0] - 0.1, found.x[-1] + 0.1, 1001)
    assert np.array_equal(kept(at), found(at), equal_nan=True)
    assert np.isnan(kept(at[0]))  # beyond its ends there is no skin
    assert np.array_equal(kept.derivative()(at[10:-10]), found.derivative()(at[10:-10]), equal_nan=True)
