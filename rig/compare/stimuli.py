"""Stimuli: responses of each receptor to an indentor that steps across the pad, with controls and maps.

A population response is a measure at all receptors for one indentor position; an SSRP is a measure at one receptor
against the indentor's position (Raju 1998, ch. 5). One run gives both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rig.data import Run
from rig.plan.finger_model import PredictedHold, from_copy, responses
from rig.records import SAME_DECIMALS
from rig_shared.natural_order import natural_order
from rig_shared.user_files import sha256_of
from sim.contact.patch import X, Z
from sim.contact.shapes import contents, parse_shape, shape_name
from sim.measures.measures import MEASURES, shown
from sim.models.cache import Arrays, cached_arrays, content_key, simulator_code
from sim.models.default_finger import is_default_finger
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import strain_maps
from sim.models.result import IndentationResult
from sim.units import PSEUDO_E_EPIDERMIS

# Controls: alternatives that a measure must outperform, at the same receptors and positions.
#
# Pressure on the skin above a receptor and the skin's displacement there, the curvature of the indentor above it, and
# the strain that a uniform elastic half-space would have at its depth under the same pressures (Phillips and Johnson,
# J. Neurophysiol. 46, 1204, 1981). A constant rate, the fifth, needs no value.

Array = NDArray[np.float64]

CONTROLS = ("skin pressure", "skin displacement", "indentor curvature", "half-space strain")
CONTROL_UNITS = dict(zip(CONTROLS, ("kPa", "mm", "1/mm", "1"), strict=True))
"""Displacement is downwards, convex curvature positive, the strain the magnitude of the maximum compression."""

_ACROSS_MM = 0.17  # schedule spacing (mm), over which a corner's curvature is averaged
_POISSON = 0.48


def controls(result: IndentationResult) -> Array:
    """Return (4, receptors) controls of one indentation, in the order of `CONTROLS`."""
    x_mm, pressure = result.pressure_profile
    receptors = result.model.receptors
    at_mm = receptors.position_mm[:, X]
    order = np.argsort(x_mm)
    down_mm = -result.state.displacement[-1][result.model.across]
    strain = half_space_strain(x_mm[order], pressure[order], at_mm, receptors.depths_mm)
    return np.array(
        [
            result.kpa_per_pseudo * np.interp(at_mm, x_mm[order], pressure[order]),
            np.interp(at_mm, x_mm[order], down_mm[order]),
            _curvature(result),
            strain,
        ]
    )


def half_space_strain(x_mm: Array, pressure: Array, at_mm: Array, depth_mm: Array) -> Array:
    """Return (k,) maximum compressive strain (magnitude) at x and depth (k,) mm under pressures (n,) at x (n,).

    Plane strain, line loads summed (Johnson, Contact Mechanics, 1985, Eq. 2.17); x ascends; E is the epidermis's 10
    000.
    """
    load = pressure * np.gradient(x_mm)
    s, d = x_mm - at_mm[:, None], depth_mm[:, None]
    radial = -2 * load * d / (np.pi * (s * s + d * d) ** 2)
    sxx, syy, sxy = ((radial * part).sum(axis=1) for part in (s * s, d * d, s * d))
    shear = 2 * (1 + _POISSON) / PSEUDO_E_EPIDERMIS
    middle = (1 + _POISSON) * (1 - 2 * _POISSON) / PSEUDO_E_EPIDERMIS * (sxx + syy) / 2
    return np.asarray(shear / 2 * np.hypot((sxx - syy) / 2, sxy) - middle)


def _curvature(result: IndentationResult) -> Array:
    """Return the (receptors,) curvature of the indentor above each, averaged over `_ACROSS_MM`."""
    receptors = result.model.receptors.position_mm
    place = {X: receptors[:, X] - result.x_mm, Z: receptors[:, Z] - result.z_mm}
    offset = np.array([place[axis] for axis in result.indentor.axes])
    half = np.zeros_like(offset)
    half[0] = _ACROSS_MM / 2
    before, after = (np.arctan(result.indentor.evaluate(offset + side * half).slope[0]) for side in (-1, 1))
    return np.asarray((after - before) / _ACROSS_MM)


FAMILIES = ("step", "bar")
"""Shapes that are compared together."""


@dataclass(frozen=True, eq=False)
class StimulusRow:
    """Indentor pressed to one depth or force at a row of positions.

    Arrays: `x_mm` (n,) ascending, `doi_mm` and `force_gwt` (n,), `measures` (18, n, receptors) in the signs of
    `shown`, `receptor_mm` (receptors,), `skin_mm` (m,) undeformed x in the receptor plane, `pressure` (n, m),
    `regions_mm` (n, k, 2) ends of the contact regions there, NaN-padded.
    `on_fingers` (fingers, 18, n, receptors) are the measures on the design of plausible fingers, if stated;
    `interpolated` if some of these fingers were not built in full. `controls` (4, n, receptors) in the order of
    `CONTROLS`, None if unknown.
    Strains are numbers, stresses pseudo-units, pressures kPa; so is the control of pressure.
    """

    run: str
    indentor: str  # name in the run
    kind: str  # commanded quantity: doi_mm or force_gwt
    commanded: float
    x_mm: Array
    doi_mm: Array
    force_gwt: Array
    measures: Array
    receptor_mm: Array
    skin_mm: Array
    pressure: Array
    regions_mm: Array
    on_fingers: Array | None = None
    interpolated: bool = False
    pressed_with: str | None = None  # the indentor's name with the run's own copy of its file
    controls: Array | None = None
    stiffening: float | None = None  # of the finger; None at small strain
    default_finger: bool = True

    @property
    def read_as(self) -> str:
        """Name from which the indentor can be read."""
        return self.pressed_with or self.indentor

    @property
    def shape(self) -> str:
        """Canonical name of the indentor, "bar:3" for bar:3.0."""
        return shape_name(self.indentor)

    @property
    def family(self) -> str:
        """Kind of indentor, e.g. "step"."""
        return self.indentor.partition(":")[0]

    @property
    def condition(self) -> str:
        """Commanded force or depth, e.g. "2.33 gwt"."""
        return f"{self.commanded:g} " + {"doi_mm": "mm", "force_gwt": "gwt"}[self.kind]

    @property
    def title(self) -> str:
        """Title for captions and tables, e.g. "step:1 at 2.33 gwt"."""
        return f"{self.indentor} at {self.condition}"

    def ssrp(self, measure: str, receptor: int) -> Array:
        """Return (n,) values of a measure at one receptor."""
        return self.measures[MEASURES.index(measure), :, receptor]

    def at(self, position_mm: Array) -> Array:
        """Return measures (18, p, receptors) interpolated at x = position + x_receptor; NaN outside the schedule.

        Positions (p,) mm are the indentor's reference point from the receptive field's center, in the finger's frame.
        """
        return self._interpolated(self.measures, position_mm)

    def controls_at(self, position_mm: Array) -> Array:
        """Return controls (controls, p, receptors) like `at`; empty if unknown."""
        none = np.empty((0, len(self.x_mm), len(self.receptor_mm)))
        return self._interpolated(none if self.controls is None else self.controls, position_mm)

    def on_fingers_at(self, position_mm: Array) -> Array:
        """Return measures (fingers, 18, p, receptors) like `at` on the design, or on this finger alone."""
        return self._interpolated(self.measures[None] if self.on_fingers is None else self.on_fingers, position_mm)

    def _interpolated(self, measures: Array, position_mm: Array) -> Array:
        """Return values (…, p, receptors) of measures (…, n, receptors), interpolated."""
        x = np.asarray(position_mm)[:, None] + self.receptor_mm
        if len(self.x_mm) < 2:
            return np.full((*measures.shape[:-2], *x.shape), np.nan)
        left = np.clip(np.searchsorted(self.x_mm, x, side="right") - 1, 0, len(self.x_mm) - 2)
        part = (x - self.x_mm[left]) / (self.x_mm[left + 1] - self.x_mm[left])
        receptor = np.arange(len(self.receptor_mm))
        value = measures[..., left, receptor] * (1 - part) + measures[..., left + 1, receptor] * part
        inside = (part > -_ROUNDING) & (part < 1 + _ROUNDING)
        return np.where(inside, value, np.nan)

    def contact_regions_mm(self, position: int) -> list[tuple[float, float]]:
        """Return the contact regions [x0, x1] at one position, in undeformed x (mm)."""
        return [(float(a), float(b)) for a, b in self.regions_mm[position] if not np.isnan(a)]


_ROUNDING = 1e-9
_EXACT_DECIMALS = 6
_SAME_PLACE_DECIMALS = 3
_CACHED_AS = 5  # to be raised if the meaning of stored values changes
_PER_POSITION = ("x_mm", "doi_mm", "force_gwt", "measures", "pressure", "controls")


def stimuli(run: Run, finger: Fingertip) -> list[StimulusRow]:
    """Return the stimuli of a run at the last holds, one for each indentor and commanded depth or force.

    Presses at the same position are averaged; contact regions are those of the first. Responses are cached by the
    run's journal, the model and the simulator's code.
    """
    table, _ = cached_arrays(
        responses_key(run, finger), lambda: _table(responses(run, finger, last_only=True)), kind="answers"
    )
    found = _of_table(run, table)
    of_finger: dict[str, Any] = {
        "stiffening": finger.config.tissue.finite_stiffening,
        "default_finger": is_default_finger(finger.config),
    }
    return [replace(one, pressed_with=from_copy(run.folder.path, one.indentor), **of_finger) for one in found]


def pressed(run: Run, receptor_mm: Sequence[float]) -> list[StimulusRow]:
    """Return the stimuli of a run as its journal states them, with responses of zero: nothing is solved.

    They tell which shapes, conditions and positions a run covers.
    """
    starts = {event["index"]: event for event in run.stream("indentation_start")}
    holds = {(event["index"], event["hold"]): event for event in run.stream("hold_start")}
    last = [
        (starts[end["index"]]["indentor"], holds[end["index"], end["hold"]], end)
        for end in run.stream("hold_end")
        if end["index"] in run.done and end["hold"] == starts[end["index"]]["increments"]
    ]
    rows, receptors = len(last), len(receptor_mm)
    table: Arrays = {
        "indentor": np.array([indentor for indentor, *_ in last]),
        "kind": np.array([start["target"] for _, start, _ in last]),
        "commanded": np.array([round(start["commanded"], SAME_DECIMALS) for _, start, _ in last]),
        "x_mm": np.array([end["x_mm"] for *_, end in last]),
        "doi_mm": np.zeros(rows),
        "force_gwt": np.zeros(rows),
        "measures": np.zeros((rows, len(MEASURES), receptors)),
        "pressure": np.zeros((rows, 1)),
        "controls": np.zeros((rows, len(CONTROLS), receptors)),
        "regions_mm": np.full((rows, 1, 2), np.nan),
        "skin_mm": np.zeros(1),
        "receptor_mm": np.array(receptor_mm),
    }
    return _of_table(run, table)


def _of_table(run: Run, table: Arrays) -> list[StimulusRow]:
    if not len(table["x_mm"]):
        return []
    what = list(zip(*(table[name].tolist() for name in ("indentor", "kind", "commanded")), strict=True))
    return [
        _stimulus(run.folder.path.name, one, table, [one == other for other in what])
        for one in sorted(set(what), key=lambda one: (natural_order(one[0]), *one[1:]))
    ]


def _stimulus(run: str, what: tuple[str, str, float], table: Arrays, mine: list[bool]) -> StimulusRow:
    x_mm = np.asarray(table["x_mm"][mine], dtype=float)
    _, first, place = np.unique(x_mm.round(_SAME_PLACE_DECIMALS), return_index=True, return_inverse=True)
    to_mean = (place == np.arange(place.max() + 1)[:, None]) / np.bincount(place)[:, None]

    def merged(name: str) -> Array:
        return np.tensordot(to_mean, np.asarray(table[name][mine], dtype=float), 1)

    x, doi, force, measures, pressure, control = (merged(name) for name in _PER_POSITION)
    receptor, skin = (np.asarray(table[name], dtype=float) for name in ("receptor_mm", "skin_mm"))
    regions = np.asarray(table["regions_mm"][mine][first], dtype=float)
    measures, control = np.moveaxis(measures, 1, 0), np.moveaxis(control, 1, 0)
    return StimulusRow(run, *what, x, doi, force, measures, receptor, skin, pressure, regions, controls=control)


def _table(found: list[PredictedHold]) -> Arrays:
    """Return one row per response; measures (rows, 18, receptors) in the signs of `shown`."""
    if not found:
        return {"x_mm": np.empty(0)}
    results = [response.result for response in found]
    skin_mm, pressure = on_widest_skin([result.pressure_profile_kpa for result in results])
    return {
        "indentor": np.array([response.indentor for response in found]),
        "kind": np.array([response.kind for response in found]),
        "commanded": np.array([round(response.commanded, SAME_DECIMALS) for response in found]),
        "x_mm": np.array([response.hold["x_mm"] for response in found]),
        "doi_mm": np.array([result.doi_mm for result in results]),
        "force_gwt": np.array([result.force_gwt for result in results]),
        "measures": np.array([[shown(name, r.receptor_measures[name]) for name in MEASURES] for r in results]),
        "pressure": pressure,
        "controls": np.array([controls(result) for result in results]),
        "regions_mm": contact_regions(results),
        "skin_mm": skin_mm,
        "receptor_mm": results[0].model.receptors.position_mm[:, 0].round(_EXACT_DECIMALS) + 0.0,
    }


def on_widest_skin(profiles: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return pressure profiles at the skin places of the widest one.

    Indentations far from the center of the pad are solved on a wider patch of skin, whose nodes lie elsewhere.

    Parameters
    ----------
    profiles : sequence of (x_mm, pressure)
        Undeformed x, ascending, and the pressure there, which is zero beyond both ends.

    Returns
    -------
    skin_mm : ndarray, shape (m,)
        Places of the widest profile.
    pressure : ndarray, shape (n, m)
        Linear interpolation of each profile; exact where its places are those of the widest.
    """
    skin_mm, _ = max(profiles, key=lambda profile: float(np.ptp(profile[0])))
    return skin_mm, np.array([np.interp(skin_mm, *profile, left=0.0, right=0.0) for profile in profiles])


