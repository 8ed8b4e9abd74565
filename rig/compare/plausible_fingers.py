"""Comparison over plausible fingers: their ranges, their responses, and fits that leave the finger free.

The file is TOML; each key is given the lowest and the highest value that is plausible:

    receptor_depth_mm = [0.70, 0.82]
    [finger.tissue]                     # or finger.geometry, keys as in a configuration
    epidermis_mm = [0.3, 0.5]

A finger file that `rig identify` wrote is accepted too (`docs/identify.md`). SSRPs are computed on a design, every
combination of the lowest, middle and highest value of each parameter, and are interpolated between its fingers.
"""

import hashlib
import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from rig.compare.exceptions import FingersError
from rig.compare.fit import Fit, fit_rates, predicted
from rig.compare.stimuli import StimulusRow
from rig.data import Run
from rig.plan.config import reraised_as
from rig.plan.finger_file import TISSUE, FingerFile, finger_file_of, is_finger_file, refuse_flagged
from rig.settings import Settings
from rig.study.parallel import spread
from rig.study.parameter_study import interpolated, nodes_to_build
from rig_shared.user_files import MOST_TOML_BYTES, read_bytes, toml_of
from sim.config import FingertipConfig
from sim.contact.shapes import contents, parse_shape
from sim.errors import ModelRangeError
from sim.finger.mesh import MeshError
from sim.finger.surface import SurfaceError
from sim.measures.measures import MEASURES, shown
from sim.measures.receptors import ReceptorError
from sim.models.cache import cached_arrays, content_key, simulator_code
from sim.models.fingertip import Fingertip
from sim.models.interpolation import FingerWithReceptors, make_node

Array = NDArray[np.float64]

MOST_FREE = 3
"""Maximum number of parameters with a range; each triples the number of simulated fingers."""

_DEPTH = "receptor_depth_mm"


def _ascending(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"{list(limits)}: must begin with the lowest value")
    return limits


Range = Annotated[tuple[float, float], AfterValidator(_ascending)]


class _Parts(Settings):
    geometry: dict[str, Range] = Field(default_factory=dict)
    tissue: dict[str, Range] = Field(default_factory=dict)


class _File(Settings):
    receptor_depth_mm: Range | None = None
    finger: _Parts = _Parts()

    @property
    def ranges(self) -> dict[str, Range]:
        """Ranges by dotted name, in a fixed order."""
        found = {f"geometry.{key}": limits for key, limits in sorted(self.finger.geometry.items())}
        found |= {f"tissue.{key}": limits for key, limits in sorted(self.finger.tissue.items())}
        return found | ({} if self.receptor_depth_mm is None else {_DEPTH: self.receptor_depth_mm})


@dataclass(frozen=True)
class DesignFinger:
    """Finger with the depth of its receptors, and the parameters in which it differs."""

    config: FingertipConfig
    receptor_depth_mm: float
    name: str


@dataclass(frozen=True)
class PlausibleFingers:
    """Ranges (lowest, highest) of parameters by dotted name, e.g. "tissue.epidermis_mm"."""

    source: str
    ranges: dict[str, Range]
    sha256: str = ""  # of the file

    @property
    def free(self) -> list[str]:
        """Names of the parameters with a range."""
        return [name for name, (low, high) in self.ranges.items() if low < high]

    def values(self, place: Array) -> dict[str, float]:
        """Return every parameter at (free,) coordinates: −1 is the lowest value of a range, 1 the highest."""
        middle = {name: (low + high) / 2 for name, (low, high) in self.ranges.items()}
        half = {name: (self.ranges[name][1] - self.ranges[name][0]) / 2 for name in self.free}
        return middle | {name: middle[name] + half[name] * float(u) for name, u in zip(half, place, strict=True)}

    def design(self, config: FingertipConfig, receptor_depth_mm: float) -> list[DesignFinger]:
        """Return the fingers of `design_places`, equal except for the ranges. Raises FingersError.

        The ranges must contain the finger itself, so that its results can be compared with those of all.
        """
        self._refuse_others_only(config, receptor_depth_mm)
        places = design_places(len(self.free))
        return [self._finger(self.values(place), config, receptor_depth_mm) for place in places]

    def _finger(self, values: dict[str, float], config: FingertipConfig, depth_mm: float) -> DesignFinger:
        tree = config.model_dump(exclude_defaults=True)
        for name, value in values.items():
            table, _, key = name.rpartition(".")
            if table:
                tree[table] = {**tree.get(table, {}), key: value}
        with reraised_as(self.source, FingersError, FingertipConfig):
            changed = FingertipConfig.model_validate(tree)
        named = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        return DesignFinger(changed, values.get(_DEPTH, depth_mm), named)

    def _refuse_others_only(self, config: FingertipConfig, depth_mm: float) -> None:
        for name, (low, high) in self.ranges.items():
            own = depth_mm if name == _DEPTH else _number(config, name, self.source)
            if not low <= own <= high:
                raise FingersError(
                    f"{self.source}: {name}: the range [{low:g}, {high:g}] must contain the value of the run, "
                    f"{own:g}",
                    "without_the_own",
                )


