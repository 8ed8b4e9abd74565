"""`rig doctor`: what it says of the cache."""

import json
import sys
from pathlib import Path

import pytest

from rig.cli import main


def test_what_does_not_answer_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """So is an expired calibration, with which `rig run` refuses to begin."""
    expired = "value = 400, date = 2020-03-01, expires = 2021-03-01"
    ports = {name: f'[{name}]\nport = "{tmp_path / name}"\n' for name in ("stage", "force")}
    text = "".join(ports.values()) + f"[calibration]\nz_steps_per_mm = {{{expired}}}\n"
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["rig", "doctor", "--config", str(tmp_path / "rig.toml"), "--json"])
    with pytest.raises(SystemExit):
        main()
    found = json.loads(capsys.readouterr().out)
    assert [problem.partition(" ")[0] for problem in found["problems_text"]] == [
        "calibration.z_steps_per_mm",
        "stage:",
        "force:",
    ]
