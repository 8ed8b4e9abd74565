"""Every container of what looks on or answers for hours, and what ends each."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[3]
LOOKS_ON = ("rig/panel", "rig/control", "rig/manual")
LOOKS_ON_TOO = (
    *("rig/cli/force_trace.py", "rig/cli/progress.py", "rig/cli/watch.py"),
    *("rig/data/run_state.py", "rig/data/run.py"),
)
CONTAINERS = {"list", "dict", "set", "deque", "Counter", "defaultdict", "OrderedDict", "Queue", "SimpleQueue",
              "ThreadPoolExecutor"}  # fmt: skip
HAS_AN_END = {
    "rig/panel/connections.py _waiting": "half of the descriptors",
    "rig/panel/connections.py _unwatched": "those accepted in a quarter of a second",
    "rig/panel/connections.py _complete": "part of those that wait",
    "rig/panel/connections.py _guests": "MOST_GUESTS",
    "rig/panel/connections.py _holders": "MOST_HOLDERS",
    "rig/panel/connections.py _begun": "until a connection is served",
    "rig/panel/connections.py _spare": "_SPARE",
    "rig/panel/connections.py _said_s": "a number for each logger and level",
    "rig/panel/connections.py _left_out": "a number for each logger and level",
    "rig/panel/requests.py _pool": "what its threads do, and nothing waits",
    "rig/panel/requests.py _each": "one for each owner and each stop that is on its way",
    "rig/panel/watcher.py _asking": "one question",
    "rig/panel/watcher.py _reading": "one look",
    "rig/panel/watcher.py _schedule": "the run's plan",
    "rig/panel/drawing.py _thread": "one drawing",
    "rig/panel/drawing.py _finger_config": "four",
    "rig/panel/drawing.py _finger": "one",
    "rig/panel/stream.py clients": "MOST_STREAMS",
    "rig/panel/stream.py _latest": "one of each kind of event",
    "rig/panel/stream.py _rows": "MOST_ROWS, and a minute",
    "rig/panel/watcher.py _status": "the last one",
    "rig/panel/owners.py _open": "the tabs that look on now",
    "rig/control/owner_socket.py _unproven": "MOST_UNPROVEN",
    "rig/control/owner_socket.py _waiting": "_SPARE",
    "rig/control/stop.py _recipients": "one for each owner, until the stop is over",
    "rig/control/stop.py problems": "of one stop, until it is over",
    "rig/control/stop.py _wires": "the stage's own, until it is let go",
    "rig/manual/status.py _recent": "APART_S",
    "rig/manual/status.py _rows": "KEPT",
    "rig/manual/orders.py _over": "a number for each tab that moved the stage",
    "rig/cli/force_trace.py _columns": "the width of the trace",
    "rig/data/run.py _last_hold": "of a run that is over",
    "rig/data/run.py done": "of a run that is over",
    "rig/data/run.py _begun": "of a run that is over",
    "rig/data/run.py _units": "of a run that is over",
    "rig/data/run.py _last": "of a run that is over",
    "rig/data/run.py _damaged": "of a run that is over",
    "rig/data/run.py _parts": "of a run that is over",
    "rig/data/run.py _events": "of a run that is over",
    "rig/data/run.py _superseded": "of a run that is over",
    "rig/data/run.py damage": "of a run that is over",
    "rig/data/run.py _blocks": "of a run that is over",
    "rig/data/run.py state": "of a run that is over",
    "rig/data/run_state.py _next_after_s": "the run's plan",
    "rig/data/run_state.py _order": "the run's plan",
    "rig/data/run_state.py _passed": "a number for each stream",
    "rig/data/run_state.py _steps": "the run's plan",
    "rig/data/run_state.py instants_s": "the run's plan",
    "rig/data/run_state.py marks": "the run's plan",
    "rig/data/run_state.py start": "one",
    "rig/data/run_state.py finished": "the run's plan",
    "rig/data/run_state.py deviations": "the run's plan",
    "rig/data/run_state.py indentation": "the last one",
    "rig/data/run_state.py holds": "those of one indentation",
    "rig/data/run_state.py newest": "the last one",
    "rig/data/run_state.py _since": "LATE, until there is a course",
}


def _empty_at_first(path: Path) -> Iterator[str]:
    """Attributes that begin as an empty container, and functions that remember."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and any("cache" in ast.unparse(one) for one in node.decorator_list):
            yield node.name
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and _made_of_its_own(node):
            yield node.target.id
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets[0] if isinstance(node, ast.Assign) else node.target
            pairs = (
                zip(targets.elts, node.value.elts, strict=True)
                if isinstance(targets, ast.Tuple) and isinstance(node.value, ast.Tuple)
                else [(targets, node.value)]
            )
            yield from (to.attr for to, value in pairs if isinstance(to, ast.Attribute) and _grows(value))


def _made_of_its_own(field: ast.AnnAssign) -> bool:
    return any(f"default_factory={name}" in ast.unparse(field) for name in CONTAINERS)


def _grows(value: ast.expr) -> bool:
    if isinstance(value, ast.Call):
        made = value.func.value if isinstance(value.func, ast.Subscript) else value.func
        return isinstance(made, ast.Name) and made.id in CONTAINERS
    if isinstance(value, ast.Dict):
        return not value.keys
    return isinstance(value, ast.List) and not value.elts


def test_whatever_could_grow_has_an_end() -> None:
    """Of what is new here it must be said what ends it, and a step of test_memory.py must do it for hours."""
    paths = [path for room in LOOKS_ON for path in (ROOT / room).rglob("*.py")] + [ROOT / one for one in LOOKS_ON_TOO]
    found = {f"{path.relative_to(ROOT).as_posix()} {name}" for path in paths for name in _empty_at_first(path)}
    assert found == set(HAS_AN_END)
