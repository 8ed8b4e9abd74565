"""SED at any receptors of the whole finger under pressures over x and z of its skin, leaning as the skin does.

As in the section (`frictionless`): without friction each force stands normal to the skin as it lies under all of
them. Here it may lean both across the finger and along it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import nnls

from sim.coding.bayes import ModelError, Profile, decode_profile
from sim.coding.decoding import checked_readings
from sim.coding.operators import ForwardOperator
from sim.coding.pressure import Frictionless, SectionSkin
from sim.coding.readings import Readings
from sim.coding.section import Energy, SkinLine, squared_parts
from sim.config import FingertipConfig
from sim.contact.patch import X, Y, Z
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.measures import Elastic
from sim.measures.receptors import ReceptorSet, points_below
from sim.models.condensed import CondensedModel
from sim.models.sources import OnDisk
from sim.units import PSEUDO_E_EPIDERMIS

# --- felt skin ---
#
# The whole finger with receptors anywhere: how forces on the patch of its skin strain them, and move it.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FeltSkin:
    """A condensed finger; forces are of pressures in pseudo-units that nodes of its patch bear, each on its area."""

    config: FingertipConfig
    model: CondensedModel

    @property
    def nodes_mm(self) -> Array:
        """(k, 3) undeformed."""
        return self.model.patch.position_mm

    def frames(self, x_mm: Array, z_mm: Array) -> tuple[Array, Array, Array]:
        """(3, k) unit vectors at places of the skin: across the finger, outward, along it."""
        surface = self.model.surface
        phi = surface.angle_at(x_mm, z_mm)
        across = -surface.tangents(phi, z_mm)[0]  # φ falls with x
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        outward = surface.normal(phi, z_mm)
        return across.T, outward.T, np.cross(across, outward).T

    def parts(self, direction: Array, share: Array, energy: Energy) -> Array:
        """(c, m, n) squares of the SED at m receptors under n pressures.

        The skin's nodes bear (k, n) shares of each, along (3, k) directions.
        """
        return self.squared(self.strained(direction), share, energy)

    def strained(self, direction: Array) -> Array:
        """(6, m, k) strains at receptors under a pressure on each node alone."""
        per_force = self.model.strain_per_force.reshape(-1, 6, *self._force(direction).shape)
        return np.einsum("mcak,ak->cmk", per_force, self._force(direction))

    def squared(self, strained: Array, share: Array, energy: Energy) -> Array:
        """(c, m, n) squares of the SED from what each node alone does."""
        unit = Elastic(PSEUDO_E_EPIDERMIS, self.config.tissue.poisson)
        return squared_parts(strained @ share, unit, energy) * np.sqrt(self.model.columns.young_ratio)[:, None]

    def moved(self, direction: Array, share: Array, seen: Array) -> Array:
        """(3, l, n) mm by which (k, l) mixtures of nodes move under each of n pressures; 0 along other axes."""
        return self.mobility(direction, seen) @ share

    def mobility(self, direction: Array, seen: Array) -> Array:
        """(3, l, k) the same under a pressure on each node alone."""
        patch, force = self.model.patch, self._force(direction)
        axes, there = list(patch.axes), np.flatnonzero(seen.any(axis=1))
        compliance = patch.compliance.reshape(*force.shape, *force.shape)
        moved = np.zeros((3, seen.shape[1], len(patch)))
        for axis, rows in zip(axes, compliance, strict=True):
            for rows_by_axis, by_axis in zip(rows[there].swapaxes(0, 1), force, strict=True):
                moved[axis] += seen[there].T @ rows_by_axis * by_axis
        return moved

    def _force(self, direction: Array) -> Array:
        """(a, k) of a pressure on each node alone, along the axes that the patch knows."""
        patch = self.model.patch
        return np.asarray(direction[list(patch.axes)] * patch.area_mm2 / PSEUDO_E_EPIDERMIS)


def felt_skin(
    config: FingertipConfig, points_mm: Array, depth_mm: Array, slopes: tuple[int, ...] = (X, Z)
) -> FeltSkin:
    """With receptors at (m, 3) points so far below the skin: from the cache, or built (some ten seconds).

    Its patch is that for indentors that slope along some axes. Raises ReceptorError.
    """
    receptors = ReceptorSet(points_mm, depth_mm)
    source = OnDisk(config, FingertipSurface.fit(config.geometry), receptors, "auto")
    model, _ = source.model((slopes, None))
    return FeltSkin(config, model)


SHEET_SPACING_MM = 0.3
"""Spacing of pressures in x and z (mm): SED under a sphere is then accurate to 3 %, to 1 % at 0.2 mm."""

GRID_MM = 2.1
"""Half-width (mm) of the area around the pad center where pressures are estimated, on the patch of the default
finger."""

FEWEST_PLACES = 3  # along x, and along z

_ROUNDS = 4  # pressures that lean move the skin
_STEEPEST = 1.0  # a lean by more than 45° is no contact


class Grid(NamedTuple):
    """Equally spaced places over x and z, z going fastest; mm."""

    x_mm: Array  # (n_x,) ascending
    z_mm: Array  # (n_z,) ascending

    @property
    def place_mm(self) -> Array:
        """(n_x n_z, 2) x and z."""
        return np.stack(np.meshgrid(self.x_mm, self.z_mm, indexing="ij"), axis=-1).reshape(-1, 2)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of places along x and along z."""
        return len(self.x_mm), len(self.z_mm)

    def shares(self, x_mm: Array, z_mm: Array) -> Array:
        """(k, n_x n_z) of pressures at the places in that at k others: bilinear between them, none beside them."""
        return np.einsum("ki,kj->kij", hats(x_mm, self.x_mm), hats(z_mm, self.z_mm)).reshape(len(x_mm), -1)

    def nearest(self, at_mm: Array, area_mm2: Array, pressure: Array) -> Array:
        """(n_x n_z,) pressures, none below 0, whose straight lines come nearest to (k,) at (k, 3) nodes of skin."""
        root = np.sqrt(area_mm2)
        return np.asarray(nnls(self.shares(at_mm[:, X], at_mm[:, Z]) * root[:, None], root * pressure)[0])