def contact_regions(results: Sequence[IndentationResult]) -> Array:
    """Return (n, k, 2) ends in mm, padded with NaN."""
    most = max(len(result.contact_regions_mm) for result in results)
    regions = np.full((len(results), most, 2), np.nan)
    for row, result in zip(regions, results, strict=True):
        row[: len(result.contact_regions_mm)] = np.reshape(result.contact_regions_mm, (-1, 2))
    return regions


def responses_key(run: Run, finger: Fingertip) -> str:
    """Return the cache key for a run's simulated responses."""
    journal = sha256_of(run.folder.events)
    pressed = dict.fromkeys(start["indentor"] for start in run.stream("indentation_start"))
    shapes = contents(from_copy(run.folder.path, indentor) for indentor in pressed)
    return answers_key(finger, [_CACHED_AS, journal, *shapes])


def answers_key(finger: Fingertip, request: object) -> str:
    """Return the cache key of a model's responses, from the finger, its receptors and the simulator's code."""
    receptors = finger.model.receptors
    what = [request, simulator_code(), finger.config.model_dump(mode="json"), finger.e_epidermis_mpa]
    what += [{"friction": finger.friction}] if finger.friction else []
    return content_key([*what, receptors.position_mm.tolist(), receptors.depths_mm.tolist()])


