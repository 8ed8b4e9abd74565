"""Registry, results and pages of the studies agree; a study's tables are stored as it prints them."""

from dataclasses import replace
from pathlib import Path

import pytest

from studies import __main__ as runner
from studies import registry
from studies.registry import Study

PAGE = """\
# A page

```{csv-table}
:file: ../../studies/results/one/first.csv
:header-rows: 1
```

```{csv-table}
:file: ../../studies/results/one/second.csv
```
"""
REGISTRY = """\
[one]
answers = "What is asked."
run = ["studies.one"]
pages = ["page"]
[one.tables]
"one/first" = "12345678"
"one/second" = "12345678"
"""
PRINTED = "said before\n| a | b |\n|---|---|\n| 1, 2 | |\n\n| c | d |\n|---|---|\n| 4 | a \\| b |\n"


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in (("docs/page.md", PAGE), ("registry.toml", REGISTRY)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    results = tmp_path / "results"
    registry.write_table("one/first", [["a", "b"], ["1, 2", ""]], results)
    registry.write_table("one/second", [["c", "d"], ["3", "a \\| b"]], results)
    monkeypatch.setattr(registry, "find_spec", lambda name: name)
    monkeypatch.setattr(registry, "RESULTS", results)
    monkeypatch.setattr(registry, "REGISTRY", tmp_path / "registry.toml")
    monkeypatch.setattr(runner, "OUTPUT", tmp_path / "output")
    return tmp_path


def _problems(tree: Path) -> list[str]:
    return registry.problems(tree / "registry.toml", tree / "results", tree / "docs")


def test_registry_results_and_pages_of_the_studies_agree() -> None:
    assert registry.problems() == []


def test_a_page_shows_the_stored_tables_of_a_study_as_markdown(tree: Path) -> None:
    assert _problems(tree) == []
    shown = registry.expanded(PAGE, tree / "results")
    assert "| 1, 2 |  |" in shown
    assert "csv-table" not in shown
    assert list(registry.tables_in(shown))[1] == [["c", "d"], ["3", "a \\| b"]]


@pytest.mark.parametrize(
    ("file", "before", "after", "named"),
    [
        ("results/one/first.csv", '"1, 2",', "1", "one/first.csv"),
        ("docs/page.md", "one/first", "one/third", "one/third"),
        ("registry.toml", '"one/first" = "12345678"\n', "", "one/first"),
        ("registry.toml", '"page"', '"elsewhere"', "docs/elsewhere.md"),
        ("registry.toml", '"12345678"', '"today"', "today"),
        ("registry.toml", "run =", 'data = ["nowhere.csv"]\nrun =', "nowhere.csv"),
        ("registry.toml", "studies.one", "rig bench", "no study rig"),
    ],
)
def test_the_registry_names_each_disagreement_of_results_and_pages(
    tree: Path, file: str, before: str, after: str, named: str
) -> None:
    text = (tree / file).read_text("utf-8")
    (tree / file).write_text(text.replace(before, after), "utf-8")
    assert any(named in line for line in _problems(tree))


def test_a_study_stores_its_printed_tables_and_the_commit(tree: Path) -> None:
    (study,) = registry.studies(tree / "registry.toml").values()
    assert runner.store(study, PRINTED, "abcdef12") == 0
    assert registry.read_table("one/second", tree / "results") == [["c", "d"], ["4", "a \\| b"]]
    assert (tree / "registry.toml").read_text("utf-8") == REGISTRY.replace("12345678", "abcdef12")
    assert (tree / "output" / "one.md").read_text("utf-8") == PRINTED


def test_a_printed_table_is_stored_in_the_file_with_its_header(tree: Path) -> None:
    (study,) = registry.studies(tree / "registry.toml").values()
    assert (
        runner.store(
            study, "| c | d |\n|---|---|\n| 7 | 8 |\n\n| e |\n|---|\n| 9 |\n\n| f |\n|---|\n| 0 |\n", "abcdef12"
        )
        == 1
    )
    assert registry.read_table("one/second", tree / "results")[1] == ["7", "8"]
    assert registry.read_table("one/first", tree / "results")[1] == ["1, 2", ""]
    assert (tree / "registry.toml").read_text("utf-8").count("12345678") == 1


@pytest.mark.parametrize(
    ("head", "code", "stored"),
    [("| C | in D |", 0, [["c", "d"], ["7", "8"]]), ("| C | D | E |", 1, [["c", "d"], ["3", "a \\| b"]])],
)
def test_a_stored_table_keeps_its_heading_whatever_the_study_prints(
    tree: Path, head: str, code: int, stored: list[list[str]]
) -> None:
    """A printed table of another width is none of the study's tables."""
    (study,) = registry.studies(tree / "registry.toml").values()
    columns = head.count("|") - 1
    row = "| " + " | ".join(map(str, range(7, 7 + columns))) + " |"
    printed = f"| a | b |\n|---|---|\n| 1 | 2 |\n\n{head}\n{'|---' * columns}|\n{row}\n"
    assert runner.store(study, printed, "abcdef12") == code
    assert registry.read_table("one/second", tree / "results") == stored


def test_tables_printed_by_consecutive_commands_stay_apart(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However often the study is run."""
    printed = {"first": "| a | b |\n|---|---|\n| 1 | 2 |\n", "second": "| c | d |\n|---|---|\n| 3 | 4 |\n| 5 | 6 |\n"}
    for name, text in printed.items():
        (tree / f"{name}.py").write_text(f"print({text!r}, end='')\n", "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tree))
    (study,) = registry.studies(tree / "registry.toml").values()
    for _ in range(2):
        assert runner.run(replace(study, run=("first", "second"))) == 0
        assert registry.read_table("one/first", tree / "results") == [["a", "b"], ["1", "2"]]
        assert registry.read_table("one/second", tree / "results") == [["c", "d"], ["3", "4"], ["5", "6"]]


def test_a_study_runs_with_its_number_of_threads(
    capfd: pytest.CaptureFixture[str], tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tree / "printed.py").write_text("import os\nprint(os.environ['OMP_NUM_THREADS'])\n", "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tree))
    assert runner._printed("printed", 1) == (0, "1\n")
    assert capfd.readouterr().out == "1\n"


def test_a_removed_study_is_listed_with_its_commit_and_not_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert runner.main(["list", "timing", "by-hand"]) == 0
    assert "studies/results/speed/build.csv" in capsys.readouterr().out
    assert runner.run(Study("one", "What is asked.", (), removed="12345678")) == 1
    assert "git show 12345678" in capsys.readouterr().err
