"""A class has a name of its own over `rig` and `sim`; pickles of 0.1 find those that were renamed."""

import ast
import pickle
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_no_two_public_classes_share_a_name() -> None:
    modules = defaultdict[str, list[str]](list)
    for package in ("rig", "sim", "rig_shared"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    modules[node.name].append(path.relative_to(ROOT).as_posix())
    assert len(modules) > 300
    assert {name: paths for name, paths in modules.items() if len(paths) > 1} == {}


@pytest.mark.parametrize(
    ("module", "old", "now", "name"),
    [
        ("sim.contact.profiles", "Step", "sim.contact.profiles", "SinusoidalStep"),
        ("sim.models.stiffening.stiffened", "Press", "sim.models.stiffening", "DimensionlessPress"),
        ("sim.models.results.indentations", "Asked", "sim.models.result", "IndentationRequest"),
        ("sim.models.results.indentations", "Answer", "sim.models.result", "IndentationOutcome"),
        ("sim.models.meeting.given", "Given", "sim.identification.predicted_forces", "MeasuredPress"),
        ("sim.models.meeting.foreseen", "Foreseen", "sim.identification.predicted_forces", "PredictedForces"),
        ("rig.plan.met.finger_file", "Met", "rig.plan.finger_file", "IdentifiedFinger"),
    ],
)
@pytest.mark.filterwarnings("ignore:.* now:DeprecationWarning")
def test_a_pickle_of_0_1_finds_a_renamed_class(module: str, old: str, now: str, name: str) -> None:
    assert pickle.loads(f"c{module}\n{old}\n.".encode()) is getattr(import_module(now), name)