def design_places(free: int) -> Array:
    """Return (3^free, free) coordinates of the design's fingers; the last parameter varies fastest."""
    return places((-1.0, 0.0, 1.0), free)


def places(along: Sequence[float], free: int) -> Array:
    """Return (len(along)^free, free) combinations, the last parameter fastest; one row of no coordinates for none."""
    return np.array(list(itertools.product(along, repeat=free)))


def read_plausible(path: Path) -> PlausibleFingers:
    """Read a file of ranges; raise FingersError if it is invalid."""
    source = f"--fingers {path}"
    with reraised_as(source, FingersError, _File):
        content = read_bytes(path, MOST_TOML_BYTES)
        tables = toml_of(content.decode("utf-8-sig"))
        identified = is_finger_file(tables)
        ranges = {} if identified else _File.model_validate(tables).ranges
    if identified:
        file = finger_file_of(source, tables, path.parent)
        refuse_flagged(source, file.identified, ", or state ranges of your own")
        ranges = _ranges_of(file)
    found = PlausibleFingers(source, ranges, hashlib.sha256(content).hexdigest())
    if not ranges:
        raise FingersError(
            f"{source}: must contain a range in finger.tissue, finger.geometry or {_DEPTH}", "no_range"
        )
    if len(found.free) > MOST_FREE:
        raise FingersError(f"{source}: {len(found.free)} ranges, at most {MOST_FREE} are allowed", "many_ranges")
    return found


def _ranges_of(file: FingerFile) -> dict[str, Range]:
    """Return the ranges of an identified finger's most uncertain parameters.

    Each range holds 90 % of the samples and the maximum-likelihood value.
    """
    own = file.finger.tissue
    values = {name: np.array([getattr(draw, name) for draw in file.identified.draw]) for name in TISSUE}
    spread = {
        name: float(np.ptp(found) / np.abs(found).max()) if found.any() else 0.0 for name, found in values.items()
    }
    widest = sorted((name for name in TISSUE if spread[name]), key=spread.__getitem__, reverse=True)[:MOST_FREE]
    ends = {name: (*np.quantile(values[name], [0.05, 0.95]), getattr(own, name)) for name in sorted(widest)}
    return {f"tissue.{name}": (float(min(each)), float(max(each))) for name, each in ends.items()}


def _number(config: FingertipConfig, name: str, source: str) -> float:
    table, _, key = name.partition(".")
    value = getattr(getattr(config, table), key, None)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise FingersError(
            f"{source}: finger.{name} must be a number in the table finger.{table} of the configuration", "no_number"
        )
    return float(value)


# Fits that leave the finger free: k, ε₀ and the finger's coordinates in its plausible ranges, together.
#
# Each free parameter has one coordinate, −1 at the lowest and 1 at the highest value. SSRPs at a point
# are interpolated between the fingers of the design, quadratically in each parameter.

Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

_STARTS, _STEPS = 3, 12
_DAMPING, _EASED, _RAISED = 1e-2, 0.2, 5.0