MAPPED = ("sed", "ep1")
_SHOWN_POSITIONS = 3


@dataclass(frozen=True)
class StimulusMap:
    """Deformed section of a stimulus at one position: corners (n + 1, m + 1, 2), receptors (r, 2), values (n, m)."""

    stimulus: StimulusRow
    x_mm: float
    corner_mm: Array
    receptor_mm: Array
    values: dict[str, Array]  # in the signs of `shown`


def stimulus_maps(run: Run, finger: Fingertip, stimuli: Sequence[StimulusRow]) -> list[StimulusMap]:
    """Return maps at three positions of each stimulus, fewer for a shorter schedule; cached like responses."""
    scenes = [(stimulus, k) for stimulus in stimuli for k in _positions(len(stimulus.x_mm))]
    key = content_key(["stimulus maps", *MAPPED, _SHOWN_POSITIONS, responses_key(run, finger)])
    arrays, _ = cached_arrays(key, lambda: _arrays(finger, scenes), kind="answers")
    found = cast(dict[str, Array], arrays)
    return [_from_arrays(stimulus, k, found, n) for n, (stimulus, k) in enumerate(scenes)]


def deepest_map(run: Run, finger: Fingertip) -> StimulusMap | None:
    """Return the map of the deepest press of a run, cached like responses; None without a finished press."""
    found = stimuli(run, finger)
    if not found:
        return None
    stimulus = max(found, key=lambda one: float(np.max(one.doi_mm)))
    k = int(np.argmax(stimulus.doi_mm))
    key = content_key(["deepest map", *MAPPED, responses_key(run, finger)])
    arrays, _ = cached_arrays(key, lambda: _arrays(finger, [(stimulus, k)]), kind="answers")
    return _from_arrays(stimulus, k, cast(dict[str, Array], arrays), 0)