def hats(at: Array, place: Array) -> Array:
    """(len(at), n) shares of n equally spaced places, straight between them; none beside them."""
    return np.maximum(0.0, 1 - np.abs(np.subtract.outer(at, place)) / (place[1] - place[0]))


@dataclass(frozen=True)
class SkinOver:
    """The skin about each place of a grid, and how pressures move it; mm and pseudo-units."""

    grid: Grid
    at_rest_mm: Array  # (3, n)
    moved_mm: Array  # (3, n, 3 n) per pressure: normal ones, then those across, then those along
    frames: Array  # (n, 3, 3) across, outward, along, of the undeformed skin

    def pressed(self, pressure: Array, lean: Array) -> Array:
        """(3, n) where it lies under (n,) pressures that lean by (2, n)."""
        return np.asarray(self.at_rest_mm + self.moved_mm @ np.concatenate([pressure, *(lean * pressure)]))

    def lean(self, pressure: Array) -> Array:
        """(2, n) force across, and along, over the normal one."""
        lean = np.zeros((2, len(pressure)))
        for _ in range(_ROUNDS):
            at = self.pressed(pressure, lean).reshape(3, *self.grid.shape)
            by_x, by_z = (np.asarray(np.gradient(at, axis=k)).reshape(3, -1).T for k in (1, 2))
            across, outward, along = np.einsum("nai,ni->an", self.frames, np.cross(by_z, by_x))
            lean = np.clip(-np.stack([across, along]) / outward, -_STEEPEST, _STEEPEST)
        return lean


@dataclass(frozen=True)
class SheetOperator(ForwardOperator):
    """SED under normal pressures over x and z with all that they bear along the skin."""

    lateral: Array  # (2, c, m, n) beside `parts`, of pressures across and along
    skin: SkinOver

    def per_receptor(self, change: Callable[[Array], Array]) -> ForwardOperator:
        """With what stands for the receptors, the second axis of (c, m, n), changed."""
        return replace(self, parts=change(self.parts), lateral=np.stack([change(one) for one in self.lateral]))

    def leaning(self, pressure: Array) -> ForwardOperator:
        """Quadratic: leans held as they are under these pressures."""
        across, along = self.skin.lean(pressure)
        parts = self.parts + self.lateral[0] * across + self.lateral[1] * along
        return ForwardOperator(self.name, self.energy, parts, self.place_mm, self.receptor_mm)

    def sed(self, pressure: Array) -> Array:
        """(m,) SED under (n,) pressures."""
        return self.leaning(pressure).sed(pressure)

    def slope(self, pressure: Array) -> Array:
        """(m, n) derivatives of the SED, leans held."""
        return self.leaning(pressure).slope(pressure)

    def pulled_back(self, pressure: Array, weight: Array) -> Array:
        """(n,) gradient of Σ weight · SED, leans held."""
        return self.leaning(pressure).pulled_back(pressure, weight)


