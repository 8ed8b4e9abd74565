"""The plan of the house: how large its rooms are, that no two things have one name, and that its page is true."""

import ast
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "code_overview.md"
DOCS = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md"]
PACKAGES = ("rig", "sim")
MOST_ENTRIES, MOST_MODULES, MOST_LINES, MOST_ARGUMENTS = 14, 15, 300, 6
OFTEN = {"__init__", "base", "errors"}  # a room may have one of its own


def _modules(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def _folders(package: str) -> Iterator[Path]:
    yield from {path.parent for path in _modules(package)}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_has_few_rooms(package: str) -> None:
    entries = [path.name for path in (ROOT / package).iterdir() if path.name != "__pycache__"]
    assert len(entries) <= MOST_ENTRIES, entries


@pytest.mark.parametrize("package", [*PACKAGES, "studies"])
def test_a_room_has_few_modules(package: str) -> None:
    for folder in _folders(package):
        if folder != ROOT / "rig" / "cli":
            assert len(list(folder.glob("*.py"))) <= MOST_MODULES, folder


@pytest.mark.parametrize("package", [*PACKAGES, "studies"])
def test_a_module_is_short(package: str) -> None:
    for path in _modules(package):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES, path


@pytest.mark.parametrize("package", [*PACKAGES, "studies"])
def test_every_room_and_module_says_what_it_is(package: str) -> None:
    for path in _modules(package):
        assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), path


@pytest.mark.parametrize("package", PACKAGES)
def test_no_two_modules_have_one_name(package: str) -> None:
    """Commands have the names that are typed; elsewhere a name is looked for once."""
    names = Counter(path.stem for path in _modules(package) if path.parent.name != "cli" and path.stem not in OFTEN)
    assert not [name for name, times in names.items() if times > 1]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_constructor_takes_few_arguments(package: str) -> None:
    """What is written by hand; a frozen record's fields are its data."""
    for path in _modules(package):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and node.name == "__init__":
                arguments = len(node.args.args) - 1 + len(node.args.kwonlyargs)
                assert arguments <= MOST_ARGUMENTS, f"{path}, line {node.lineno}: {arguments}"


# --- the page ---


def test_every_path_on_the_page_is_there() -> None:
    named = set(
        re.findall(r"`((?:rig|sim|studies|tests|docs|protocols|examples)/[\w./-]*\w)", PAGE.read_text("utf-8"))
    )
    assert len(named) > 60
    assert not [name for name in sorted(named) if "NAME" not in name and not (ROOT / name).exists()]


def test_every_room_is_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for package in PACKAGES:
        for folder in sorted(_folders(package)):
            name = folder.relative_to(ROOT).as_posix()
            assert f"`{name}/`" in page or name in PACKAGES, name


def test_every_name_after_a_path_is_in_that_file() -> None:
    """`rig/engine/verbs.py: home` is only there if home is."""
    for name, things in re.findall(r"`((?:rig|sim)/[\w/]+\.py): ([\w., ]+)`", PAGE.read_text(encoding="utf-8")):
        tree = ast.parse((ROOT / name).read_text(encoding="utf-8"))
        named = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)]
        set_to = [t for node in tree.body if isinstance(node, ast.Assign) for t in node.targets]
        set_to += [node.target for node in ast.walk(tree) if isinstance(node, ast.AnnAssign)]
        there = {node.name for node in named} | {t.id for t in set_to if isinstance(t, ast.Name)}
        for thing in things.split(", "):
            assert set(thing.split(".")) <= there, f"{name}: {thing}"


@pytest.mark.parametrize("page", DOCS, ids=lambda path: path.name)
def test_every_path_in_the_documentation_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:rig|sim|studies|tests|docs|protocols|examples)/[\w./-]*\w)`", text))
    assert not [name for name in sorted(named) if "NAME" not in name and not (ROOT / name).exists()]


@pytest.mark.parametrize(
    "page", [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", ROOT / "Makefile"], ids=lambda p: p.name
)
def test_every_study_that_is_named_can_be_run(page: Path) -> None:
    for name in re.findall(r"python3? -m (studies[\w.]*)", page.read_text(encoding="utf-8")):
        path = ROOT / Path(*name.split("."))
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), name


def test_every_package_is_held_to_its_types() -> None:
    """mypy, strict, as `make check` runs it."""
    mypy = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    assert mypy["strict"] is True
    assert {"rig", "sim", "studies"} <= set(mypy["packages"])
