"""Results of simulated indentations and point loads."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, NamedTuple, NotRequired

import numpy as np
from numpy.typing import NDArray

from rig_shared.outputs import Name, Output, Range, Ratio
from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.patch import X, Z
from sim.contact.points import ContactPose
from sim.contact.profiles import IndentorProfile
from sim.contact.solver import ContactState
from sim.measures.measures import MEASURES
from sim.models.pictures import ModelOutline, ReceptorsJson, press_as_html
from sim.models.small_strain_error import SmallStrain, SmallStrainJson, small_strain
from sim.models.stiffening import LINEAR_TISSUE, Stiffened
from sim.units import GWT_N, PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]


REGION_GAP_MM = 0.3
"""Gap in mm above which contact regions are separate."""

FILTER_SPACING_MM = 0.17
"""Spacing at which the source's 4 × 1 filter takes pressures."""


class LoadingPathJson(Output):
    """Dependence of the result on the loading path."""

    may_depend: bool
    spread: Ratio | None
    others_over_force: list[Ratio]


class PressureProfileJson(Output):
    """Contact pressure in the receptor plane."""

    x_mm: list[float]
    kpa: list[float]


class SolvedJson(Output):
    """Model and solution of its contact."""

    model: Name
    nodes: int
    iterations: int
    kkt_residual: Ratio
    converged: bool
    contact_s: float


class FrictionJson(Output):
    """Friction, and the errors of contact and of Coulomb's law."""

    coefficient: Ratio
    increments: int
    sticking_share: Ratio
    """Share of the normal force that sticking points carry."""
    shear_x_n: float
    shear_z_n: float
    normal_residual: Ratio
    cone_residual: Ratio
    slip_residual: Ratio


class PressJson(Output):
    """A press or a point load; a section's forces are per mm."""

    force_n: float
    force_gwt: float
    doi_mm: float | None
    peak_pressure_kpa: float | None
    small_strain: NotRequired[SmallStrainJson]
    path: NotRequired[LoadingPathJson]
    contact_regions_mm: list[Range]
    pressure: PressureProfileJson
    receptors: ReceptorsJson
    solver: SolvedJson
    friction: NotRequired[FrictionJson]


def _opens_beyond(x_mm: Array, gap_mm: Array, last_mm: float) -> float:
    """Return where contact ends beyond the last loaded node, from two free nodes with gap ∝ distance^1.5."""
    free = int(np.searchsorted(x_mm, last_mm, side="right"))
    if free + 1 >= len(x_mm):
        return last_mm
    near, far = np.cbrt(gap_mm[free : free + 2] ** 2)
    if far <= near:
        return last_mm
    return float(max(last_mm, x_mm[free] - (x_mm[free + 1] - x_mm[free]) * near / (far - near)))


