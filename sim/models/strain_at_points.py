"""Strain at any points under presses: by columns for few points, by one solve per press for many."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.config import FingertipConfig
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.measures import MEASURES, Elastic, measures_in_layers, stress_from_strain
from sim.measures.receptors import ReceptorSet, points_below
from sim.models.adjoint import Progress
from sim.models.condensed import Columns, CondensedModel
from sim.models.factored_interior import Interior
from sim.models.result import IndentationResult
from sim.models.sources import HalfWidths, MeshKey, ModelSource
from sim.models.stiffening import refuse_stiffening
from sim.tables import numbers_of
from sim.units import PSEUDO_E_EPIDERMIS

# --- fields ---

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Fields:
    """Strain, stress and measures at points inside one pressed finger, in the shape of the requested points.

    Attributes
    ----------
    points_mm : ndarray of shape (…, 3)
        Undeformed x, y and z (mm).
    strain : ndarray of shape (…, 6)
        Engineering strains e11 e22 e33 e12 e23 e13.
    young_ratio : ndarray of shape (…,)
        Young's modulus over that of the epidermis.
    poisson : float
        Poisson's ratio.

    Notes
    -----
    Stress follows Hooke's law, σ = λ tr(ε) 1 + 2μ ε. The 18 measures are those of Raju (1998, ch. 5): strains,
    stresses, their principal values, mean stress, strain energy density ½ σ:ε, and det σ.

    Examples
    --------
    >>> from sim import load
    >>> finger = load("halfspace")
    >>> points = finger.points_below([-0.5, 0.0, 0.5], 0.76)
    >>> fields = finger.fields(finger.indent("cylinder:9", doi_mm=0.1), points)
    >>> fields.strain.shape, fields.measures["sed"].shape
    ((3, 6), (3,))
    """

    points_mm: Array
    strain: Array
    young_ratio: Array
    poisson: float

    @cached_property
    def stress(self) -> Array:
        """Stresses s11 s22 s33 s12 s23 s13 in pseudo-units, shape (…, 6)."""
        of_unit = stress_from_strain(self.strain, Elastic(PSEUDO_E_EPIDERMIS, self.poisson))
        return self.young_ratio[..., None] * of_unit

    @cached_property
    def measures(self) -> dict[str, Array]:
        """The 18 measures by name, each of shape (…,); tension is positive, stresses are in pseudo-units."""
        found = measures_in_layers(self.strain.reshape(-1, 6), self.young_ratio.ravel(), self.poisson)
        return {name: values.reshape(self.young_ratio.shape) for name, values in found.items()}

    def table(self) -> dict[str, Array]:
        """Return the points and measures as columns, one row for each point.

        Returns
        -------
        dict of str to ndarray
            Columns `x_mm`, `y_mm`, `z_mm` (mm) and the 18 measures, each of shape (n_points,).
        """
        points = dict(zip(("x_mm", "y_mm", "z_mm"), self.points_mm.reshape(-1, 3).T, strict=True))
        return points | {name: self.measures[name].ravel() for name in MEASURES}

    def __repr__(self) -> str:
        return f"<Fields at {self.young_ratio.size} points, SED to {self.measures['sed'].max(initial=0.0):.3g}>"


FEW_POINTS = 40
"""Number of points up to which columns are built, whatever the number of presses; from then on they cost nothing."""

_SETS_KEPT = 4


def mesh_key(result: IndentationResult) -> MeshKey:
    """Return which of a finger's models gave a result."""
    return result.model.patch.axes[:-1], result.model.widened_mm


class Anywhere:
    """Strain at requested points; caches the columns of some sets of points and the factorization of one mesh."""

    def __init__(self, source: ModelSource, poisson: float) -> None:
        self._source = source
        self._poisson = poisson
        self._interiors: dict[MeshKey, Interior | None] = {}
        self._sets: dict[tuple[MeshKey, bytes], Columns] = {}

    def fields(
        self, results: Sequence[IndentationResult], points: Array, progress: Progress | None = None
    ) -> list[Fields]:
        """Return fields at points of shape (…, 3) under presses on one mesh. Raises ReceptorError."""
        flat = points.reshape(-1, 3)
        strain, young = self._strain(mesh_key(results[0]), results, flat, progress)
        shape = points.shape[:-1]
        return [
            Fields(points, per_press.reshape(*shape, 6), young.reshape(shape), self._poisson) for per_press in strain
        ]

    def _strain(
        self, key: MeshKey, results: Sequence[IndentationResult], points: Array, progress: Progress | None
    ) -> tuple[Array, Array]:
        """Return (n_results, n, 6) strains and (n,) E / E(epidermis)."""
        interior = self._interior(key)
        if interior is not None and len(points) > FEW_POINTS and len(results) < 6 * len(points):
            return interior.strain(results, points, progress)
        columns = self._columns(key, points, progress)
        outline = results[0].model
        per_force = columns.per_force(outline.patch_in_skin, outline.patch.axes)
        forces = np.stack([result.state.force.ravel() for result in results])
        return (forces @ per_force.T).reshape(len(results), -1, 6), columns.young_ratio

    def _interior(self, key: MeshKey) -> Interior | None:
        if key not in self._interiors:
            self._interiors = {key: self._source.interior(key)}
        return self._interiors[key]

    def _columns(self, key: MeshKey, points: Array, progress: Progress | None) -> Columns:
        name = key, points.tobytes()
        if name not in self._sets:
            receptors = ReceptorSet(points, np.full(len(points), np.nan))
            interior = self._interior(key)
            solve = None if interior is None else partial(interior.columns, receptors, progress)
            self._sets[name] = self._source.columns(key, receptors, solve)
            self._sets = dict(list(self._sets.items())[-_SETS_KEPT:])
        return self._sets[name]