def sheet_operator(felt: FeltSkin, grid: Grid, energy: Energy) -> SheetOperator:
    """Of pressures at a grid's places. Raises ModelRangeError where one has no node of the patch about it."""
    nodes = felt.nodes_mm
    share = grid.shares(nodes[:, X], nodes[:, Z])
    bare = np.flatnonzero(share.sum(axis=0) == 0)
    if len(bare):
        x, z = grid.place_mm[bare[0]]
        raise ModelRangeError(
            "pressure at x = {x_mm:.2f}, z = {z_mm:.2f} mm: must lie on the patch of the skin",
            code="pressure_beside_patch",
            x_mm=float(x),
            z_mm=float(z),
        )
    seen = share / share.sum(axis=0)
    across, outward, along = felt.frames(nodes[:, X], nodes[:, Z])
    directions = (-outward, across, along)
    normal, *lateral = (felt.parts(direction, share, energy) for direction in directions)
    moved = np.concatenate([felt.moved(direction, share, seen) for direction in directions], axis=-1)
    frames = np.stack(felt.frames(*grid.place_mm.T), axis=0).transpose(2, 0, 1)
    skin = SkinOver(grid, nodes.T @ seen, moved, frames)
    receptor = felt.model.receptors.position_mm[:, [X, Z]]
    return SheetOperator("influence", energy, normal, grid.place_mm, receptor, np.stack(lateral), skin)


# --- axial row ---
#
# Pressures across x at one plane of the whole finger, which vary along z by a shape that is named.
#
# A row of receptors feels what presses beside its plane too, but cannot tell it apart: what it decodes are pressures
# in the plane, under an axial shape that is told, or that of several which explains its readings best.

ROW_ERROR = ModelError(share=0.06)
"""Relative model error of SED: between meshes, and of an axial shape that is the same at all x (3 to 6 %)."""


@dataclass(frozen=True)
class AxialShape:
    """Pressure at z over that in the receptor plane: an ellipse about the pad's apex, of this half-length."""

    half_length_mm: float
    centre_mm: float

    @property
    def name(self) -> str:
        """As it is told."""
        return f"ellipse:{self.half_length_mm:g}"

    def at(self, z_mm: Array) -> Array:
        """(…) over its highest."""
        return np.asarray(np.sqrt(np.maximum(0.0, 1 - ((z_mm - self.centre_mm) / self.half_length_mm) ** 2)))

    def over(self, plane_mm: float, z_mm: Array) -> Array:
        """(…) over what it is in a plane."""
        return np.asarray(self.at(z_mm) / self.at(np.array(plane_mm)))


HALF_LENGTHS_MM = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.3)
"""Half-lengths of the ellipses that are tried by default (mm)."""


@dataclass(frozen=True)
class FeltRow:
    """The finger with a row of receptors in the receptor plane."""

    felt: FeltSkin
    line: SkinLine  # of the skin in that plane
    place_mm: Array  # (m,) along it, above each receptor

    def under(self, shape: AxialShape, ends_mm: Array, energy: Energy) -> Frictionless:
        """SED under pressures on n samples of skin between (n + 1,) equally spaced places, all of one axial shape."""
        (operator,) = self.under_each([shape], ends_mm, energy)
        return operator

    def under_each(self, shapes: Sequence[AxialShape], ends_mm: Array, energy: Energy) -> Iterator[Frictionless]:
        """The same of several shapes: what a node alone does to receptors and skin is the same for them all."""
        middle, place = 0.5 * (ends_mm[1:] + ends_mm[:-1]), self.line.places(self.felt.nodes_mm[:, X])
        seen, directions = self._seen(ends_mm), self._directions(place)
        strained = [self.felt.strained(direction) for direction in directions]
        mobility = [self.felt.mobility(direction, seen)[[X, Y]] for direction in directions]
        at_rest, normal = (self.felt.nodes_mm.T @ seen)[[X, Y]], self.line.normals(self.line.angles(middle))
        across = hats(place, middle)
        for shape in shapes:
            share = across * shape.over(self.line.plane_mm, self.felt.nodes_mm[:, Z])[:, None]
            parts, lateral = (self.felt.squared(one, share, energy) for one in strained)
            skin = SectionSkin(at_rest, np.concatenate([one @ share for one in mobility], axis=-1), normal)
            yield Frictionless("influence", energy, parts, middle, self.place_mm, lateral, skin)

    def _directions(self, place: Array) -> tuple[Array, Array]:
        """(3, k) of normal and of lateral pressures on nodes at these places."""
        x, y = self.line.normals(self.line.angles(place)).T
        return np.stack([-x, -y, np.zeros(len(place))]), np.stack([y, -x, np.zeros(len(place))])

    def _seen(self, ends_mm: Array) -> Array:
        """(k, n + 1) shares of the skin's nodes, those of the receptor plane, in the samples' ends."""
        across = self.felt.model.patch.shape[1]
        row = self.felt.model.receptor_row * across + np.arange(across)
        place = self.line.places(self.felt.nodes_mm[row, X])
        order = np.argsort(place)
        seen = np.zeros((len(self.felt.nodes_mm), len(ends_mm)))
        seen[row[order]] = np.stack([np.interp(ends_mm, place[order], one) for one in np.eye(across)])
        return seen


