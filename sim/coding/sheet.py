"""SED at any receptors of the whole finger under pressures over x and z of its skin, normal to the deformed skin.

As in the section (`pressure`), each force without friction is normal to the deformed skin. Here it may lean both
across the finger and along it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import nnls

from sim.coding.bayes import ModelError, Profile, chi2, log_det, size_of
from sim.coding.decoder_results import checked_readings
from sim.coding.operators import ForwardOperator, LeaningOperator
from sim.coding.pressure import Frictionless, SectionSkin
from sim.coding.receptor_readings import Readings
from sim.coding.section import Energy, SkinLine, skin_frames, squared_parts
from sim.config import FingertipConfig
from sim.contact.patch import X, Y, Z
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.measures import Elastic
from sim.measures.receptors import ReceptorSet, points_below
from sim.models.condensed import CondensedModel
from sim.models.sources import OnDisk
from sim.units import PSEUDO_E_EPIDERMIS

# --- skin ---

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PressedSkin:
    """Condensed finger under pressures in pseudo-units on the nodes of its patch, each on its area."""

    config: FingertipConfig
    model: CondensedModel

    @property
    def nodes_mm(self) -> Array:
        """(k, 3) undeformed nodes of the patch (mm)."""
        return self.model.patch.position_mm

    def frames(self, x_mm: Array, z_mm: Array) -> tuple[Array, Array, Array]:
        """Return (3, k) unit vectors at points of the skin: across the finger, outward, along it."""
        across, outward, along = skin_frames(self.model.surface, x_mm, z_mm)
        return across.T, outward.T, along.T

    def parts(self, direction: Array, share: Array, energy: Energy) -> Array:
        """Return (c, m, n) functions whose squares sum to the SED at m receptors under n pressures.

        Each pressure acts on the skin's nodes with (k, n) weights, along (3, k) directions.
        """
        return self.squared(self.strained(direction), share, energy)

    def strained(self, direction: Array) -> Array:
        """Return (6, m, k) strains at receptors under a pressure on each node alone."""
        per_force = self.model.strain_per_force.reshape(-1, 6, *self._force(direction).shape)
        return np.einsum("mcak,ak->cmk", per_force, self._force(direction))

    def squared(self, strained: Array, share: Array, energy: Energy) -> Array:
        """Return (c, m, n) functions whose squares sum to the SED, from the strains by each node alone."""
        unit = Elastic(PSEUDO_E_EPIDERMIS, self.config.tissue.poisson)
        return squared_parts(strained @ share, unit, energy) * np.sqrt(self.model.columns.young_ratio)[:, None]

    def moved(self, direction: Array, share: Array, mixture: Array) -> Array:
        """Return (3, l, n) displacements in mm of (k, l) mixtures of nodes under n pressures; 0 along other axes."""
        return self.mobility(direction, mixture) @ share

    def mobility(self, direction: Array, mixture: Array) -> Array:
        """Return (3, l, k) the same under a pressure on each node alone."""
        patch, force = self.model.patch, self._force(direction)
        axes, there = list(patch.axes), np.flatnonzero(mixture.any(axis=1))
        compliance = patch.compliance.reshape(*force.shape, *force.shape)
        moved = np.zeros((3, mixture.shape[1], len(patch)))
        for axis, rows in zip(axes, compliance, strict=True):
            for rows_by_axis, by_axis in zip(rows[there].swapaxes(0, 1), force, strict=True):
                moved[axis] += mixture[there].T @ rows_by_axis * by_axis
        return moved

    def _force(self, direction: Array) -> Array:
        """Return (a, k) forces of a pressure on each node alone, along the patch's axes."""
        patch = self.model.patch
        return np.asarray(direction[list(patch.axes)] * patch.area_mm2 / PSEUDO_E_EPIDERMIS)


def pressed_skin(
    config: FingertipConfig, points_mm: Array, depth_mm: Array, slopes: tuple[int, ...] = (X, Z)
) -> PressedSkin:
    """Read from the cache, or build (some ten seconds), a finger with receptors at (m, 3) points.

    Its patch is that for indentors that slope along some axes. Raises ReceptorError.
    """
    receptors = ReceptorSet(points_mm, depth_mm)
    source = OnDisk(config, FingertipSurface.fit(config.geometry), receptors)
    model, _ = source.model((slopes, None))
    return PressedSkin(config, model)


SHEET_SPACING_MM = 0.3
"""Spacing of pressures in x and z (mm): SED under a sphere is then accurate to 3 %, to 1 % at 0.2 mm."""

GRID_MM = 2.1
"""Half-width (mm) of the area around the pad center where pressures are estimated, on the patch of the default
finger."""

FEWEST_PLACES = 3  # along x and along z

