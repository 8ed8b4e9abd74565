"""Public names have numpydoc docstrings: summary, units, shapes, returns, raises, and examples that run."""

import ast
import dataclasses
import doctest
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any

import pytest
from pydantic import BaseModel

if TYPE_CHECKING:
    from numpydoc.docscrape import NumpyDocString

ROOT = Path(__file__).parents[1]

OFFERED: dict[str, tuple[str, ...]] = {
    "sim": tuple(import_module("sim").__all__),
    "rig": ("door",),
    "rig.protocol": tuple(import_module("rig.protocol").__all__),
    "rig.devices.base": tuple(
        name
        for name, found in vars(import_module("rig.devices.base")).items()
        if not name.startswith("_") and getattr(found, "__module__", "") == "rig.devices.base"
    ),
    "rig.settings": tuple(
        name
        for name, found in vars(import_module("rig.settings")).items()
        if inspect.isclass(found) and found.__module__ == "rig.settings"
    ),
    "rig.plan.config": ("Config", "VirtualSettings", "load_config", "with_finger"),
    "rig.devices.registry": ("DeviceKind", "StageKind", "ForceKind", "KindError", "KnownBench"),
}
"""Every public name, by the module that a user imports it from."""

NOT_OURS = {"sim.__version__", "rig.protocol.Field", "sim.MEASURES"}
"""Text, a name of another library, and a list of names: without a docstring of ours."""

WITH_EXAMPLES = ("sim", "rig.protocol")
"""Modules whose functions and classes show an example; errors and abstract classes need none."""

RULES = (
    *("GL03", "GL05", "GL06", "GL07", "GL08", "GL10"),  # layout and sections
    *("SS01", "SS02", "SS03", "SS04", "SS06"),  # the summary
    *("PR01", "PR02", "PR03", "PR04", "PR05", "PR06", "PR07", "PR08", "PR09", "PR10"),  # parameters
    *("RT01", "RT03", "RT04", "RT05", "YD01"),  # returns and yields
)
OF_A_CLASS = ("PR01", "PR02", "PR03")  # its fields may be attributes, or described in a configuration's schema

VERBS = {
    "Allow", "Ask", "Build", "Carry", "Change", "Choose", "Clear", "Connect", "Copy", "Fill", "Find", "Get", "Halt",
    "Home", "Identify", "Import", "Interpolate", "Jog", "Lift", "Load", "Make", "Measure", "Mount", "Move", "Parse",
    "Press", "Raise", "Read", "Refuse", "Release", "Return", "Run", "Set", "Start", "Stop", "Switch", "Touch", "Turn",
    "Wait", "Write", "Yield", "Zero",
}  # fmt: skip
"""First words of a function's summary."""

UNITS = {
    "_mm_s": r"mm/s",
    "_mm2": r"mm²",
    "_mm": r"\bmm\b",
    "_gwt": r"\bgwt\b",
    "_mpa": r"\bMPa\b",
    "_pseudo": r"pseudo-units",
    "_deg": r"degrees|°",
    "_n": r"\bN\b",
    "_s": r"\bs\b",
}
"""What the text says where a name ends so."""

REFUSING = re.compile(r"(_?refuse\w*|positive|_do)$")
"""Functions that raise for their caller."""

NEVER_REFUSED = {"rig.protocol.Rig.home"}


def _fields(owner: type) -> dict[str, Any]:
    """What a class is made from, with its annotation, where its fields are public."""
    if issubclass(owner, BaseModel):
        return {}
    if dataclasses.is_dataclass(owner):
        return {field.name: field.type for field in dataclasses.fields(owner) if not field.name.startswith("_")}
    if "__init__" in vars(owner) and not getattr(owner, "_is_protocol", False):
        signature = inspect.signature(owner)
        return {name: parameter.annotation for name, parameter in signature.parameters.items()}
    return {}


