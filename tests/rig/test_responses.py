"""What the model says of the holds of a run."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig.plan.finger_model import by_group, measured, responses
from sim.contact.indentor import Indentor


def _start(index: int, indentor: str, increments: int) -> dict[str, Any]:
    return {"index": index, "indentor": indentor, "increments": increments}


def _hold(index: int, hold: int, x_mm: float, **more: Any) -> dict[str, Any]:
    return {"index": index, "hold": hold, "x_mm": x_mm, "force_gwt": 2.5 * hold, **more}


def _run(*, virtual: bool) -> Any:
    """Step 1 at 0.5 in two holds, a bar at −1, and step 1 at −0.5, which was not finished."""
    holds = [_hold(0, 1, 0.5), _hold(0, 2, 0.5), _hold(1, 1, -1.0), _hold(2, 1, -0.5)]
    truth = {"true_x_mm": 0.25, "true_doi_mm": 0.0}
    asked = [("force_gwt", 2.33), ("force_gwt", 4.66), ("doi_mm", 0.7), ("force_gwt", 2.33)]
    streams = {
        "indentation_start": [_start(0, "step:1", 2), _start(1, "bar:3.0", 1), _start(2, "step:1", 2)],
        "touch": [{"index": k, "doi_bias_mm": k / 100} for k in range(3)],
        "hold_start": [
            {"index": h["index"], "hold": h["hold"], "target": kind, "commanded": value}
            for h, (kind, value) in zip(holds, asked, strict=True)
        ],
        "hold_end": [{**hold, **(truth if virtual else {"true_doi_mm": None})} for hold in holds],
    }
    nowhere = SimpleNamespace(path=Path("of-no-run"))
    return SimpleNamespace(stream=lambda name: streams[name], done={0, 1}, folder=nowhere)


@pytest.fixture
def asked() -> list[Any]:
    return []


@pytest.fixture
def model(asked: list[Any]) -> Any:
    """A finger that keeps what it is asked, and answers with a measure at three receptors."""

    def indent(indentor: Indentor, x_mm: float, **how: float) -> Any:
        asked.append((indentor.name, x_mm, how))
        return SimpleNamespace(receptor_measures={"ep1": np.arange(3.0) + len(asked)})

    return SimpleNamespace(indent=indent)


def test_the_model_predicts_a_virtual_run_at_its_true_place_and_depth(model: Any, asked: list[Any]) -> None:
    found = responses(_run(virtual=True), model)
    assert asked == [(name, 0.25, {"doi_mm": 0.0}) for name in ("step:1", "step:1", "bar:3")]
    assert [(one.index, one.indentor, one.kind, one.commanded, one.last) for one in found] == [
        (0, "step:1", "force_gwt", 2.33, False),
        (0, "step:1", "force_gwt", 4.66, True),
        (1, "bar:3.0", "doi_mm", 0.7, True),
    ]
    assert [one.touch["doi_bias_mm"] for one in found] == [0.0, 0.0, 0.01]
    assert [one.hold["hold"] for one in found] == [1, 2, 1]


def test_the_model_predicts_a_real_run_at_its_recorded_force(model: Any, asked: list[Any]) -> None:
    responses(_run(virtual=False), model)
    assert asked == [
        ("step:1", 0.5, {"force_gwt": 2.5}),
        ("step:1", 0.5, {"force_gwt": 5.0}),
        ("bar:3", -1.0, {"force_gwt": 2.5}),
    ]


def test_responses_of_the_last_holds_only_skip_earlier_holds(model: Any) -> None:
    found = responses(_run(virtual=True), model, last_only=True)
    assert [(one.index, one.hold["hold"]) for one in found] == [(0, 2), (1, 1)]


def test_presses_that_differ_in_position_only_form_one_group_ordered_by_x(model: Any) -> None:
    run = _run(virtual=False)
    run.done = {0, 1, 2}
    found = responses(run, model)
    groups = by_group(found)
    assert {name: [one.hold["x_mm"] for one in members] for name, members in groups.items()} == {
        "bar:3.0 at 0.7 mm": [-1.0],
        "step:1 at 2.33 gwt": [-0.5, 0.5],
        "step:1 at 4.66 gwt": [0.5],
    }
    x, values = measured(groups["step:1 at 2.33 gwt"], "ep1")
    assert x.tolist() == [-0.5, 0.5]
    assert values.tolist() == [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]