_ROUNDS = 4  # leaning pressures move the skin
_STEEPEST = 1.0  # a lean by more than 45° is no contact


class Grid(NamedTuple):
    """Equally spaced points over x and z, z varying fastest (mm)."""

    x_mm: Array  # (n_x,) ascending
    z_mm: Array  # (n_z,) ascending

    @property
    def place_mm(self) -> Array:
        """(n_x n_z, 2) x and z (mm)."""
        return np.stack(np.meshgrid(self.x_mm, self.z_mm, indexing="ij"), axis=-1).reshape(-1, 2)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of points along x and along z."""
        return len(self.x_mm), len(self.z_mm)

    def shares(self, x_mm: Array, z_mm: Array) -> Array:
        """Return (k, n_x n_z) bilinear interpolation weights of the grid at k points; zero beyond it."""
        return np.einsum("ki,kj->kij", hats(x_mm, self.x_mm), hats(z_mm, self.z_mm)).reshape(len(x_mm), -1)

    def nearest(self, at_mm: Array, area_mm2: Array, pressure: Array) -> Array:
        """Return (n_x n_z,) nonnegative pressures whose interpolation fits (k,) pressures at (k, 3) nodes best."""
        root = np.sqrt(area_mm2)
        return np.asarray(nnls(self.shares(at_mm[:, X], at_mm[:, Z]) * root[:, None], root * pressure)[0])


def hats(at: Array, knots: Array) -> Array:
    """Return (len(at), n) linear interpolation weights of n equally spaced points; zero beyond them."""
    return np.maximum(0.0, 1 - np.abs(np.subtract.outer(at, knots)) / (knots[1] - knots[0]))


@dataclass(frozen=True)
class SkinOver:
    """Skin around each point of a grid, and its displacement by pressures, in mm and pseudo-units."""

    grid: Grid
    at_rest_mm: Array  # (3, n)
    moved_mm: Array  # (3, n, 3 n) per unit of pressure: normal, then across, then along
    frames: Array  # (n, 3, 3) across, outward, along, of the undeformed skin

    def pressed(self, pressure: Array, lean: Array) -> Array:
        """Return (3, n) the skin under (n,) pressures that lean by (2, n)."""
        return np.asarray(self.at_rest_mm + self.moved_mm @ np.concatenate([pressure, *(lean * pressure)]))

    def lean(self, pressure: Array) -> Array:
        """Return (2, n) force across, and along, / normal force."""
        lean = np.zeros((2, len(pressure)))
        for _ in range(_ROUNDS):
            at = self.pressed(pressure, lean).reshape(3, *self.grid.shape)
            by_x, by_z = (np.asarray(np.gradient(at, axis=k)).reshape(3, -1).T for k in (1, 2))
            across, outward, along = np.einsum("nai,ni->an", self.frames, np.cross(by_z, by_x))
            lean = np.clip(-np.stack([across, along]) / outward, -_STEEPEST, _STEEPEST)
        return lean


@dataclass(frozen=True)
class SheetOperator(LeaningOperator):
    """SED under normal pressures over x and z and the lateral ones that they imply."""

    lateral: Array  # (2, c, m, n) like `parts`, of pressures across and along
    skin: SkinOver

    def per_receptor(self, change: Callable[[Array], Array]) -> ForwardOperator:
        return replace(self, parts=change(self.parts), lateral=np.stack([change(one) for one in self.lateral]))

    def leaning(self, pressure: Array) -> ForwardOperator:
        across, along = self.skin.lean(pressure)
        parts = self.parts + self.lateral[0] * across + self.lateral[1] * along
        return ForwardOperator(self.name, self.energy, parts, self.place_mm, self.receptor_mm)


def sheet_operator(skin_model: PressedSkin, grid: Grid, energy: Energy) -> SheetOperator:
    """Return the operator of pressures on a grid. Raises ModelRangeError for a point off the patch."""
    nodes = skin_model.nodes_mm
    share = grid.shares(nodes[:, X], nodes[:, Z])
    bare = np.flatnonzero(share.sum(axis=0) == 0)
    if len(bare):
        x, z = grid.place_mm[bare[0]]
        raise ModelRangeError(
            f"pressure at x = {float(x):.2f}, z = {float(z):.2f} mm: must lie on the patch of the skin",
            "pressure_beside_patch",
        )
    mixture = share / share.sum(axis=0)
    across, outward, along = skin_model.frames(nodes[:, X], nodes[:, Z])
    directions = (-outward, across, along)
    normal, *lateral = (skin_model.parts(direction, share, energy) for direction in directions)
    moved = np.concatenate([skin_model.moved(direction, share, mixture) for direction in directions], axis=-1)
    frames = np.stack(skin_model.frames(*grid.place_mm.T), axis=0).transpose(2, 0, 1)
    skin = SkinOver(grid, nodes.T @ mixture, moved, frames)
    receptor = skin_model.model.receptors.position_mm[:, [X, Z]]
    return SheetOperator("influence", energy, normal, grid.place_mm, receptor, np.stack(lateral), skin)


# --- axial row ---
#
# A row of receptors also responds to pressures beside its plane, but cannot distinguish them. The decoder returns the
# pressures in the plane, for a given shape along z or the one of several that explains the readings best.

ROW_ERROR = ModelError(share=0.06)
"""Relative model error of SED: between meshes, and of an axial shape that is the same at all x (3 to 6 %)."""


@dataclass(frozen=True)
class AxialShape:
    """Pressure at z / that in the receptor plane: an ellipse about the pad's apex with this half-length."""

    half_length_mm: float
    centre_mm: float

    @property
    def name(self) -> str:
        """Name in results."""
        return f"ellipse:{self.half_length_mm:g}"

    def at(self, z_mm: Array) -> Array:
        """Return (…) pressures / the highest."""
        return np.asarray(np.sqrt(np.maximum(0.0, 1 - ((z_mm - self.centre_mm) / self.half_length_mm) ** 2)))

    def over(self, plane_mm: float, z_mm: Array) -> Array:
        """Return (…) pressures / that in a plane."""
        return np.asarray(self.at(z_mm) / self.at(np.array(plane_mm)))


