"""Parameter studies: the same presses on every combination of fingers and receptors.

The file is TOML:

    receptor_depth_mm = [0.60, 0.76]
    [finger.tissue]                     # as in a configuration; a list is varied
    epidermis_mm = [0.3, 0.4, 0.5]
    [[press]]
    shape = "step:1"
    x_mm = [-1.63, -1.19]
    force_gwt = [2.33, 8.0]             # or doi_mm
"""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol, Self, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from rig.plan.config import reraised_as
from rig.settings import as_tuples
from rig.study.exceptions import StudyError
from rig_shared.user_files import MOST_TOML_BYTES, read_text, toml_of
from sim.config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.contact.patch import X
from sim.contact.shapes import ShapeError, parse_shape
from sim.errors import ModelRangeError
from sim.finger.mesh import MeshError
from sim.finger.surface import SurfaceError
from sim.measures.measures import MEASURES
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, ReceptorError
from sim.models.fingertip import Fingertip
from sim.models.interpolation import FingerWithReceptors, Node, missing_nodes, worth_interpolating


class OnAFinger(Protocol):
    """Presses on one finger: a dataclass, with `exact` if the finger is built in full."""

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

    @property
    def exact(self) -> bool: ...

    @property
    def finger(self) -> FingerWithReceptors: ...

    @property
    def shapes(self) -> Sequence[str]: ...


Work = TypeVar("Work", bound=OnAFinger)


def interpolated(work: Sequence[Work]) -> list[Work]:
    """Return the cases with interpolated fingers where only the moduli of dermis and fat differ."""
    chosen = worth_interpolating([one.finger for one in work])
    return [replace(one, exact=not other) for one, other in zip(work, chosen, strict=True)]


def nodes_to_build(work: Sequence[OnAFinger]) -> list[Node]:
    """Return the full builds that interpolated fingers need and that are not on disk, as tasks for `make_node`."""
    them = [one for one in work if not one.exact]
    axes = dict.fromkeys([ALONG, *(parse_shape(shape).axes for one in them for shape in one.shapes)])
    return missing_nodes([one.finger for one in them], axes)


_NATIVE_LISTS = ("points", "sections")
"""Keys of a finger whose values are tables, which a study cannot vary."""


def _one_or_more(value: object) -> object:
    return (value,) if isinstance(value, int | float) else as_tuples(value)


_Numbers = Annotated[tuple[float, ...], BeforeValidator(_one_or_more)]


class _StrictModel(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class StudyPress(_StrictModel):
    """One indentor at some positions, to some depths or forces."""

    shape: str
    x_mm: _Numbers = Field((0.0,), min_length=1)
    doi_mm: _Numbers = ()
    force_gwt: _Numbers = ()

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        if bool(self.doi_mm) == bool(self.force_gwt):
            raise ValueError("must contain exactly one of doi_mm and force_gwt")
        if X not in parse_shape(self.shape).placed_by and self.x_mm != (0.0,):
            raise ValueError(f"shape {self.shape!r} has no position along x; remove x_mm")
        return self

    @property
    def targets(self) -> list[tuple[str, float]]:
        """Commanded depths or forces, in order."""
        kind = "doi_mm" if self.doi_mm else "force_gwt"
        return [(kind, value) for value in self.doi_mm or self.force_gwt]


class StudyFile(_StrictModel):
    """Contents of the TOML file."""

    receptor_depth_mm: _Numbers = Field((DEFAULT_DEPTH_MM,), min_length=1)
    receptor_x_mm: _Numbers = Field(DEFAULT_X_MM, min_length=1)
    finger: dict[str, Any] = Field(default_factory=dict)
    press: Annotated[tuple[StudyPress, ...], BeforeValidator(as_tuples)] = Field(min_length=1)


@dataclass(frozen=True)
class Case:
    """One finger with its receptors under one indentor at one depth or force, solved as one task."""

    varied: tuple[tuple[str, Any], ...]  # parameters in which this finger differs
    config_json: str
    receptor_depth_mm: float
    receptor_x_mm: tuple[float, ...]
    shape: str
    kind: str
    value: float
    x_mm: tuple[float, ...]
    exact: bool = True  # False: interpolated between full builds

    @property
    def finger(self) -> FingerWithReceptors:
        """Finger with its receptors."""
        return FingerWithReceptors.of(self.config_json, self.receptor_x_mm, self.receptor_depth_mm)

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the shapes."""
        return (self.shape,)


Row = dict[str, Any]


def read_study(path: Path) -> list[Case]:
    """Return every combination, grouped by finger; raise StudyError if the file is invalid."""
    with reraised_as(f"study {path}", StudyError, StudyFile):
        study = StudyFile.model_validate(toml_of(read_text(path, encoding="utf-8-sig", most=MOST_TOML_BYTES)))
    with reraised_as(f"study {path}: [finger]", StudyError, FingertipConfig):
        return list(_cases(study, path.parent))


def _cases(study: StudyFile, folder: Path) -> Iterator[Case]:
    for finger, varied in _fingers(study.finger):
        config = FingertipConfig.model_validate(finger, context={"folder": folder})
        for depth_mm, press in itertools.product(study.receptor_depth_mm, study.press):
            for kind, value in press.targets:
                yield Case(
                    tuple(varied.items()),
                    config.model_dump_json(),
                    depth_mm,
                    study.receptor_x_mm,
                    press.shape,
                    kind,
                    value,
                    press.x_mm,
                )


def _fingers(tree: dict[str, Any]) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield each combination of the lists in a tree of tables, and the chosen values by dotted key."""
    lists = dict(_lists(tree, ()))
    for choice in itertools.product(*lists.values()):
        finger = tree
        for keys, value in zip(lists, choice, strict=True):
            finger = _with(finger, keys, value)
        yield finger, {".".join(keys): value for keys, value in zip(lists, choice, strict=True)}


def _lists(tree: dict[str, Any], keys: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], list[Any]]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _lists(value, (*keys, key))
        elif isinstance(value, list) and key not in _NATIVE_LISTS:
            yield (*keys, key), value


