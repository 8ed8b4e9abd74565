"""Small figures for a notebook: a finger's section, and a press in it."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from html import escape
from pickle import dumps, loads
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig_shared.outputs import UNIT_FIELDS, Keywords, Unit
from sim.contact.patch import PatchNodes, X, Z
from sim.measures.measures import BY_NAME, MEASURES, MeasureName, measures_in_layers
from sim.measures.receptors import ReceptorSet

if TYPE_CHECKING:
    from sim.models.result import IndentationResult


# --- outline ---

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


_LISTS = ("x_mm", "depth_mm", "z_mm", *MEASURES)
ReceptorsJson = Annotated[
    dict[str, list[float] | dict[MeasureName, Unit]],
    Keywords(
        description="Places of receptors and the measures there, one item each; tension is positive. unit: of each "
        "measure.",
        properties={name: {"type": "array", "items": {"type": "number"}} for name in _LISTS}
        | {"unit": {"type": "object", "additionalProperties": {"enum": list(UNIT_FIELDS)}}},
        required=[*_LISTS, "unit"],
        additionalProperties=False,
    ),
]
"""Entry `receptors` of an indentation."""


@dataclass(frozen=True, eq=False)
class ModelOutline:
    """Nodes, areas and receptors of a model, without its matrices; shared by all its results."""

    patch: PatchNodes
    patch_in_skin: Ints  # (n_patch,) numbers of the patch's nodes among those of the skin
    receptor_row: int
    receptors: ReceptorSet
    receptor_e: Array  # (n_receptors,) E / E(epidermis)
    nodes: int  # number of nodes of the model's mesh
    kind: str
    poisson: float
    default_finger: bool
    widened_mm: tuple[float, float] | None = None  # half-widths of a patch that contact made necessary

    @cached_property
    def plane(self) -> slice:
        """Patch nodes in the receptor plane."""
        columns = self.patch.shape[1]
        return slice(self.receptor_row * columns, (self.receptor_row + 1) * columns)

    @property
    def plane_mm(self) -> float:
        """z of the receptor plane (mm)."""
        return float(self.patch.position_mm[self.plane][0, Z])

    @cached_property
    def across(self) -> Ints:
        """Patch nodes in the receptor plane, by ascending x."""
        nodes = np.arange(len(self.patch))[self.plane]
        return nodes[np.argsort(self.patch.x[nodes])]

    @cached_property
    def along(self) -> slice:
        """Patch nodes along the pad's center line."""
        return slice(int(np.argmin(np.abs(self.patch.x[self.plane]))), None, self.patch.shape[1])

    def measures(self, strain: Array) -> dict[str, Array]:
        """Return the 18 measures (n_receptors,) of (n_receptors, 6) strains; stresses in pseudo-units."""
        return measures_in_layers(strain, self.receptor_e, self.poisson)

    def receptors_as_json(self, measures: dict[str, Array]) -> ReceptorsJson:
        """Return the entry `receptors` of `rig indent --json`."""
        x_mm, _, z_mm = self.receptors.position_mm.T
        places = {"x_mm": x_mm, "depth_mm": self.receptors.depths_mm, "z_mm": z_mm}
        lists = {name: values.tolist() for name, values in {**places, **measures}.items()}
        return {**lists, "unit": {name: BY_NAME[name].unit for name in measures}}

    def receptor_columns(self, measures: dict[str, Array]) -> dict[str, Array]:
        """Return the columns x_mm, depth_mm and the 18 measures, one row for each receptor."""
        x_mm = self.receptors.position_mm[:, 0]
        columns = {"x_mm": x_mm.copy(), "depth_mm": self.receptors.depths_mm.copy()}
        return columns | {name: measures[name] for name in MEASURES}

    @cached_property
    def _packed(self) -> bytes:
        """Compressed pickle of the fields: heights along the finger repeat."""
        patch = PatchNodes(self.patch.position_mm, self.patch.area_mm2, self.patch.shape, self.patch.axes)
        state = {field.name: getattr(self, field.name) for field in fields(self)} | {"patch": patch}
        return zlib.compress(dumps(state, protocol=5), level=1)

    def __getstate__(self) -> dict[str, bytes]:
        return {"packed": self._packed}

    def __setstate__(self, state: dict[str, bytes]) -> None:
        unpacked: dict[str, Any] = loads(zlib.decompress(state["packed"]))
        self.__dict__.update(unpacked)


_PX_PER_MM = 32.0
_MARGIN_MM = 0.3
_ABOVE_MM = 1.6  # above the skin's top, for the indentor and the pressure
_PRESSURE_MM = 1.2  # height of the highest pressure in the figure
_POINTS = 241
_SKIN, _INDENTOR, _PRESSURE = "#8c4a2f", "#555", "#1f77b4"