HALF_LENGTHS_MM = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.3)
"""Half-lengths of the default ellipses (mm)."""


@dataclass(frozen=True)
class ReceptorRow:
    """Finger with a row of receptors in the receptor plane."""

    skin: PressedSkin
    line: SkinLine  # of the skin in that plane
    place_mm: Array  # (m,) locations on it above the receptors

    def under(self, shape: AxialShape, ends_mm: Array, energy: Energy) -> Frictionless:
        """Return the operator of n skin samples between (n + 1,) equally spaced ends, all of one axial shape."""
        (operator,) = self.under_each([shape], ends_mm, energy)
        return operator

    def under_each(self, shapes: Sequence[AxialShape], ends_mm: Array, energy: Energy) -> Iterator[Frictionless]:
        """Return the same for several shapes, which share the response to each node alone."""
        middle, location = 0.5 * (ends_mm[1:] + ends_mm[:-1]), self.line.places(self.skin.nodes_mm[:, X])
        mixture, directions = self._seen(ends_mm), self._directions(location)
        strained = [self.skin.strained(direction) for direction in directions]
        mobility = [self.skin.mobility(direction, mixture)[[X, Y]] for direction in directions]
        at_rest, normal = (self.skin.nodes_mm.T @ mixture)[[X, Y]], self.line.normals(self.line.angles(middle))
        across = hats(location, middle)
        for shape in shapes:
            share = across * shape.over(self.line.plane_mm, self.skin.nodes_mm[:, Z])[:, None]
            parts, lateral = (self.skin.squared(one, share, energy) for one in strained)
            skin = SectionSkin(at_rest, np.concatenate([one @ share for one in mobility], axis=-1), normal)
            yield Frictionless("influence", energy, parts, middle, self.place_mm, lateral, skin)

    def _directions(self, location: Array) -> tuple[Array, Array]:
        """Return (3, k) directions of normal and of lateral pressures on nodes at these locations."""
        x, y = self.line.normals(self.line.angles(location)).T
        return np.stack([-x, -y, np.zeros(len(location))]), np.stack([y, -x, np.zeros(len(location))])

    def _seen(self, ends_mm: Array) -> Array:
        """Return (k, n + 1) interpolation weights of the receptor plane's skin nodes at the samples' ends."""
        across = self.skin.model.patch.shape[1]
        row = self.skin.model.receptor_row * across + np.arange(across)
        location = self.line.places(self.skin.nodes_mm[row, X])
        order = np.argsort(location)
        weights = np.zeros((len(self.skin.nodes_mm), len(ends_mm)))
        weights[row[order]] = np.stack([np.interp(ends_mm, location[order], one) for one in np.eye(across)])
        return weights


def receptor_row(config: FingertipConfig, place_mm: Array, depth_mm: float | Array) -> ReceptorRow:
    """Build a row of receptors below locations in the receptor plane. Raises ModelRangeError and ReceptorError."""
    plane = config.receptor_plane_mm
    line = SkinLine(FingertipSurface.fit(config.geometry), plane, "skin")
    depth = np.broadcast_to(depth_mm, place_mm.shape)
    x_mm = line.below(line.angles(place_mm), depth[:, None])[:, X]
    points = points_below(config, line.surface, x_mm, depth, plane)
    return ReceptorRow(pressed_skin(config, points, depth, (X,)), line, place_mm)