class StrainAtAnyPoint:
    """Base class of a finger that returns strain at any point."""

    config: FingertipConfig
    surface: FingertipSurface
    _anywhere: Anywhere

    def model_for(self, slopes: tuple[int, ...], patch: HalfWidths | None = None) -> CondensedModel:
        """Return the model that gave a result, for axes of its slopes and half-widths (mm) of the touched skin."""
        raise NotImplementedError

    def points_below(self, x_mm: ArrayLike, depth_mm: ArrayLike, z_mm: ArrayLike | None = None) -> Array:
        """Return points perpendicularly below the pulp's skin.

        Parameters
        ----------
        x_mm : array_like, broadcast
            Lateral positions (mm).
        depth_mm : array_like, broadcast
            Perpendicular depths below the skin (mm).
        z_mm : array_like, broadcast, optional
            Positions along the finger (mm). Default: the receptor plane.

        Returns
        -------
        ndarray of shape (…, 3)
            Undeformed x, y and z (mm).

        Raises
        ------
        ReceptorError
            If there is no tissue at a point; the message has the range that exists.

        Examples
        --------
        >>> from sim import load
        >>> load("halfspace").points_below([0.0, 1.0], 0.76).shape
        (2, 3)
        """
        z = self.config.receptor_plane_mm if z_mm is None else z_mm
        return points_below(self.config, self.surface, x_mm, depth_mm, z)

    @overload
    def fields(
        self, results: IndentationResult, points_mm: ArrayLike, *, progress: Progress | None = None
    ) -> Fields: ...

    @overload
    def fields(
        self, results: Iterable[IndentationResult], points_mm: ArrayLike, *, progress: Progress | None = None
    ) -> list[Fields]: ...

    def fields(
        self,
        results: IndentationResult | Iterable[IndentationResult],
        points_mm: ArrayLike,
        *,
        progress: Progress | None = None,
    ) -> Fields | list[Fields]:
        """Return strain, stress and measures at points inside the undeformed finger, under presses of it.

        New points take a factorization (seconds; 0.6 GB, which stay in memory) and one solve for each press. Few
        points (up to 40) take columns instead, 0.1 s each, which are cached.

        Parameters
        ----------
        results : IndentationResult or iterable of IndentationResult
            Presses of this finger.
        points_mm : array_like of shape (…, 3)
            Undeformed x, y and z of each point (mm).
        progress : callable, optional
            Called as ``progress(done, of)`` with numbers of points.

        Returns
        -------
        Fields or list of Fields
            One for each press; a list if `results` is one.

        Raises
        ------
        ModelRangeError
            If the points are not finite numbers of shape (…, 3), a result is of another finger, or the tissue
            stiffens.
        ReceptorError
            If a point lies outside the tissue.
        """
        refuse_stiffening(self.config.tissue, "fields inside a finger")
        points = numbers_of("points_mm", points_mm)
        if not (points.ndim and points.shape[-1] == 3 and points.size and np.isfinite(points).all()):
            raise ModelRangeError(
                "points_mm: must be (…, 3) finite numbers, x, y and z of each point in mm", "bad_points"
            )
        one = isinstance(results, IndentationResult)
        many = [results] if isinstance(results, IndentationResult) else list(results)
        self._refuse_others(many)
        found: dict[int, Fields] = {}
        for key in {mesh_key(result) for result in many}:
            mine = [k for k, result in enumerate(many) if mesh_key(result) == key]
            found |= zip(mine, self._anywhere.fields([many[k] for k in mine], points, progress), strict=True)
        return found[0] if one else [found[k] for k in range(len(many))]

    def _refuse_others(self, results: Sequence[IndentationResult]) -> None:
        for result in results:
            if not np.array_equal(
                self.model_for(*mesh_key(result)).patch.position_mm, result.model.patch.position_mm
            ):
                raise ModelRangeError(f"{result!r}: must be a press of this finger", "other_finger")
