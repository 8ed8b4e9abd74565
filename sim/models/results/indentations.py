"""Many indentations in the order in which they were asked for, and tables of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Indentor
from sim.contact.profiles import Profile
from sim.measures.measures import MEASURES
from sim.models.results.indentation import IndentationResult

Table = dict[str, NDArray[Any]]

_NUMBERS = (
    *("doi_mm", "force_n", "force_gwt", "peak_pressure_pseudo", "peak_pressure_mpa", "contact_area_mm2"),
    *("contact_s", "path_spread"),
)


class Asked(NamedTuple):
    """One indentation as it is asked for; None where nothing was said."""

    shape: Indentor | Profile | str
    x_mm: float
    z_mm: float | None
    doi_mm: float | None
    force_gwt: float | None


class Answer(NamedTuple):
    """A result, or the reason why there is none; what has not converged has both."""

    result: IndentationResult | None
    problem: str = ""
    code: str = ""  # of the problem


@dataclass(frozen=True, repr=False)
class Indentations:
    """What many indentations were asked for and answered."""

    asked: tuple[Asked, ...]
    answers: tuple[Answer, ...]

    def __len__(self) -> int:
        return len(self.asked)

    def __iter__(self) -> Iterator[IndentationResult | None]:
        return (answer.result for answer in self.answers)

    def __getitem__(self, row: int) -> IndentationResult | None:
        return self.answers[row].result

    def __repr__(self) -> str:
        return f"<{len(self)} indentations, {sum(bool(p) for p in self.problems)} with a problem>"

    @property
    def results(self) -> list[IndentationResult | None]:
        """None where there is no answer; `problems` says why."""
        return list(self)

    @property
    def problems(self) -> list[str]:
        """One line for each indentation, empty where all is well."""
        return [answer.problem for answer in self.answers]

    def table(self) -> Table:
        """One row an indentation: what was asked for, numbers (nan where there is no answer), and the problem."""
        plane = next((result.model.plane_mm for result in self if result is not None), np.nan)
        return {
            "shape": np.array([_name(asked.shape) for asked in self.asked], dtype=str),
            "x_mm": np.array([asked.x_mm for asked in self.asked], dtype=float),
            "z_mm": np.array([plane if asked.z_mm is None else asked.z_mm for asked in self.asked], dtype=float),
            "asked_doi_mm": np.array([asked.doi_mm for asked in self.asked], dtype=float),  # None becomes nan
            "asked_force_gwt": np.array([asked.force_gwt for asked in self.asked], dtype=float),
            **{name: self._numbers(name) for name in _NUMBERS},
            "regions": np.array([0 if result is None else len(result.contact_regions_mm) for result in self]),
            "residual": np.array([np.nan if result is None else result.state.residual for result in self]),
            "may_depend_on_path": np.array([result is not None and result.may_depend_on_path for result in self]),
            "problem": np.array(self.problems, dtype=str),
        }

    def receptor_table(self) -> Table:
        """One row a receptor under each indentation, which goes by its row in `table`; none where no answer is."""
        found = [(row, result.receptor_table()) for row, result in enumerate(self) if result is not None]

        def joined(name: str) -> NDArray[Any]:
            return np.concatenate([columns[name] for _, columns in found]) if found else np.zeros(0)

        numbers = [np.full(len(columns["x_mm"]), row) for row, columns in found]
        return {
            "indentation": np.concatenate(numbers) if found else np.zeros(0, np.int64),
            "receptor_x_mm": joined("x_mm"),
            "receptor_depth_mm": joined("depth_mm"),
            **{name: joined(name) for name in MEASURES},
        }

    def _numbers(self, name: str) -> NDArray[Any]:
        return np.array([np.nan if result is None else getattr(result, name) for result in self], dtype=float)


def _name(shape: Indentor | Profile | str) -> str:
    return shape if isinstance(shape, str) else shape.name