class Cut(NamedTuple):
    """Press in the receptor plane, or along the pad's center line under shapes that lie across the finger (mm)."""

    at_rest: Array  # (2, n) along the cut and up
    pressed: Array  # (2, n)
    indentor: Array  # (2, k)
    pressure: Array  # (n,) pseudo-units


def cut(result: "IndentationResult") -> Cut:
    """Return skin, indentor and pressure of a press in its most informative plane."""
    model, patch, u = result.model, result.model.patch, result.state.displacement
    across = X in result.indentor.axes
    nodes = model.across if across else np.arange(len(patch))[model.along]
    along = patch.position_mm[nodes, X if across else Z]
    at_rest = np.stack([along, patch.y[nodes]])
    s = np.linspace(along.min() - _MARGIN_MM, along.max() + _MARGIN_MM, _POINTS)
    coordinate = {
        X: s - result.x_mm,
        Z: np.full(_POINTS, model.plane_mm - result.z_mm) if across else s - result.z_mm,
    }
    height = result.indentor.evaluate(np.stack([coordinate[axis] for axis in result.indentor.axes])).height_mm
    return Cut(
        at_rest,
        at_rest + u[[0, -1]][:, nodes],
        np.stack([s, result.touch_height_mm - result.doi_mm + height]),
        result.nodal_pressure_pseudo[nodes],
    )


def press_as_html(result: "IndentationResult") -> str:
    """Return the cut as SVG with a caption and a note on small strain."""
    section = cut(result)
    top = float(section.at_rest[1].max())
    box = _Box(
        section.indentor[0, 0], section.indentor[0, -1], section.pressed[1].min() - _MARGIN_MM, top + _ABOVE_MM
    )
    hanging = box.top - _PRESSURE_MM * section.pressure / max(float(section.pressure.max()), 1e-300)
    body = np.minimum(section.indentor, [[np.inf], [box.top]])
    elements = [
        box.below_top(body, f'fill="{_INDENTOR}" fill-opacity="0.15"'),
        box.below_top(np.stack([section.at_rest[0], hanging]), f'fill="{_PRESSURE}" fill-opacity="0.5"'),
        box.line(section.at_rest, f'fill="none" stroke="{_SKIN}" stroke-opacity="0.3"'),
        box.line(section.pressed, f'fill="none" stroke="{_SKIN}" stroke-width="2"'),
    ]
    pressure = f"highest pressure {result.peak_pressure_kpa:.3g} kPa"
    return box.html(elements, f"{result!r}, {pressure}", result.small_strain.note)


def finger_as_html(section_mm: Array, model: ModelOutline, caption: str) -> str:
    """Return a (2, n) section of the skin in the receptor plane and the receptors, as SVG with a caption."""
    low, high = section_mm.min(axis=1) - _MARGIN_MM, section_mm.max(axis=1) + _MARGIN_MM
    box = _Box(low[0], high[0], low[1], high[1])
    at = model.receptors.position_mm[:, :2].T
    elements = [box.line(section_mm, f'fill="none" stroke="{_SKIN}" stroke-width="2"'), *box.dots(at)]
    return box.html(elements, caption)


class _Box(NamedTuple):
    """Visible rectangle of the plane (mm)."""

    left: float
    right: float
    bottom: float
    top: float

    def line(self, points: Array, style: str) -> str:
        """Return a line through (2, n) points."""
        return f'<polyline points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in self._pixels(points))}" {style}/>'

    def below_top(self, points: Array, style: str) -> str:
        """Return the area between the top and a line through (2, n) points, from left to right."""
        ends = np.array([[points[0, -1], points[0, 0]], [self.top, self.top]])
        return self.line(np.concatenate([points, ends], axis=1), style)

    def dots(self, points: Array) -> list[str]:
        """Return a dot at each of (2, n) points."""
        return [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.5" fill="{_PRESSURE}"/>' for x, y in self._pixels(points)]

    def html(self, elements: Sequence[str], caption: str, note: str = "") -> str:
        """Return the figure with a caption; a note has a line of its own."""
        width, height = _PX_PER_MM * (self.right - self.left), _PX_PER_MM * (self.top - self.bottom)
        size = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.1f} {height:.1f}"'
        below = f"<small>{escape(note)}</small>" if note else ""
        svg = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(elements)}</svg>'
        return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption>{below}</figure>"

    def _pixels(self, points: Array) -> Array:
        """Return (n, 2) pixel positions, y downwards."""
        return _PX_PER_MM * np.stack([points[0] - self.left, self.top - points[1]], axis=1)