def _members(owner: type) -> Iterator[tuple[str, Any]]:
    """Public functions, properties and class methods of a class, its own and inherited from this project."""
    kinds = (FunctionType, property, cached_property, classmethod, staticmethod)
    seen = {*_fields(owner), "model_post_init"}  # pydantic writes the last
    for base in inspect.getmro(owner):
        if base.__module__.partition(".")[0] not in ("rig", "sim") or base.__name__ in ("SimError", "RigError"):
            continue
        for name, member in vars(base).items():
            if not name.startswith("_") and name not in seen and isinstance(member, kinds):
                yield name, member
        seen |= set(vars(base))


def _rows() -> Iterator[tuple[str, Any]]:
    for module, names in OFFERED.items():
        for name in names:
            found = getattr(import_module(module), name)
            if f"{module}.{name}" in NOT_OURS or not callable(found) or not hasattr(found, "__qualname__"):
                continue
            yield f"{module}.{name}", found
            if inspect.isclass(found):
                yield from ((f"{module}.{name}.{member}", what) for member, what in _members(found))


ROWS = dict(_rows())


def _function(found: Any) -> Callable[..., Any] | None:
    """The function behind a member; None for a class."""
    if isinstance(found, property):
        return found.fget
    if isinstance(found, cached_property):
        return found.func
    found = getattr(found, "__func__", found)
    return None if inspect.isclass(found) else found


def _doc(found: Any) -> "NumpyDocString":
    from numpydoc.docscrape import NumpyDocString  # it imports Sphinx, which collecting the tests does without

    return NumpyDocString(
        textwrap.dedent(inspect.getdoc(found if inspect.isclass(found) else _function(found)) or "")
    )


def _said(doc: "NumpyDocString", *sections: str) -> dict[str, str]:
    """Types and descriptions by name; one entry may name several parameters."""
    found: dict[str, str] = {}
    for section in sections:
        for entry in doc[section]:
            for name in entry.name.split(","):
                found[name.strip().lstrip("*")] = f"{entry.type} {' '.join(entry.desc)}"
    return found


def _without_unit(names: dict[str, str]) -> Iterator[str]:
    for name, text in names.items():
        suffix = next((suffix for suffix in UNITS if name.endswith(suffix)), None)
        if suffix is not None and not re.search(UNITS[suffix], text):
            yield f"{name}: no unit"


def _without_shape(annotations: dict[str, Any], said: dict[str, str]) -> Iterator[str]:
    for name, annotation in annotations.items():
        if "ArrayLike" in str(annotation) or "NDArray" in str(annotation):
            text = said.get(name, "")
            if not re.search(r"\([^)]*(\w|…)+,[^)]*\)|broadcast", text):
                yield f"{name}: no shape"


