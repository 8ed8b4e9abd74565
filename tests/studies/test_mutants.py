"""The mutation tool makes the slips that a review found, and says what became of them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from studies.mutants import __main__ as runner
from studies.mutants.report import page, score
from studies.mutants.source import Mutant, mutants_of, plain
from studies.mutants.tests_of import LineTests

Mutants = Callable[[str], list[Mutant]]


@pytest.fixture
def mutants(tmp_path: Path) -> Mutants:
    """The mutants of a module of these lines."""

    def make(text: str) -> list[Mutant]:
        (tmp_path / "module.py").write_text(text, encoding="utf-8")
        return mutants_of(tmp_path, "module.py")

    return make


@pytest.mark.parametrize(
    ("line", "slip"),
    [
        ("if speed > limits.fastest: stop()", "if speed > limits.fastest * 10:"),
        ("if force > trip: stop()", "if force >= trip:"),
        ("if force > trip: stop()", "if force <= trip:"),
        ("if force > trip: stop()", "pass"),
        ("height = min(lift, highest)", "height = lift"),
        ("force = abs(reading)", "force = reading"),
        ("needed = depth + search_mm", "needed = depth"),
        ("needed = search_mm + depth", "needed = depth"),
        ("pressure = mpa * 100", "pressure = mpa * 1000"),
        ("pressure = mpa * 100.0", "pressure = mpa * 1000.0"),
        ("self.trusted = False", "pass"),
        ("self.trusted = False", "self.trusted = True"),
        ("if echo.address != address or echo.count != count: refuse()", "if echo.address != address:"),
        ("if echo.address != address: raise Refused(echo)", "pass"),
        ("RECOVERY = 0.5", "RECOVERY = 0.3"),
        ("spread = np.std(forces, ddof=1)", "spread = np.std(forces)"),
        ("spread = np.std(forces, ddof=1)", "spread = np.std(forces, ddof=2)"),
        ("near = close & same_layer", "near = close"),
        ("if not homed: refuse()", "if homed:"),
        ("if homed: go()", "if not homed:"),
        ("def touch(search_mm=3.0): pass", "def touch(search_mm=30.0):"),
        ("def trip(): return force", "return None"),
        ("for x in xs: break", "pass"),
    ],
)
def test_the_mutation_tool_makes_each_listed_change(mutants: Mutants, line: str, slip: str) -> None:
    assert slip in [m.after for m in mutants(line)]


def test_the_mutation_tool_changes_no_texts_types_or_messages(mutants: Mutants) -> None:
    assert not mutants('"""Of 3 words."""\nfrom a import b\nx: list[int] | None\nname = f"{1 + 2}"\n')
    assert [m.after for m in mutants("raise Refused(1 + 2)")] == ["pass"]


def test_the_mutation_tool_omits_changes_that_no_test_can_detect(mutants: Mutants) -> None:
    # Whether lengths that are equal must be, and the boundary between quantities.
    assert not mutants("pairs = zip(a, b, strict=True)")
    assert not mutants("x_mm = Field(default, description='of the pad')")
    assert [m.after for m in mutants("near = height_mm < 3")] == ["near = height_mm >= 3", "near = height_mm < 4"]
    assert "near = count <= n" in [m.after for m in mutants("near = count < n")]


def test_every_mutant_differs_and_the_unchanged_module_stays_the_same(mutants: Mutants, tmp_path: Path) -> None:
    found = mutants("def f(a, b=2):\n    # a comment\n    return (a + b) * 2 if a < b else -a\n")
    assert len({m.source for m in found}) == len(found) > 8
    assert plain(tmp_path, "module.py") == "def f(a, b=2):\n    return (a + b) * 2 if a < b else -a"


def test_the_key_of_a_mutant_survives_shifted_lines(mutants: Mutants) -> None:
    text = "class A:\n    def f(self):\n        if self.x < 1: return 2\n        if self.x < 1: return 2\n"
    keys = [m.key for m in mutants(text)]
    assert len(set(keys)) == len(keys)
    assert keys == [m.key for m in mutants("# above\n\nLIMIT = 'mm'\n" + text)]
    assert "module.py::A.f | if self.x < 1: → if self.x <= 1: #2" in keys


def test_the_mutation_tool_tries_likely_and_quick_tests_first(mutants: Mutants, tmp_path: Path) -> None:
    mutant = next(m for m in mutants("LIMIT = 3\ndef f(a):\n    return a < LIMIT\n") if m.lines == (3,))
    lines = {"slow": [3], "quick": [3], "long": [3], "elsewhere": [2]}
    seconds = {"slow": 1.0, "quick": 0.1, "long": 9.0, "elsewhere": 0.1}
    tests = LineTests(
        tmp_path, {t: {"seconds": seconds[t], "shared": {}, "lines": {"module.py": lines[t]}} for t in lines}
    )
    assert tests.likely(mutant, 5.0) == (["quick", "slow"], pytest.approx(1.1), False)
    assert tests.likely(mutant, 50.0) == (["quick", "slow", "long"], pytest.approx(10.1), True)
    for _ in range(4):
        tests.noticed(mutant, "slow")
    assert tests.likely(mutant, 5.0)[0] == ["slow", "quick"]
    constant = next(m for m in mutants("LIMIT = 3\ndef f(a):\n    return a < LIMIT\n") if m.lines == (1,))
    assert constant.at_import == "LIMIT"
    assert tests.likely(constant, 50.0) == (["quick", "slow", "elsewhere", "long"], pytest.approx(10.2), True)


def test_the_mutation_tool_counts_the_time_of_a_shared_fixture_once(mutants: Mutants, tmp_path: Path) -> None:
    mutant = next(m for m in mutants("def f(a):\n    return a < 1\n"))
    entry = {"seconds": 0.1, "shared": {"finger": 3.0}, "lines": {"module.py": [2]}}
    tests = LineTests(tmp_path, {"a": entry, "b": entry, "c": {**entry, "shared": {"run": 3.0}}})
    assert tests.likely(mutant, 5.0) == (["a", "b"], pytest.approx(3.2), False)
    assert tests.likely(mutant, 7.0) == (["a", "b", "c"], pytest.approx(6.3), True)


def test_the_mutation_score_omits_equivalents_and_the_page_lists_every_survivor() -> None:
    def result(key: str, outcome: str) -> dict[str, object]:
        place = {"path": "a.py", "line": 1, "before": f"{key} | 1", "after": "2"}
        return {"key": key, "group": "first", "outcome": outcome, **place}

    results = [result("a", "killed"), result("b", "timeout"), result("c", "survived"), result("d", "survived")]
    assert score(results, {"d": "the same"})["score"] == pytest.approx(2 / 3)
    text = page(results, {"d": "the same", "gone": "was there once"})
    assert "| first | 4 | 2 | 1 (25.0%) | 1 | 66.7% |" in text
    assert "| a.py:1 | `c \\| 1` | `2` |  |" in text
    assert "| a.py:1 | `d \\| 1` | `2` | the same |" in text
    assert "- `gone`" in text


@pytest.mark.parametrize(
    ("words", "groups"),
    [
        ("--group first", {"first"}),
        ("--group sample --sample 1", {"sample"}),
        ("--sample 0", {"first"}),
        ("--sample 1", {"first", "sample"}),
        ("--only rig/clock.py", {"first"}),
    ],
)
def test_listing_mutants_makes_only_those_of_the_requested_group(
    words: str, groups: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("rig/engine/engine.py", "rig/clock.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("height = lift + 1\n", encoding="utf-8")
    made: list[str] = []

    def making(root: Path, path: str) -> list[Mutant]:
        made.append(path)
        assert f"making the mutants of {path}" in capsys.readouterr().err
        return mutants_of(root, path)

    monkeypatch.setattr(runner, "ROOT", tmp_path)
    monkeypatch.setattr(runner, "FOLDER", tmp_path / ".mutants")
    monkeypatch.setattr(runner, "mutants_of", making)
    monkeypatch.setattr(runner, "EVERY_S", 0.0)
    monkeypatch.setattr("sys.argv", ["mutants", "--list", *words.split()])
    runner.main()
    listed = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in listed} == groups
    assert set(made) == {line.split("::")[0].rpartition(" ")[2] for line in listed}
