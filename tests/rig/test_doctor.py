"""`rig doctor`: what it says of the cache."""

import json
import sys
from pathlib import Path

import pytest

from rig.cli import main


def test_models_and_answers_are_counted_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.model", "b.model", "c.answers", "a.lock"):
        (tmp_path / name).write_bytes(bytes(1_000_000))
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["rig", "doctor", "--json"])
    with pytest.raises(SystemExit) as caught:
        main()
    assert not caught.value.code
    found = json.loads(capsys.readouterr().out)["cache"]
    assert found == {"folder": str(tmp_path), "models": 2, "answers": 1, "bytes": 3_000_000}
