"""The demo on every bench: what is compared with what, and that a bench in the file is not played again."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rig.devices.registry import BUILT_IN
from studies.devices import demo_everywhere as demo


class Spring:
    """A finger of 8 gwt/mm with its apex at 10 mm."""

    apex_height_mm = 10.0

    def touch_height_mm(self, shape: str, x_mm: float) -> float:
        return 10.0

    def indent(self, shape: str, x_mm: float, *, doi_mm: float) -> Any:
        return SimpleNamespace(force_gwt=8.0 * doi_mm)


def _record(stage: str, *holds: list[tuple[int, float]]) -> demo.Record:
    held = [{"x_mm": 0.0, "readings": readings} for readings in holds]
    about = {"stage": stage, "force": "mtsics", "wires": "pseudo-terminal", "resumed": ["no_reply"]}
    return {**about, "holds": held, "bytes": 1000, "minutes": 6.04}


def test_readings_are_compared_at_their_own_steps() -> None:
    """A step of the stage within a hold is no error; another step at its end is counted."""
    first = _record("grbl", [(-100, 2.0)], [(-120, 2.4)])
    here = _record("zaber", [(-100, 2.0), (-101, 2.02)], [(-120, 2.404)])
    cells, error_gwt = demo.row(here, first, Spring())  # type: ignore[arg-type]
    assert error_gwt == pytest.approx(0.004)
    named = dict(zip(demo.HEADER, cells, strict=True))
    assert list(named.values()) == [
        "zaber", "mtsics", "pseudo-terminal", "2", "3", "0.0040", "1", "1", "0.0040", "1", "1000", "6.0"
    ]  # fmt: skip


def test_every_bench_is_played_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    played: list[demo.Bench] = []

    def over_wires(bench: demo.Bench) -> demo.Record:
        played.append(bench)
        return {**_record(bench[0], [(-100, 2.0)]), "force": bench[1]}

    monkeypatch.setattr(demo, "over_wires", over_wires)
    file = tmp_path / "new" / "demo.jsonl"
    demo.carry_out(demo.pairs()[3:5], file, 1)
    demo.carry_out(demo.pairs(), file, 3)
    assert sorted(played) == sorted(demo.pairs())
    assert len(played) == len(BUILT_IN["stage"]) * len(BUILT_IN["force"])
    assert [(one["stage"], one["force"]) for one in demo.records(file)] == demo.pairs()
    assert all(json.loads(line) for line in file.read_text(encoding="ascii").splitlines())