class DecodedRow(NamedTuple):
    """Pressures, and under which axial shape."""

    shape: AxialShape
    operator: Frictionless
    profile: Profile


def decode_row(
    row: FeltRow, shapes: Sequence[AxialShape], ends_mm: Array, readings: Readings, error: ModelError = ROW_ERROR
) -> DecodedRow:
    """By the shape that explains the readings best; SED `finite`. Raises DecodingError."""
    tried = list(zip(shapes, row.under_each(shapes, ends_mm, "finite"), strict=True))
    shape, operator = min(tried, key=lambda one: quick_misfit(one[1], readings, error))
    return DecodedRow(shape, operator, decode_profile(operator, readings, error))


def quick_misfit(operator: ForwardOperator, readings: Readings, error: ModelError) -> float:
    """How badly pressures explain readings, by the search alone: a table takes longer than all the rest."""
    return decode_profile(operator, readings, error, table=False).misfit


def felt_row(config: FingertipConfig, place_mm: Array, depth_mm: float | Array) -> FeltRow:
    """Receptors so far below places of the skin in the receptor plane. Raises ModelRangeError and ReceptorError."""
    plane = config.receptor_plane_mm
    line = SkinLine(FingertipSurface.fit(config.geometry), plane, "skin")
    depth = np.broadcast_to(depth_mm, place_mm.shape)
    x_mm = line.below(line.angles(place_mm), depth[:, None])[:, X]
    points = points_below(config, line.surface, x_mm, depth, plane)
    return FeltRow(felt_skin(config, points, depth, (X,)), line, place_mm)


# --- sheet decoder ---
#
# Pressures over x and z from a noisy sheet of receptors: not negative, smooth by the evidence, with a band.
#
# SED is made linear about the pressures found so far, and readings are whitened by their noise and the model's error;
# the likeliest pressures that are not negative are then those of a least-squares problem (Lawson and Hanson's), round
# by round. The prior is of differences between neighbours along x and along z, its weight λ where Laplace's evidence
# is highest; and exponential, so that little is borne where nothing says that more is.

FEWEST_READINGS = 9

_DECADES = np.arange(1.0, -4.1, -0.5)  # of λ, over the data's own curvature; from smooth to rough
_LEVEL = 0.1  # of the prior: the pressures' own squares beside their differences
_TYPICAL = 2.0  # mean of the exponential prior, over the even pressure that explains the readings best
_MOST_ROUNDS = 12
_SETTLED = 0.01  # of the pressures, in relative L2
_HALVINGS = 5
_DEAF = 1e-6  # least weight of a reading, over that of one that is not silent


def decode_sheet(
    operator: ForwardOperator, readings: Readings, shape: tuple[int, int], error: ModelError | None = None
) -> Profile:
    """Of (n_x, n_z) pressures, z going fastest. Raises DecodingError for readings that cannot be meant."""
    checked_readings(operator, readings.sed, FEWEST_READINGS)
    root, pressure = _differences(shape), _even(operator, readings)
    rarity = 1 / (_TYPICAL * float(pressure[0]))
    search = _Search(operator, readings, ModelError() if error is None else error, rarity)
    slope, _, _ = search.seen_from(pressure)
    scale = (slope**2).sum() / (root**2).sum()
    fits: list[_Fit] = []
    for smoothing in (scale * 10**_DECADES).tolist():
        fits.append(search.fitted(smoothing, root, pressure))
        pressure = fits[-1].pressure if fits[-1].pressure.any() else pressure
    best = max(fits, key=lambda fit: fit.evidence)
    covariance = cho_solve(cho_factor(best.curvature), np.eye(len(pressure)))
    left = (operator.sed(best.pressure) - readings.sed) / readings.sd
    misfit = float((left[~readings.silent] ** 2).sum())
    return Profile(best.pressure, np.sqrt(np.diag(covariance)), best.smoothing, misfit, best.converged)