# --- sheet decoder ---
#
# SED is linearized about the current pressures, and readings are whitened by their noise and the model error; the
# maximum-a-posteriori nonnegative pressures then solve a least-squares problem (Lawson and Hanson's), round by round.
# The prior penalizes differences between neighbors along x and z, with the weight λ of the highest Laplace evidence;
# it is also exponential, so that pressures without support by the readings are small.

FEWEST_READINGS = 9

_DECADES = np.arange(1.0, -4.1, -0.5)  # of λ / the data's curvature; from smooth to rough
_LEVEL = 0.1  # weight in the prior of the pressures' squares, relative to their differences
_TYPICAL = 2.0  # mean of the exponential prior / best uniform pressure
_MOST_ROUNDS = 12
_SETTLED = 0.01  # relative L2 change of the pressures
_HALVINGS = 5


def decode_sheet(
    operator: ForwardOperator, readings: Readings, shape: tuple[int, int], error: ModelError | None = None
) -> Profile:
    """Decode (n_x, n_z) pressures, z varying fastest. Raises DecodingError for invalid readings."""
    checked_readings(operator, readings.sed, FEWEST_READINGS)
    root, even = _differences(shape), np.ones(operator.parts.shape[2])
    pressure = even * size_of(operator, readings, even)
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
    misfit = chi2(operator, readings, best.pressure)
    return Profile(best.pressure, np.sqrt(np.diag(covariance)), best.smoothing, misfit, best.converged)


@dataclass(frozen=True)
class _Fit:
    """Maximum-a-posteriori pressures for one λ."""

    pressure: Array
    smoothing: float
    curvature: Array  # (n, n) of the cost
    evidence: float  # Laplace's log evidence of the positive pressures, up to a constant
    converged: bool


@dataclass(frozen=True)
class _Search:
    """Search for pressures that explain readings, given a model error."""

    operator: ForwardOperator
    readings: Readings
    error: ModelError
    rarity: float  # of the exponential prior, per pseudo-unit

    def seen_from(self, pressure: Array) -> tuple[Array, Array, float]:
        """Return (m, n) white slopes, (m,) white residuals (Newton's if silent), and log of their spread."""
        there = self.operator.leaning(pressure)
        sed, slope = there.sed(pressure), there.slope(pressure)
        first, second = self.readings.derivatives(sed)
        lower = cholesky(np.diag(1 / second) + self.error.covariance(self.operator, sed), lower=True)
        white = solve_triangular(lower, np.column_stack([slope, -first / second]), lower=True)
        return white[:, :-1], white[:, -1], float(np.log(np.diag(lower)).sum())

    def fitted(self, smoothing: float, root: Array, start: Array) -> _Fit:
        """Iterate from a start until the pressures converge."""
        pressure, settled, root = start, False, np.sqrt(smoothing) * root
        for _ in range(_MOST_ROUNDS):
            moved = self._step(root, pressure)
            settled = bool(np.linalg.norm(moved - pressure) <= _SETTLED * np.linalg.norm(moved))
            pressure = moved
            if settled:
                break
        slope, _, _ = self.seen_from(pressure)
        penalty = root.T @ root
        curvature = slope.T @ slope + penalty
        free = np.ix_(pressure > 0, pressure > 0)
        evidence = 0.5 * (log_det(penalty[free]) - log_det(curvature[free])) - self._cost(root, pressure)
        return _Fit(pressure, smoothing, curvature, evidence, settled)

    def _step(self, root: Array, pressure: Array) -> Array:
        """Return the linearized optimum, or a shorter step that lowers the cost."""
        slope, left, _ = self.seen_from(pressure)
        factor = cholesky(slope.T @ slope + root.T @ root, lower=True)
        towards = slope.T @ (left + slope @ pressure) - self.rarity
        aim, _ = nnls(factor.T, solve_triangular(factor, towards, lower=True))
        current = self._cost(root, pressure)
        for halving in range(_HALVINGS):
            moved = pressure + 0.5**halving * (aim - pressure)
            if self._cost(root, moved) < current:
                return moved
        return pressure

    def _cost(self, root: Array, pressure: Array) -> float:
        _, left, log_spread = self.seen_from(pressure)
        prior = 0.5 * ((root @ pressure) ** 2).sum() + self.rarity * pressure.sum()
        return float(0.5 * left @ left + log_spread + prior)


def _differences(shape: tuple[int, int]) -> Array:
    """Return rows whose squares are the prior: differences along x and z, and small multiples of the pressures."""
    (n_x, n_z), (along_x, along_z) = shape, (np.diff(np.eye(n), axis=0) for n in shape)
    level = np.sqrt(_LEVEL) * np.eye(n_x * n_z)
    return np.concatenate([np.kron(along_x, np.eye(n_z)), np.kron(np.eye(n_x), along_z), level])