class FingerFit(NamedTuple):
    """Best fits of N pairs: coordinates (N, free), k, ε₀ and residual (N,), and the SSRPs (N, p) there."""

    place: Array
    fit: Fit
    eps: Array


def weights(place: Array) -> Array:
    """Return (…, 3^free) weights of the design's fingers at (…, free): Lagrange quadratics through −1, 0 and 1."""
    return _products(_along(place))


def _slopes(place: Array) -> Array:
    """Return (…, free, 3^free) derivatives of the weights."""
    values, slopes = _along(place), np.stack([place - 0.5, -2 * place, place + 0.5], axis=-1)
    free = np.arange(place.shape[-1])
    return np.stack([_products(np.where((free == j)[:, None], slopes, values)) for j in free], axis=-2)


def _along(place: Array) -> Array:
    """Return (…, free, 3) weights of the lowest, middle and highest value of each parameter."""
    return np.stack([place * (place - 1) / 2, 1 - place * place, place * (place + 1) / 2], axis=-1)


def _products(each: Array) -> Array:
    """Return (…, 3^free) products of the parameters' weights (…, free, 3), the last one fastest."""
    one = np.ones((*each.shape[:-2], 1))
    parts = np.moveaxis(each, -2, 0)
    return reduce(lambda a, b: (a[..., :, None] * b[..., None, :]).reshape(*a.shape[:-1], -1), parts, one)


def fit_with_finger(eps: Array, rate: Array, weight: Array | None = None, *, silent: bool = False) -> FingerFit:
    """Return the best k, ε₀ and finger of each pair, for SSRPs (fingers, N, p), rates (p,) and weights (p,).

    `silent` as in `fit_rates`.

    Starts from the best few fingers of the design. Variable projection (Golub and Pereyra 1973): k and ε₀ are exact
    at every point, and the finger takes damped Gauss–Newton steps inside the ranges.
    """
    weight = np.ones_like(rate) if weight is None else weight
    found = fit_rates(eps, rate, weight, silent=silent)
    order = np.argsort(np.where(np.isnan(found.rss), np.inf, found.rss), axis=0, kind="stable")
    at = _Rates(rate, weight, silent)
    ended = [_from(first, found, eps, at) for first in order[:_STARTS]]
    return reduce(lambda a, b: _chosen(b.fit.rss < a.fit.rss, b, a), ended)


class _Rates(NamedTuple):
    """Data of a fit: rates and weights (p,), and whether k > 0 and ε₀ ≥ 0."""

    rate: Array
    weight: Array
    silent: bool

    def line(self, eps: Array) -> Fit:
        """Fit lines to SSRPs (N, p) that rise with the rate."""
        return fit_rates(eps, self.rate, self.weight, sign=1, silent=self.silent)


def _from(first: Ints, found: Fit, eps: Array, rates: _Rates) -> FingerFit:
    """Return the best fit near a finger of the design, for each pair its own (N,); k keeps its sign."""
    pair = np.arange(len(first))
    start = Fit(*(value[first, pair] for value in found))
    sign = np.where(start.k < 0, -1.0, 1.0)
    rising = np.moveaxis(sign[:, None] * eps, 0, 1)
    best = FingerFit(design_places(free_of(eps))[first], _signed(sign, start), rising[pair, first])
    if free_of(eps):
        best = _improved(best, rising, rates)
    return FingerFit(best.place, _signed(sign, best.fit), sign[:, None] * best.eps)


def fit_all_with_finger(eps: Array, rate: Array) -> tuple[Array, Fit]:
    """Return coordinates (18, receptors, free) and fits (18, receptors) of every pair, where it covers positions.

    `eps` is (fingers, 18, p, receptors), `rate` (p,). NaN below three positions.
    """
    place = np.full((eps.shape[1], eps.shape[3], free_of(eps)), np.nan)
    values = np.full((3, eps.shape[1], eps.shape[3]), np.nan)
    for j in range(eps.shape[3]):
        known = ~np.isnan(eps[0, 0, :, j])
        if known.sum() >= 3:
            found = fit_with_finger(eps[:, :, known, j], rate[known])
            place[:, j], values[:, :, j] = found.place, found.fit
    return place, Fit(*values)