@dataclass(frozen=True)
class _Fit:
    """The likeliest pressures of one λ."""

    pressure: Array
    smoothing: float
    curvature: Array  # (n, n) of the cost
    evidence: float  # log, by Laplace, of the pressures above 0; but for what is the same for all
    converged: bool


@dataclass(frozen=True)
class _Search:
    """Pressures that explain readings, by an operator that is wrong by so much."""

    operator: ForwardOperator
    readings: Readings
    error: ModelError
    rarity: float  # of the exponential prior, per pseudo-unit

    def seen_from(self, pressure: Array) -> tuple[Array, Array, float]:
        """(m, n) white slopes, (m,) what is left of the readings (of silent ones Newton's), log of their spread."""
        there = self.operator.leaning(pressure)
        sed, slope = there.sed(pressure), there.slope(pressure)
        _, first, second = self.readings.cost(sed)
        second = np.maximum(second, _DEAF / self.readings.sd**2)
        at = self.operator.receptor_mm
        apart = np.linalg.norm(at[:, None] - at, axis=-1) / self.error.length_mm
        wrong = self.error.share**2 * np.outer(sed, sed) * np.exp(-0.5 * apart**2)
        lower = cholesky(np.diag(1 / second) + wrong, lower=True)
        white = solve_triangular(lower, np.column_stack([slope, -first / second]), lower=True)
        return white[:, :-1], white[:, -1], float(np.log(np.diag(lower)).sum())

    def fitted(self, smoothing: float, root: Array, start: Array) -> _Fit:
        """From a start, round by round until it stays."""
        pressure, still, root = start, False, np.sqrt(smoothing) * root
        for _ in range(_MOST_ROUNDS):
            moved = self._step(root, pressure)
            still = bool(np.linalg.norm(moved - pressure) <= _SETTLED * np.linalg.norm(moved))
            pressure = moved
            if still:
                break
        slope, _, _ = self.seen_from(pressure)
        penalty = root.T @ root
        curvature = slope.T @ slope + penalty
        free = np.ix_(pressure > 0, pressure > 0)
        evidence = 0.5 * (_log_det(penalty[free]) - _log_det(curvature[free])) - self._cost(root, pressure)
        return _Fit(pressure, smoothing, curvature, evidence, still)

    def _step(self, root: Array, pressure: Array) -> Array:
        """To the likeliest pressures as seen from these, or so much of the way that the cost falls."""
        slope, left, _ = self.seen_from(pressure)
        factor = cholesky(slope.T @ slope + root.T @ root, lower=True)
        towards = slope.T @ (left + slope @ pressure) - self.rarity
        aim, _ = nnls(factor.T, solve_triangular(factor, towards, lower=True))
        now = self._cost(root, pressure)
        for halving in range(_HALVINGS):
            moved = pressure + 0.5**halving * (aim - pressure)
            if self._cost(root, moved) < now:
                return moved
        return pressure

    def _cost(self, root: Array, pressure: Array) -> float:
        _, left, log_spread = self.seen_from(pressure)
        prior = 0.5 * ((root @ pressure) ** 2).sum() + self.rarity * pressure.sum()
        return float(0.5 * left @ left + log_spread + prior)


def _differences(shape: tuple[int, int]) -> Array:
    """Rows whose squares are the prior: differences along x and along z, and a little of the pressures themselves."""
    (n_x, n_z), (along_x, along_z) = shape, (np.diff(np.eye(n), axis=0) for n in shape)
    level = np.sqrt(_LEVEL) * np.eye(n_x * n_z)
    return np.concatenate([np.kron(along_x, np.eye(n_z)), np.kron(np.eye(n_x), along_z), level])


def _even(operator: ForwardOperator, readings: Readings) -> Array:
    """An even pressure of the readings' size."""
    even = np.ones(operator.parts.shape[2])
    sed = operator.sed(even)
    return even * float(np.sqrt(max(readings.sed @ sed, readings.sd * sed.max()) / (sed @ sed)))


def _log_det(matrix: Array) -> float:
    return 2 * float(np.log(np.diag(cholesky(matrix))).sum()) if len(matrix) else 0.0
