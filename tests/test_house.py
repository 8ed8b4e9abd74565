"""Every path that the documentation names exists."""

import ast
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "code_overview.md"
DOCS = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PACKAGES = ("rig", "sim", "rig_shared")


def _modules(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


# --- the page ---


def test_every_path_on_the_code_overview_page_exists() -> None:
    named = set(
        re.findall(r"`((?:rig|sim|studies|tests|docs|protocols|examples)/[\w./-]*\w)", PAGE.read_text("utf-8"))
    )
    assert len(named) > 60
    assert not [name for name in sorted(named) if "NAME" not in name and not (ROOT / name).exists()]


def test_every_package_folder_is_on_the_code_overview_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for package in PACKAGES:
        for folder in sorted({path.parent for path in _modules(package)}):
            name = folder.relative_to(ROOT).as_posix()
            assert f"`{name}/`" in page or name in PACKAGES, name


def test_every_name_on_the_code_overview_page_is_in_its_file() -> None:
    """`rig/engine/verbs.py: home` is only there if home is."""
    for name, things in re.findall(r"`((?:rig|sim)/[\w/]+\.py): ([\w., ]+)`", PAGE.read_text(encoding="utf-8")):
        tree = ast.parse((ROOT / name).read_text(encoding="utf-8"))
        named = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)]
        set_to = [t for node in tree.body if isinstance(node, ast.Assign) for t in node.targets]
        set_to += [node.target for node in ast.walk(tree) if isinstance(node, ast.AnnAssign)]
        there = {node.name for node in named} | {t.id for t in set_to if isinstance(t, ast.Name)}
        for thing in things.split(", "):
            assert set(thing.split(".")) <= there, f"{name}: {thing}"


def test_every_path_in_the_documentation_exists() -> None:
    for page in DOCS:
        text = page.read_text(encoding="utf-8")
        named = set(re.findall(r"`((?:rig|sim|studies|tests|docs|protocols|examples)/[\w./-]*\w)`", text))
        named |= set(re.findall(r"\b(?:tests|studies)/[\w/]+\.py\b", text))  # also in commands
        assert not [name for name in sorted(named) if "NAME" not in name and not (ROOT / name).exists()], page


def test_every_study_named_in_the_documentation_can_be_run() -> None:
    for page in (*DOCS, ROOT / "Makefile"):
        for name in re.findall(r"python3? -m (studies[\w.]*)", page.read_text(encoding="utf-8")):
            path = ROOT / Path(*name.split("."))
            assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), f"{page}: {name}"


FOREIGN = {"4ec9f5c"}  # of TouchSim: docs/validation/nerve.md


def _commits(text: str) -> set[str]:
    """Seven or eight hexadecimal digits, letters among them, or behind the word commit."""
    found = re.findall(r"\b(?=[\da-f]*[a-f])(?=[\da-f]*\d)[\da-f]{7,8}\b|(?<=commit )[\da-f]{7,8}\b", text)
    return {*found} - FOREIGN


@pytest.mark.skipif(
    shutil.which("git") is None or not (ROOT / ".git").exists() or (ROOT / ".git" / "shallow").exists(),
    reason="needs the history",
)
def test_every_commit_named_in_the_documentation_exists() -> None:
    pages = (*DOCS, ROOT / "CHANGELOG.md", ROOT / "studies" / "registry.toml")
    named = {commit: page.name for page in pages for commit in _commits(page.read_text(encoding="utf-8"))}
    assert len(named) > 60
    asked = subprocess.run(
        ["git", "cat-file", "--batch-check"],
        input="\n".join(named),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    answers = zip(named.items(), asked.stdout.splitlines(), strict=True)
    assert [(commit, page) for (commit, page), answer in answers if " commit " not in answer] == []


def test_every_package_is_type_checked_strictly() -> None:
    """mypy, strict, as `make check` runs it."""
    mypy = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    assert mypy["strict"] is True
    assert {*PACKAGES, "studies"} <= set(mypy["packages"])


def test_every_variable_of_the_makefile_is_defined() -> None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    used = set(re.findall(r"\$\((\w+)\)", text))
    assert {"BIN", "MEASURE_STUDIES"} <= used
    assert not used - {"CURDIR", "MAKE"} - set(re.findall(r"^(?:export )?(\w+) *[?:]?=", text, re.M))