def _improved(best: FingerFit, eps: Array, rates: _Rates) -> FingerFit:
    """Improve the fits of SSRPs (N, fingers, p) with k > 0 by damped steps."""
    damping = np.full(len(eps), _DAMPING)
    for _ in range(_STEPS):
        place = np.clip(best.place + _step(best, eps, rates, damping), -1, 1)
        there = np.einsum("nf,nfp->np", weights(place), eps)
        tried = FingerFit(place, rates.line(there), there)
        better = tried.fit.rss < best.fit.rss
        damping *= np.where(better, _EASED, _RAISED)
        best = _chosen(better, tried, best)
    return best


def _chosen(first: Flags, a: FingerFit, b: FingerFit) -> FingerFit:
    fit = Fit(*(np.where(first, x, y) for x, y in zip(a.fit, b.fit, strict=True)))
    rows = first[:, None]
    return FingerFit(np.where(rows, a.place, b.place), fit, np.where(rows, a.eps, b.eps))


def _step(at: FingerFit, eps: Array, data: _Rates, damping: Array) -> Array:
    """Return the (N, free) damped Gauss–Newton step, zero along ranges that end there."""
    rates = predicted(Fit(*(value[:, None] for value in at.fit)), at.eps)
    fires = rates > 0
    jacobian = np.einsum("ndf,nfp->ndp", _slopes(at.place), eps) * np.nan_to_num(at.fit.k)[:, None, None]
    jacobian = _without_line(np.where(fires[:, None], jacobian, 0.0), at.eps, np.where(fires, data.weight, 0.0))
    descent = np.einsum("ndp,np->nd", jacobian, data.weight * (data.rate - np.nan_to_num(rates)))
    blocked = (np.abs(at.place) >= 1) & (at.place * descent > 0)
    jacobian, descent = np.where(blocked[..., None], 0.0, jacobian), np.where(blocked, 0.0, descent)
    curvature = (data.weight * jacobian) @ jacobian.swapaxes(1, 2)
    size = np.maximum(np.trace(curvature, axis1=1, axis2=2), np.finfo(float).tiny ** 0.5)
    damped = curvature + (damping * size)[:, None, None] * np.eye(descent.shape[1])
    return np.linalg.solve(damped, descent[..., None])[..., 0]


def _without_line(jacobian: Array, eps: Array, weight: Array) -> Array:
    """Return the columns (N, free, p) projected orthogonally to 1 and ε, with weights (N, p)."""
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    fires = weight > 0
    centred = np.where(fires, eps - ((weight * eps).sum(axis=1) / total)[:, None], 0.0)
    square = (weight * centred * centred).sum(axis=1)
    unit = centred / np.sqrt(np.where(square > 0, square, 1.0))[:, None]
    mean = (weight[:, None] * jacobian).sum(axis=2, keepdims=True) / total[:, None, None]
    jacobian = np.where(fires[:, None], jacobian - mean, 0.0)
    return jacobian - (jacobian @ (weight * unit)[..., None]) * unit[:, None]


def _signed(sign: Array, fit: Fit) -> Fit:
    return Fit(sign * fit.k, sign * fit.eps0, fit.rss)


def free_of(eps: Array) -> int:
    """Return the number of free parameters of SSRPs (3^free, …) on a design."""
    return round(np.log(len(eps)) / np.log(3))


@dataclass(frozen=True)
class PressRow:
    """One indentor at a row of positions, with a depth or force for each."""

    indentor: str
    kind: str  # doi_mm or force_gwt
    x_mm: tuple[float, ...]
    target: tuple[float, ...]