def _with(tree: dict[str, Any], keys: tuple[str, ...], value: Any) -> dict[str, Any]:
    head, *rest = keys
    return {**tree, head: _with(tree[head], tuple(rest), value) if rest else value}


def solve(case: Case) -> list[Row]:
    """Return one row per position and receptor, or one with the reason under `problem` if unsolved."""
    rows: list[Row] = []
    for x_mm in case.x_mm:
        about = dict(case.varied) | {
            "receptor_depth_mm": case.receptor_depth_mm,
            "shape": case.shape,
            "target": case.kind,
            "value": case.value,
            "x_mm": x_mm,
        }
        try:
            finger = _finger(case.config_json, case.receptor_x_mm, case.receptor_depth_mm, exact=case.exact)
            rows += [about | answer for answer in _answers(finger, case, x_mm)]
        except (ModelRangeError, MeshError, SurfaceError, ReceptorError, ShapeError) as error:
            rows.append(about | {"problem": str(error)})
    return rows


@lru_cache(maxsize=1)
def _finger(config_json: str, receptor_x_mm: Sequence[float], depth_mm: float, *, exact: bool) -> Fingertip:
    config = FingertipConfig.model_validate_json(config_json)
    return Fingertip.load(config, receptor_x_mm=receptor_x_mm, receptor_depth_mm=depth_mm, exact=exact)


def _answers(finger: Fingertip, case: Case, x_mm: float) -> Iterator[Row]:
    target = {case.kind: case.value}
    result = finger.indent(case.shape, x_mm, **target)  # type: ignore[arg-type]
    measures = result.receptor_measures
    for k, receptor_mm in enumerate(case.receptor_x_mm):
        yield {
            "problem": "" if result.state.converged else f"not converged, residual {result.state.residual:.0e}",
            "model": result.model.kind,
            "force_gwt": result.force_gwt,
            "doi_mm": result.doi_mm,
            "peak_pressure_kpa": result.peak_pressure_kpa,
            "receptor_x_mm": receptor_mm,
            **{name: float(measures[name][k]) for name in MEASURES},
        }


def columns(cases: Sequence[Case]) -> list[str]:
    """Return the columns of the table, in order."""
    varied = dict.fromkeys(name for case in cases for name, _ in case.varied)
    pressed = ("receptor_depth_mm", "shape", "target", "value", "x_mm", "problem", "model")
    return [*varied, *pressed, "force_gwt", "doi_mm", "peak_pressure_kpa", "receptor_x_mm", *MEASURES]