def _raised(function: Callable[..., Any]) -> tuple[set[str], bool]:
    """Names of the errors that a function raises itself, and whether it calls one that refuses."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    names, refuses = set(), False
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            called = node.exc.func
            names.add(called.id if isinstance(called, ast.Name) else ast.unparse(called))
        elif isinstance(node, ast.Call):
            called = node.func
            word = called.id if isinstance(called, ast.Name) else getattr(called, "attr", "")
            refuses = refuses or REFUSING.match(word) is not None
    return {name for name in names if name[:1].isupper()}, refuses


def _bases(function: Callable[..., Any], name: str) -> set[str]:
    kind = function.__globals__.get(name)
    return {base.__name__ for base in inspect.getmro(kind)} if inspect.isclass(kind) else {name}


def _problems_of_function(function: Callable[..., Any], doc: "NumpyDocString", *, value: bool) -> Iterator[str]:
    said = _said(doc, "Parameters")
    if value:
        if ": " in " ".join(doc["Summary"]):
            yield "a colon, before which the site sees a type"
        yield from _without_unit({function.__name__: " ".join([*doc["Summary"], *doc["Extended Summary"]])})
    elif " ".join(doc["Summary"]).split(" ")[0] not in VERBS:
        yield f"not imperative: {' '.join(doc['Summary'])!r}"
    yield from _without_unit(said)
    yield from _without_shape(inspect.get_annotations(function) if not value else {}, said)
    if not value and function.__name__.endswith(tuple(UNITS)):
        yield from _without_unit({function.__name__: " ".join(" ".join(e.desc) for e in doc["Returns"])})
    raised, refuses = _raised(function)
    listed = {entry.type or entry.name for entry in doc["Raises"]}
    yield from (f"raises {name}" for name in raised if not _bases(function, name) & listed)
    if refuses and not listed and f"rig.protocol.{function.__qualname__}" not in NEVER_REFUSED:
        yield "no Raises, and it calls a function that refuses"


def _problems_of_class(owner: type, doc: "NumpyDocString") -> Iterator[str]:
    if issubclass(owner, BaseModel):
        for name, field in owner.model_fields.items():
            # Tables of a configuration describe themselves.
            if not field.description and not inspect.isclass(field.annotation):
                yield f"field {name}: no description"
        return
    said, fields = _said(doc, "Parameters", "Attributes"), _fields(owner)
    yield from (f"{name}: not documented" for name in fields if name not in said)
    yield from (f"{name}: no such field" for name in _said(doc, "Parameters") if name not in fields)
    yield from _without_unit(said)
    yield from _without_shape(fields, said)


def _problems(name: str) -> list[str]:
    from numpydoc.validate import validate

    found = ROWS[name]
    doc = _doc(found)
    owned = inspect.isclass(found)
    value = isinstance(found, property | cached_property)
    rules = [rule for rule in RULES if not ((owned or value) and (rule in OF_A_CLASS or rule == "RT01"))]
    listed = validate(name)["errors"]
    problems = [f"{code} {message}" for code, message in listed if code in rules]
    function = _function(found)
    if owned or function is None:
        problems += _problems_of_class(found, doc)
    else:
        problems += _problems_of_function(function, doc, value=value)
    return problems


def test_every_public_name_is_documented() -> None:
    pytest.importorskip("numpydoc", reason="needs numpydoc: pip install -e '.[dev]'")
    assert {name: problems for name in ROWS if (problems := _problems(name))} == {}


def test_the_public_names_cover_every_offered_module() -> None:
    assert len(ROWS) > 150
    assert {name.rpartition(".")[0] for name in ROWS} >= set(OFFERED)
    named = re.findall(r"^\| ([^|]*) \|", (ROOT / "docs/library.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert {name for cell in named for name in re.findall(r"`(\w+)`", cell)} <= set(OFFERED["sim"])


# --- examples ---

NEEDS = {"sim.to_pandas": "pandas", "sim.to_xarray": "xarray"}
"""Optional packages that an example imports."""


def _needs_example(name: str) -> bool:
    module, _, last = name.rpartition(".")
    found = ROWS[name]
    return module in WITH_EXAMPLES and last in OFFERED[module] and not (
        inspect.isclass(found) and (issubclass(found, Exception) or inspect.isabstract(found))
    )  # fmt: skip


def test_every_public_name_shows_an_example() -> None:
    shown = {name: doctest.DocTestParser().get_examples(inspect.getdoc(ROWS[name]) or "") for name in ROWS}
    assert [name for name in ROWS if _needs_example(name) and not shown[name]] == []


@pytest.mark.parametrize("name", [name for name in ROWS if ">>>" in (inspect.getdoc(ROWS[name]) or "")])
def test_every_docstring_example_prints_what_it_shows(name: str) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    text = inspect.getdoc(ROWS[name]) or ""
    heard: list[str] = []
    names = dict(vars(import_module("rig.devices.base"))) if name.startswith("rig.devices.base.") else {}
    runner.run(doctest.DocTestParser().get_doctest(text, names, name, None, None), out=heard.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(heard)
