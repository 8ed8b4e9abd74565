"""Every key of every file of settings refuses a value of another type, by its name; a whole number is a number."""

import datetime
import math
import types
from collections.abc import Iterator
from importlib import import_module
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError

import rig.compare.plausible_fingers  # noqa: F401
from rig.devices.registry import BUILT_IN
from rig.engine.bench_memory import LastKnown
from rig.errors import first_problem
from rig.settings import Settings
from rig.study.parameter_study import StudyFile, StudyPress
from sim.config import FingertipConfig, Geometry

for name in [name for names in BUILT_IN.values() for name in names]:
    import_module(f"rig.devices.{name}")  # or its table would be tested only behind a file that imports it

DAY, NOON = datetime.date(2026, 3, 1), datetime.datetime(2026, 3, 1, 12)
NEVER = [NOON, datetime.time(12), math.nan, math.inf, -math.inf, {"a": 1}, [[["x"]]]]
WRONG: dict[Any, list[Any]] = {
    float: [*NEVER, True, "1", DAY, [1.0], 10**400],
    int: [*NEVER, True, "1", DAY, [1], 1.0, 1.5, 1e300],
    str: [*NEVER, True, 1, 1.5, DAY, ["a"]],
    bool: [*NEVER, 0, 1, 1.0, "true", "yes", DAY, [True]],
    datetime.date: [*NEVER, True, 0, 20260301, 1.5, "yesterday", "1", [DAY]],
    Literal: [*NEVER, True, 1, 1.5, DAY, ["a"]],
    tuple: [NOON, math.nan, True, 1.5, DAY, "1 2 3", {"a": 1}, [True], [["1"]], [[True, True]], [[[1.0]]]],
    BaseModel: [NOON, math.nan, True, 1, 1.5, "a", DAY, [1]],
    dict: [NOON, math.nan, True, 1, 1.5, "a", DAY, [1]],
}
SINGLE = {("StudyPress", key) for key in ("x_mm", "doi_mm", "force_gwt")} | {
    ("StudyFile", key) for key in ("receptor_depth_mm", "receptor_x_mm")
}
"""Lists of a study, where a single number stands for a list of one."""


def _below(kind: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for one in kind.__subclasses__():
        yield one
        yield from _below(one)


MODELS = {
    model.__name__: model
    for model in [*_below(Settings), *_below(FingertipConfig.__mro__[1]), StudyFile, StudyPress, LastKnown]
    if model.__module__.startswith(("rig.", "sim."))
}


def _kind(annotation: Any) -> Any:
    while True:
        origin = get_origin(annotation)
        if origin is Annotated or annotation.__class__.__name__ == "_AnnotatedAlias":
            annotation = get_args(annotation)[0]
        elif origin in (Union, types.UnionType):
            annotation = next(one for one in get_args(annotation) if one is not type(None))
        elif origin is not None:
            return origin
        elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return BaseModel
        elif annotation in WRONG:
            return annotation
        else:
            return BaseModel if TypeAdapter(annotation).json_schema().get("type") == "object" else annotation


@pytest.mark.parametrize("name", sorted(MODELS))
def test_a_value_of_another_type_is_refused_by_the_name_of_its_key(name: str) -> None:
    model, accepted = MODELS[name], []
    for key, field in model.model_fields.items():
        kind = _kind(field.annotation)
        for value in WRONG[kind]:
            if (name, key) in SINGLE and value in (1.5,):
                continue
            try:
                model.model_validate({key: value})
            except ValidationError as error:
                named = [problem for problem in error.errors() if problem["loc"][:1] == (key,)]
                if named and named[0]["type"] != "missing":
                    line = str(first_problem("a file", ValidationError.from_exception_data("x", [
                        {"type": "value_error", "loc": named[0]["loc"], "input": value,
                         "ctx": {"error": ValueError(named[0]["msg"])}}])))  # fmt: skip
                    assert "\n" not in line
                    assert len(line) < 500
                    continue
            accepted.append((key, value))
    assert not accepted


def test_the_strict_type_tests_cover_every_settings_file() -> None:
    assert {"Config", "LaumasSettings", "DriveSettings", "Geometry", "Posterior", "Draw", "_Parts"} <= set(MODELS)
    assert sum(len(model.model_fields) for model in MODELS.values()) > 200


def test_a_numeric_key_accepts_a_whole_number_and_a_negative_zero() -> None:
    found = Geometry.model_validate({"length_mm": 13, "proximal_lean_mm": -0.0})
    assert (type(found.length_mm), found.length_mm, found.proximal_lean_mm) == (float, 13.0, 0.0)