@dataclass(frozen=True, eq=False, repr=False)
class IndentationResult:
    """One simulated indentation.

    A result holds arrays and numbers and no model. It pickles without the finger; strains that were not requested
    before are computed then. Pressures and stresses are in pseudo-units, E(epidermis) = 10 000 (Raju 1998, ch. 3),
    unless a name says kPa or MPa.

    Attributes
    ----------
    indentor : Indentor
        The shape.
    x_mm, z_mm : float
        Position of its reference point across and along the finger (mm).
    doi_mm : float
        Depth of indentation (mm).
    touch_height_mm : float
        Height of the indentor's lowest point at DOI 0 (mm).
    force_n : float
        Vertical force (N); of a section, force per length (N/mm).
    state : ContactState
        Forces and displacements of the skin; `Fingertip.indent` can start from it.
    model : ModelOutline
        Nodes, areas and receptors of the model.
    e_epidermis_mpa : float
        Young's modulus of the epidermis (MPa).
    contact_s : float
        Processor time of the contact solver (s).
    other_forces_n : tuple of float
        Forces at the same depth by finer steps (N), where they were requested and may differ.
    strained : Stiffened
        Correction for tissue that stiffens with strain.

    Examples
    --------
    >>> from sim import load
    >>> result = load("halfspace").indent("cylinder:9", doi_mm=0.1)
    >>> result.doi_mm, len(result.receptor_measures["sed"]), result.may_depend_on_path
    (0.1, 10, False)
    >>> result.contact_regions_mm[0][0] < 0 < result.contact_regions_mm[0][1]
    True
    """

    indentor: Indentor
    x_mm: float
    z_mm: float
    doi_mm: float
    touch_height_mm: float
    force_n: float
    state: ContactState
    model: ModelOutline
    e_epidermis_mpa: float
    contact_s: float
    _strain: Callable[[], Array]  # computed on first access
    other_forces_n: tuple[float, ...] = ()
    strained: Stiffened = LINEAR_TISSUE

    @property
    def force_gwt(self) -> float:
        """Force (gwt; of a section, gwt per mm of its length); 1 gwt is the weight of one gram, 9.80665e-3 N."""
        return self.force_n / GWT_N

    @property
    def may_depend_on_path(self) -> bool:
        """Whether other steps to this depth may end in another equilibrium (`docs/validation/hard_cases.md`)."""
        return self.state.snapped

    def meshed_by(self, config: FingertipConfig) -> FingertipConfig:
        """Return the configuration of the mesh, from that of the finger.

        Parameters
        ----------
        config : FingertipConfig
            The finger's.

        Returns
        -------
        FingertipConfig
            The same, unless friction keeps the mesh of one kind of shape for a model of all.
        """
        return config

    @property
    def path_spread(self) -> float | None:
        """Range of the forces by other paths over the largest force.

        It is 0 where no path can differ, and None where a path may differ and `other_paths` was not requested.
        """
        forces = (self.force_n, *self.other_forces_n)
        if self.may_depend_on_path and len(forces) == 1:
            return None
        return (max(forces) - min(forces)) / max(forces) if max(forces) > 0 else 0.0

    @property
    def small_strain(self) -> SmallStrain:
        """Deviation of this small-strain answer from finite strain, as measured (`docs/small_strain.md`)."""
        stiffening = None if self.strained.linear else self.strained.stiffening
        return small_strain(self.model.kind, self.doi_mm, stiffening, compared=self.model.default_finger)

    @cached_property
    def nodal_pressure_pseudo(self) -> Array:
        """Normal nodal force over tributary undeformed area, shape (n_patch,), in pseudo-units."""
        normal = np.linalg.norm(self.state.force, axis=0)
        return PSEUDO_E_EPIDERMIS * self.strained.force * normal / self.model.patch.area_mm2

    @property
    def contact_area_mm2(self) -> float:
        """Undeformed area of the nodes that carry force (mm²); its error is a ring of nodes around it."""
        carrying = np.linalg.norm(self.state.force, axis=0) > 0
        return float(self.model.patch.area_mm2[carrying].sum())

    @property
    def peak_pressure_mpa(self) -> float:
        """Highest nodal pressure of the contact (MPa)."""
        return self.peak_pressure_pseudo * self.e_epidermis_mpa / PSEUDO_E_EPIDERMIS

    @property
    def peak_pressure_pseudo(self) -> float:
        """Highest nodal pressure of the contact, in pseudo-units."""
        return float(self.nodal_pressure_pseudo.max())

    @property
    def peak_pressure_kpa(self) -> float:
        """Highest nodal pressure of the contact (kPa)."""
        return self.peak_pressure_pseudo * self.kpa_per_pseudo

    @property
    def kpa_per_pseudo(self) -> float:
        """Pressure on this finger (kPa) over that in pseudo-units."""
        return 1e3 * self.e_epidermis_mpa / PSEUDO_E_EPIDERMIS

    @property
    def plane(self) -> slice:
        """Patch nodes in the receptor plane."""
        return self.model.plane

    @property
    def pressure_profile(self) -> tuple[Array, Array]:
        """Undeformed x (mm, ascending) and pressure (pseudo-units) in the receptor plane, each of shape (n_x,)."""
        return self.model.patch.x[self.model.across], self.nodal_pressure_pseudo[self.model.across]

    @property
    def pressure_profile_kpa(self) -> tuple[Array, Array]:
        """Undeformed x (mm, ascending) and pressure (kPa) in the receptor plane, each of shape (n_x,)."""
        x_mm, pseudo = self.pressure_profile
        return x_mm, self.kpa_per_pseudo * pseudo

    @property
    def skin_profile(self) -> tuple[Array, Array]:
        """Deformed x and y (mm) of the skin in the receptor plane, as `pressure_profile` orders them."""
        patch, u = self.model.patch, self.state.displacement[:, self.model.across]
        x = patch.x[self.model.across] + (u[0] if patch.axes[0] == X else 0.0)
        return x, patch.y[self.model.across] + u[-1]

    @property
    def axial_profile(self) -> tuple[Array, Array]:
        """Undeformed z and downward deflection (mm) of the skin along the pad's center line, each of shape (n_z,)."""
        line = self.model.along
        return self.model.patch.position_mm[line, Z], -self.state.displacement[-1][line]

    @cached_property
    def touching_mm(self) -> tuple[Array, Array]:
        """Undeformed (ascending) and deformed x of the places that carry force in the receptor plane (mm).

        For a shape that lies across the finger, all places that carry force.
        """
        patch, held = self.model.patch, self.state.held
        nodes, share = held.on(patch).carriers
        rows = nodes // patch.shape[1]
        here = (rows == self.model.receptor_row).all(axis=0) if patch.axes[0] == X else np.full(len(held), True)
        x = (share * patch.x[nodes]).sum(axis=0)[here]
        moved = x + ((share * self.state.displacement[0][nodes]).sum(axis=0)[here] if patch.axes[0] == X else 0.0)
        order = np.argsort(x)
        return x[order], moved[order]

    @property
    def contact_regions_mm(self) -> list[tuple[float, float]]:
        """Undeformed ends (x0, x1) of each region that carries force in the receptor plane (mm).

        Regions are separate where the free stretch between them is wider than 0.3 mm. Under smooth shapes a region
        ends where the gap opens, between two nodes.

        Notes
        -----
        Near its edge a smooth contact opens as gap ∝ distance^(3/2) (Johnson, *Contact Mechanics*, 1985, ch. 4); the
        edge is where that curve through the first two free nodes is zero.
        """
        touching, _ = self.touching_mm
        if not len(touching):
            return []
        ends = np.flatnonzero(np.diff(touching) > REGION_GAP_MM)
        starts = np.concatenate([[0], ends + 1])
        stops = np.concatenate([ends, [len(touching) - 1]])
        regions = [(float(touching[a]), float(touching[b])) for a, b in zip(starts, stops, strict=True)]
        return regions if self.indentor.sharp else [self._opened(*region) for region in regions]

    def _opened(self, low_mm: float, high_mm: float) -> tuple[float, float]:
        x, gap = self.model.patch.x[self.model.across], self.state.gap[self.model.across]
        return -_opens_beyond(-x[::-1], gap[::-1], -low_mm), _opens_beyond(x, gap, high_mm)

    @cached_property
    def receptor_strain(self) -> Array:
        """Engineering strains e11 e22 e33 e12 e23 e13 at the receptors, shape (n_receptors, 6)."""
        return self._strain()

    @cached_property
    def receptor_measures(self) -> dict[str, Array]:
        """The 18 measures at the receptors by name, each of shape (n_receptors,).

        Tension is positive; stresses are in pseudo-units.
        """
        model = self.model
        return self.strained.measures(model.measures(self.receptor_strain), model.receptor_e, model.poisson)

    def as_json(self) -> PressJson:
        """Return the JSON object of `rig indent --json`, without the build time of the model.

        Returns
        -------
        dict
            Numbers, lists and text; names carry their units.
        """
        x, p = self.pressure_profile_kpa
        return {
            "force_n": self.force_n,
            "force_gwt": self.force_gwt,
            "doi_mm": self.doi_mm,
            "peak_pressure_kpa": self.peak_pressure_kpa,
            "small_strain": self.small_strain.as_json(),
            "path": {
                "may_depend": self.may_depend_on_path,
                "spread": self.path_spread,
                "others_over_force": [other / self.force_n for other in self.other_forces_n],
            },
            "contact_regions_mm": self.contact_regions_mm,
            "pressure": {"x_mm": x.tolist(), "kpa": p.tolist()},
            "receptors": self.model.receptors_as_json(self.receptor_measures),
            "solver": {
                "model": self.model.kind,
                "nodes": self.model.nodes,
                "iterations": self.state.passes,
                "kkt_residual": self.state.residual,
                "converged": self.state.converged,
                "contact_s": self.contact_s,
            },
        }

    def receptor_table(self) -> dict[str, Array]:
        """Return the measures as columns, one row for each receptor.

        Returns
        -------
        dict of str to ndarray
            Columns `x_mm`, `depth_mm` (mm) and the 18 measures, each of shape (n_receptors,).
        """
        return self.model.receptor_columns(self.receptor_measures)

    def __repr__(self) -> str:
        unit = "gwt per mm of length" if self.model.kind == "section" else "gwt"
        name, pressed = type(self).__name__, f"{self.doi_mm:.4g} mm deep, {self.force_gwt:.4g} {unit}"
        pressed += f"{', may depend on its loading path' if self.may_depend_on_path else ''}"
        return f"<{name} {self.indentor.name} at x = {self.x_mm:g}, z = {self.z_mm:g} mm: {pressed}>"

    def _repr_html_(self) -> str:
        return press_as_html(self)

    @property
    def _pose(self) -> ContactPose:
        """Pose of the indentor, to which gaps are measured."""
        at_mm = tuple({X: self.x_mm, Z: self.z_mm}[axis] for axis in self.indentor.axes)
        return ContactPose(self.indentor, at_mm, self.touch_height_mm - self.doi_mm, self.doi_mm)

    def __getstate__(self) -> dict[str, Any]:
        state = {field.name: getattr(self, field.name) for field in fields(self)}
        return state | {"state": _packed(self.state), "_strain": partial(np.array, self.receptor_strain)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        patch, u = self.model.patch, self.state.displacement
        gap = self._pose.gap(patch.tangential_mm + u[:-1], patch.y + u[-1]).height_mm
        self.__dict__["state"] = replace(self.state, force=_unpacked(self.state.force, len(patch)), gap=gap)


def _packed(state: ContactState) -> ContactState:
    """Return the state with the forces of loaded nodes only, preceded by their numbers, and without the gap."""
    bearing = np.flatnonzero(state.force.any(axis=0))
    return replace(state, force=np.concatenate([bearing[None], state.force[:, bearing]]), gap=np.zeros(0))


def _unpacked(force: Array, nodes: int) -> Array:
    """Return (m, n) forces of all nodes."""
    everywhere = np.zeros((len(force) - 1, nodes))
    everywhere[:, force[0].astype(np.int64)] = force[1:]
    return everywhere


# --- point load ---


@dataclass(frozen=True, eq=False, repr=False)
class PointLoadResult:
    """A force on one point of the skin, along its inward normal.

    There is no contact, and no depth is defined.

    Attributes
    ----------
    x_mm, z_mm : float
        Position across and along the finger (mm).
    force_n : float
        Force (N); of a section, force per length (N/mm).
    receptor_strain : ndarray of shape (n_receptors, 6)
        Engineering strains e11 e22 e33 e12 e23 e13.
    model : ModelOutline
        Nodes, areas and receptors of the model.

    Examples
    --------
    >>> from sim import load
    >>> result = load("halfspace").point_load(0.0, 5.0)
    >>> round(result.force_gwt, 6), result.receptor_strain.shape
    (5.0, (10, 6))
    """

    x_mm: float
    z_mm: float
    force_n: float
    receptor_strain: Array
    model: ModelOutline

    @property
    def force_gwt(self) -> float:
        """Force (gwt)."""
        return self.force_n / GWT_N

    @cached_property
    def receptor_measures(self) -> dict[str, Array]:
        """The 18 measures at the receptors by name, each of shape (n_receptors,).

        Tension is positive; stresses are in pseudo-units.
        """
        return self.model.measures(self.receptor_strain)

    def as_json(self) -> PressJson:
        """Return the same keys as for an indentation; keys that a point load lacks are null or empty.

        Returns
        -------
        dict
            Numbers, lists and text; names carry their units.
        """
        return {
            "force_n": self.force_n,
            "force_gwt": self.force_gwt,
            "doi_mm": None,
            "peak_pressure_kpa": None,
            "contact_regions_mm": [],
            "pressure": {"x_mm": [], "kpa": []},
            "receptors": self.model.receptors_as_json(self.receptor_measures),
            "solver": {
                "model": self.model.kind,
                "nodes": self.model.nodes,
                "iterations": 0,
                "kkt_residual": 0.0,
                "converged": True,
                "contact_s": 0.0,
            },
        }

    def receptor_table(self) -> dict[str, Array]:
        """Return the measures as columns, one row for each receptor.

        Returns
        -------
        dict of str to ndarray
            Columns `x_mm`, `depth_mm` (mm) and the 18 measures, each of shape (n_receptors,).
        """
        return self.model.receptor_columns(self.receptor_measures)

    def __repr__(self) -> str:
        return f"<PointLoadResult at x = {self.x_mm:g}, z = {self.z_mm:g} mm: {self.force_gwt:.4g} gwt>"


# --- indentations ---

Table = dict[str, NDArray[Any]]

_NUMBERS = (
    *("doi_mm", "force_n", "force_gwt", "peak_pressure_kpa", "contact_area_mm2"),
    *("contact_s", "path_spread"),
)


class IndentationRequest(NamedTuple):
    """One requested indentation; None where nothing was requested."""

    shape: Indentor | IndentorProfile | str
    x_mm: float
    z_mm: float | None
    doi_mm: float | None
    force_gwt: float | None


class IndentationOutcome(NamedTuple):
    """A result, or the reason why there is none; an indentation that did not converge has both."""

    result: IndentationResult | None
    problem: str = ""
    code: str = ""  # of the problem


@dataclass(frozen=True, repr=False)
class Indentations:
    """Results of many indentations, in the order of the request.

    An item is an IndentationResult, or None where there is no result.

    Attributes
    ----------
    asked : tuple of IndentationRequest
        Shape, position, depth and force of each indentation.
    answers : tuple of IndentationOutcome
        Result or problem of each indentation.

    Examples
    --------
    >>> from sim import indent_many, load
    >>> found = indent_many(load("halfspace"), "cylinder:9", doi_mm=[0.05, 0.1])
    >>> len(found), found.problems, [round(result.doi_mm, 2) for result in found]
    (2, ['', ''], [0.05, 0.1])
    >>> found.table()["doi_mm"].shape
    (2,)
    """

    asked: tuple[IndentationRequest, ...]
    answers: tuple[IndentationOutcome, ...]

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
        """All results, None where there is none; `problems` has the reason."""
        return list(self)

    @property
    def problems(self) -> list[str]:
        """One line for each indentation, empty where there is no problem."""
        return [answer.problem for answer in self.answers]

    def table(self) -> Table:
        """Return one row for each indentation.

        Returns
        -------
        dict of str to ndarray
            Columns of shape (n_indentations,): the request, the results (nan where there is none) and the problem.
            Names carry their units.
        """
        plane = next((result.model.plane_mm for result in self if result is not None), np.nan)
        return {
            "shape": np.array([_name(request.shape) for request in self.asked], dtype=str),
            "x_mm": np.array([request.x_mm for request in self.asked], dtype=float),
            "z_mm": np.array(
                [plane if request.z_mm is None else request.z_mm for request in self.asked], dtype=float
            ),
            "asked_doi_mm": np.array([request.doi_mm for request in self.asked], dtype=float),  # None becomes nan
            "asked_force_gwt": np.array([request.force_gwt for request in self.asked], dtype=float),
            **{name: self._numbers(name) for name in _NUMBERS},
            "regions": np.array([0 if result is None else len(result.contact_regions_mm) for result in self]),
            "residual": np.array([np.nan if result is None else result.state.residual for result in self]),
            "may_depend_on_path": np.array([result is not None and result.may_depend_on_path for result in self]),
            "problem": np.array(self.problems, dtype=str),
        }

    def receptor_table(self) -> Table:
        """Return one row for each receptor under each indentation that has a result.

        Returns
        -------
        dict of str to ndarray
            Columns of shape (n_rows,): `indentation` (its row in `table`), `receptor_x_mm`, `receptor_depth_mm` (mm)
            and the 18 measures.
        """
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


def _name(shape: Indentor | IndentorProfile | str) -> str:
    return shape if isinstance(shape, str) else shape.name