@dataclass(frozen=True)
class FingerWork:
    """All rows of presses on one finger, solved as one task."""

    name: str
    config_json: str
    receptor_x_mm: tuple[float, ...]
    receptor_depth_mm: float
    press_rows: tuple[PressRow, ...]
    exact: bool = True  # False: interpolated between full builds

    @property
    def finger(self) -> FingerWithReceptors:
        """Finger with its receptors."""
        return FingerWithReceptors.of(self.config_json, self.receptor_x_mm, self.receptor_depth_mm)

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the shapes."""
        return tuple(row.indentor for row in self.press_rows)


def on_plausible_fingers(
    run: Run, pressed: Sequence[StimulusRow], finger: Fingertip, plausible: PlausibleFingers, *, exact: bool = False
) -> list[StimulusRow]:
    """Return the stimuli of a run with their measures on the whole design, solved in parallel processes.

    The controlled quantity stays fixed: force or depth as commanded; on hardware, the force as recorded. Fingers that
    differ only in the moduli of dermis and fat may be interpolated, unless `exact`. Results are cached. Raises
    FingersError.
    """
    if not pressed:
        return []
    virtual = bool(run.start["virtual"])
    press_rows = tuple(_press_row(stimulus, virtual) for stimulus in pressed)
    design = plausible.design(finger.config, finger.model.receptors.depth_mm)
    x_mm = tuple(pressed[0].receptor_mm.tolist())
    work = [_work(one, x_mm, press_rows) for one in design]
    if not exact:
        work = interpolated(work)
    shapes = contents(row.indentor for row in press_rows)
    key = content_key([simulator_code(), [asdict(one) for one in work], *shapes])
    try:
        found, _ = cached_arrays(key, lambda: _all_answers(work), kind="answers")
    except FingersError as error:
        raise FingersError(f"{plausible.source}: {error}", error.code) from None
    between = not all(one.exact for one in work)
    measures = [np.asarray(found[f"{n}"], dtype=float) for n in range(len(pressed))]
    return [replace(s, on_fingers=one, interpolated=between) for s, one in zip(pressed, measures, strict=True)]


def _press_row(stimulus: StimulusRow, virtual: bool) -> PressRow:
    kind = stimulus.kind if virtual else "force_gwt"
    target = stimulus.doi_mm if kind == "doi_mm" else stimulus.force_gwt
    return PressRow(stimulus.read_as, kind, tuple(stimulus.x_mm.tolist()), tuple(target.tolist()))


def _work(finger: DesignFinger, receptor_x_mm: tuple[float, ...], press_rows: tuple[PressRow, ...]) -> FingerWork:
    return FingerWork(
        finger.name, finger.config.model_dump_json(), receptor_x_mm, finger.receptor_depth_mm, press_rows
    )


def _all_answers(work: Sequence[FingerWork]) -> dict[str, NDArray[np.generic]]:
    """Return (fingers, 18, n, receptors) responses for each row, by its number."""
    deque(spread(make_node, nodes_to_build(work)), maxlen=0)
    answers = list(spread(measures_on, work))
    return {f"{n}": np.stack(each) for n, each in enumerate(zip(*answers, strict=True))}


def measures_on(work: FingerWork) -> list[Array]:
    """Return (18, n, receptors) measures for each row, in the signs of `shown`. Raises FingersError."""
    config = FingertipConfig.model_validate_json(work.config_json)
    try:
        places = {"receptor_x_mm": work.receptor_x_mm, "receptor_depth_mm": work.receptor_depth_mm}
        finger = Fingertip.load(config, **places, exact=work.exact)  # type: ignore[arg-type]
        return [_measures(finger, row) for row in work.press_rows]
    except (ModelRangeError, MeshError, SurfaceError, ReceptorError) as error:
        raise FingersError(f"plausible finger with {work.name}: {error}", "not_pressed") from None


def _measures(finger: Fingertip, row: PressRow) -> Array:
    shape = parse_shape(row.indentor)
    results = [
        finger.indent(shape, shape.lateral_mm(x), **{row.kind: target})  # type: ignore[arg-type]
        for x, target in zip(row.x_mm, row.target, strict=True)
    ]
    return np.array([[shown(name, result.receptor_measures[name]) for result in results] for name in MEASURES])