def _from_arrays(stimulus: StimulusRow, k: int, found: dict[str, Array], n: int) -> StimulusMap:
    values = {name: found[f"{name} {n}"] for name in MAPPED}
    return StimulusMap(stimulus, float(stimulus.x_mm[k]), found[f"corner {n}"], found[f"receptor {n}"], values)


def _positions(n: int) -> list[int]:
    """Return the indices a quarter, half and three quarters of the way through a schedule."""
    quarters = np.arange(1, _SHOWN_POSITIONS + 1) / (_SHOWN_POSITIONS + 1)
    return sorted({int(k) for k in np.round(quarters * (n - 1))})


def _arrays(finger: Fingertip, scenes: Sequence[tuple[StimulusRow, int]]) -> Arrays:
    shapes = {name: parse_shape(name) for name in {s.read_as for s, _ in scenes}}
    results = [
        finger.indent(shapes[s.read_as], shapes[s.read_as].lateral_mm(float(s.x_mm[k])), doi_mm=float(s.doi_mm[k]))
        for s, k in scenes
    ]
    maps = strain_maps(finger.config, results) if results else []
    arrays: Arrays = {}
    for n, one in enumerate(maps):  # meshes of different indentors can differ in size
        arrays[f"corner {n}"] = one.moved_mm
        arrays[f"receptor {n}"] = one.carried(finger.model.receptors.position_mm[:, :2])
        arrays |= {f"{name} {n}": shown(name, one.measures[name]) for name in MAPPED}
    return arrays
