"""Spikes of simulated afferents during a run, from the positions, times and contact heights in its journal.

The indentor is where the journal knows it, and moves between these places as the stage does. The depth under it gives
the measures at every receptor, from presses of the finger at the same place. One record covers the whole run, so that
a response depends on the presses before it.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.data.run import Run
from rig.data.spike_files import SpikeRecord, SpikeTrain
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.finger_model import from_copy
from rig.plan.plan import Plan
from rig.units import GWT_N
from sim.contact.patch import Z
from sim.contact.shapes import parse_shape
from sim.models.fingertip import Fingertip
from sim.nerve.firing_speed import LEAST_MM_S, MOST_MM_S, firing_speed_mm_s
from sim.nerve.integrator import MOST_STEP_S
from sim.nerve.models import AfferentModel
from sim.nerve.population import (
    DENSITY_PER_CM2,
    PATH_M,
    Afferent,
    AfferentPopulation,
    Pad,
    draw,
    parse_afferents,
    population,
)
from sim.nerve.skin import SkinUnderIndentor, table_of_presses
from sim.nerve.spike_stream import SpikeStream
from sim.nerve.staircase import Staircase

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

PIECE_S = 20.0
"""Duration for which spikes are computed at once (s). It bounds the memory, whatever the run's duration."""
_FAMILIES = ("precondition_", "reference_", "find_")
_LEAST_MM = 0.01
_AFTER_S = 1.0  # after a run, in which afferents may still fire
_PLACE_DECIMALS = 4


class Knot(NamedTuple):
    """Known position: time, height above the nominal apex, force, and the speed of the move to it."""

    t_s: float
    height_mm: float
    force_gwt: float
    speed_mm_s: float


@dataclass(frozen=True)
class SpikeRequest:
    """Request for spikes: afferents as text, the seed, and the length of the nerve to the electrode (m)."""

    afferents: str
    seed: int = 0
    path_m: float = PATH_M

    def refuse(self) -> None:
        """Raise ModelRangeError for afferents that cannot be read, without a finger."""
        if self.afferents not in DENSITY_PER_CM2:
            parse_afferents(self.afferents)

    def drawn(self, finger: Fingertip) -> AfferentPopulation:
        """Return the afferents of a finger. Raises ModelRangeError."""
        if self.afferents in DENSITY_PER_CM2:
            return population(finger, self.afferents, self.seed)
        return draw(finger, self.afferents, self.seed)


@dataclass(frozen=True)
class Visit:
    """Time over one place of the finger, with depths past first touch on the run's clock."""

    indentor: str
    x_mm: float
    along_mm: float
    path: Staircase

    @property
    def place(self) -> tuple[str, float, float]:
        """Indentor and rounded position, which presses at one place share."""
        return self.indentor, round(self.x_mm, _PLACE_DECIMALS), round(self.along_mm, _PLACE_DECIMALS)


@dataclass(frozen=True)
class Visits:
    """Visits of a run, and the number of those that touched the finger without a contact height."""

    visits: tuple[Visit, ...]
    left_out: int


def visits_of(run: Run, config: Config) -> Visits:
    """Return the visits of a run in order.

    Raises BadInputError if the run never came near a finger, or never measured a contact height.
    """
    walk = _Walk(config)
    for stream, event in run.in_order:
        walk.see(stream, event)
    walk.close()
    if not walk.found:
        code, what = (
            ("no_contact_heights", "measured no contact height")
            if walk.left_out
            else ("no_presses", "contains no press")
        )
        raise BadInputError(
            f"run folder {run.folder.path}: this run {what}; spikes need a run with a touch and a press", code
        )
    return Visits(tuple(walk.found), walk.left_out)


class _Walk:
    """Walk through the journal that collects the known positions of each visit."""

    def __init__(self, config: Config) -> None:
        self.found: list[Visit] = []
        self.left_out = 0
        habits = config.habits
        self._clearance_mm, self._travel_mm_s = habits.clearance_mm, habits.travel_speed_mm_s
        self._press_mm_s, self._approach_mm_s = habits.press_speed_mm_s, habits.approach_speed_mm_s
        self._acceleration_mm_s2 = config.stage.acceleration_mm_s2
        self._compliance_mm_gwt = config.calibration.value("compliance_mm_per_n", 0.0) * GWT_N
        self._touch_gwt = habits.touch_force_gwt
        self._stays = config.limits.on_trip == "stop"
        self._indentor = ""
        self._x_mm, self._along_mm = math.nan, 0.0
        self._knots: list[Knot] = []
        self._contact_mm: float | None = None
        self._bias_mm: list[float] = []
        self._true_x_mm: float | None = None

    def see(self, stream: str, event: dict[str, Any]) -> None:
        """Take one event."""
        name = next((stream.removeprefix(one) for one in _FAMILIES if stream.startswith(one)), stream)
        t_s = float(event["t_s"])
        if "indentor" in event:
            if name == "mount":
                self.close()
            self._indentor = str(event["indentor"])
        elif name == "sample":
            self._sample(t_s, event)
        elif name == "move":
            self.close()
            self._x_mm, self._along_mm = float(event["x_mm"]), float(event.get("along_mm") or 0.0)
            self._knots = [Knot(t_s, float(event["height_mm"]), 0.0, self._travel_mm_s)]
        elif name == "touch":
            self._contact_mm = float(event["contact_height_mm"])
            if event.get("true_doi_bias_mm") is not None:
                self._bias_mm = [float(event["true_doi_bias_mm"])]
        elif name == "hold_end" and event.get("true_doi_mm") is not None:
            self._bias_mm.append(float(event["true_doi_mm"]) - float(event["doi_mm"]))
            self._true_x_mm = float(event["true_x_mm"])
        elif name == "retract":
            self._add(Knot(t_s, float(event["height_mm"]), 0.0, self._travel_mm_s))
            self.close()
        elif name == "trip":
            if not self._stays:
                self._add(Knot(t_s, self._clearance_mm, 0.0, self._travel_mm_s))
            self.close()
        elif name == "home":
            self.close()

    def _sample(self, t_s: float, event: dict[str, Any]) -> None:
        if event.get("height_mm") is None or event.get("x_mm") is None:
            return
        if not math.isclose(event["x_mm"], self._x_mm, abs_tol=1e-6):
            self.close()
            self._knots = []
            self._x_mm = float(event["x_mm"])
        press = event["phase"] in ("press", "hold", "compliance")
        speed_mm_s = self._press_mm_s if press else self._approach_mm_s
        self._add(Knot(t_s, float(event["height_mm"]), float(event["force_gwt"]), speed_mm_s))

    def _add(self, knot: Knot) -> None:
        if self._knots and knot.t_s <= self._knots[-1].t_s:
            self._knots.pop()
        self._knots.append(knot)

    def close(self) -> None:
        """End the visit; the indentor stays where it is."""
        knots, contact_mm = self._knots, self._contact_mm
        touched = any(knot.force_gwt >= self._touch_gwt for knot in knots)
        if contact_mm is None or len(knots) < 2:
            self.left_out += touched
        else:
            bias = fmean(self._bias_mm) if self._bias_mm else 0.0
            t = [knot.t_s for knot in knots]
            depth = [contact_mm - knot.height_mm - self._compliance_mm_gwt * knot.force_gwt + bias for knot in knots]
            speed = [knot.speed_mm_s for knot in knots]
            if depth[-1] > 0:  # the journal does not know how it was lifted
                t, depth = [*t, t[-1] + 2 * depth[-1] / self._travel_mm_s + 0.5], [*depth, -_LEAST_MM]
                speed = [*speed, self._travel_mm_s]
            if max(depth) > 0:
                x_mm = self._x_mm if self._true_x_mm is None else self._true_x_mm
                path = Staircase(t, depth, speed, self._acceleration_mm_s2)
                self.found.append(Visit(self._indentor, x_mm, self._along_mm, path))
        self._knots = knots[-1:]
        self._contact_mm, self._bias_mm, self._true_x_mm = None, [], None


class PressAtSpeed(NamedTuple):
    """Press of a plan or of a run, with the shape as it is read."""

    shape: str
    x_mm: float
    along_mm: float
    doi_mm: float
    speed_mm_s: float


@dataclass(frozen=True)
class FiringSpeed:
    """Slowest press at which the most sensitive afferent of a class fires, wherever it lies under the indentor."""

    model: str
    afferents: int
    sensitivity: float
    slowest_mm_s: float | None
    doi_mm: float
    fastest_mm_s: float

    @property
    def silent(self) -> bool:
        """Whether the presses are too slow or too shallow."""
        return self.slowest_mm_s is None or self.slowest_mm_s > self.fastest_mm_s

    @property
    def sentence(self) -> str:
        """Summary in one line."""
        who = f"{self.model}: the most sensitive of {self.afferents}, under the deepest press ({self.doi_mm:.2g} mm),"
        if self.slowest_mm_s is None:
            return f"{who} stays silent even at {MOST_MM_S:g} mm/s"
        slow = " or less" if self.slowest_mm_s <= LEAST_MM_S else ""
        silent = ", so that no press makes it fire, at most a lift" if self.silent else ""
        return (
            f"{who} fires from {self.slowest_mm_s:.2g} mm/s{slow}; the fastest press has {self.fastest_mm_s:.2g} mm/s"
            f"{silent}"
        )


_OFFSETS_MM = np.arange(-2.0, 2.01, 0.25)
"""Places beside the middle of the indentor, whose edges strain the skin most."""


def firing_speeds(
    finger: Fingertip, afferents: AfferentPopulation, presses: Sequence[PressAtSpeed]
) -> list[FiringSpeed]:
    """Return the slowest press at which each class fires, at the place of the deepest press.

    Raises ModelRangeError if the finger model cannot press that deep.
    """
    press = max(presses, key=lambda one: (one.doi_mm, -abs(one.x_mm)))
    fastest_mm_s = max(one.speed_mm_s for one in presses)
    shape, pad = parse_shape(press.shape), Pad.of(finger)
    z_mm = finger.config.receptor_plane_mm + press.along_mm if press.along_mm and Z in shape.axes else None
    table = table_of_presses(finger, press.shape, press.doi_mm, shape.lateral_mm(press.x_mm), z_mm)
    found = []
    for name, numbers in afferents.groups.items():
        best = max((afferents[k] for k in numbers), key=lambda one: one.sensitivity)
        under = [
            replace(best, x_mm=float(x), along_mm=press.along_mm, organs_mm=((0.0, 0.0),))
            for x in press.x_mm + _OFFSETS_MM
            if pad.has(x, press.along_mm)
        ]
        tried = AfferentPopulation(under or [best], afferents.models)
        fields = finger.fields(table, tried.points_mm(finger))
        values = np.array([tried.measure(one.measures) for one in fields])
        highest = values[:, [int(values[-1].argmax())]]
        skin = SkinUnderIndentor.of_values([one.doi_mm for one in table], highest)
        slowest = firing_speed_mm_s(afferents.models[name], best.sensitivity, skin, press.doi_mm)
        found.append(FiringSpeed(name, len(numbers), best.sensitivity, slowest, press.doi_mm, fastest_mm_s))
    return found


def firing_speeds_of(finger: Fingertip, wanted: SpikeRequest, presses: Sequence[PressAtSpeed]) -> list[FiringSpeed]:
    """Return the slowest press at which each class of the requested afferents fires. Raises ModelRangeError."""
    return firing_speeds(finger, wanted.drawn(finger), presses)


def presses_of_plan(plan: Plan) -> list[PressAtSpeed]:
    """Return the presses of a plan at their speeds."""
    ramps = [(press.ramp_mm_s, press) for press in plan.all_presses if press.ramp_mm_s is not None]
    return [
        PressAtSpeed(press.indentor, press.x_mm, 0.0, press.predicted_doi_mm, speed_mm_s)
        for speed_mm_s, press in [*plan.speeds_mm_s, *ramps]
    ]


def presses_of_visits(run: Run, found: Visits) -> list[PressAtSpeed]:
    """Return the deepest press of each visit of a run, with the speed of its fastest move into the skin."""
    return [
        PressAtSpeed(
            from_copy(run.folder.path, one.indentor),
            one.x_mm,
            one.along_mm,
            one.path.deepest_mm,
            one.path.fastest_in_contact_mm_s,
        )
        for one in found.visits
    ]


class MeasureTable(NamedTuple):
    """Measures at the end organs of all afferents against the depth over one place."""

    depths_mm: Array
    values: Array  # (n_depths, n_organs of all afferents)


def run_spikes(
    run: Run,
    found: Visits,
    finger: Fingertip,
    afferents: AfferentPopulation,
    *,
    seed: int = 0,
    path_m: float = PATH_M,
    step_s: float = MOST_STEP_S,
    show_progress: Progress = lambda done, of: None,
) -> SpikeRecord:
    """Return the spikes of a population during a run, on the run's clock, at an electrode `path_m` up the nerve.

    `finger` is that of the run's configuration; `show_progress(done, of)` gets numbers of places and then of pieces
    of the run. Raises ModelRangeError if the finger model cannot press that deep at a place, or is of tissue that
    stiffens.
    """
    tables = tables_of(run, found, finger, afferents, show_progress)
    pieces = list(_pieces(run.end_s, step_s))
    spikes: list[list[Array]] = [[] for _ in afferents]
    streams = [stream_of(afferents.models[one.model], [one], step_s) for one in afferents]
    for number, (begin, end) in enumerate(pieces):
        show_progress(number, len(pieces))
        depths = _depths(found, begin, end, step_s)
        for k, (stream, organs) in enumerate(zip(streams, afferents.organs, strict=True)):
            value = np.zeros((1, len(organs), end - begin))
            for place, at, depth in depths:
                table = tables[place]
                skin = SkinUnderIndentor.of_values(table.depths_mm, table.values[:, organs])
                value[0, :, at : at + len(depth)] = skin.value(np.clip(depth, 0.0, table.depths_mm[-1])).T
            spikes[k].append(stream.advance(value)[1])
    show_progress(len(pieces), len(pieces))
    trains = [
        _train(afferent, afferents.models[afferent.model].depth_mm, mine, path_m)
        for afferent, mine in zip(afferents, spikes, strict=True)
    ]
    return SpikeRecord(tuple(trains), seed, path_m, run.end_s)


def tables_of(
    run: Run,
    found: Visits,
    finger: Fingertip,
    afferents: AfferentPopulation,
    show_progress: Progress = lambda done, of: None,
) -> dict[tuple[str, float, float], MeasureTable]:
    """Return the measures at the end organs of all afferents at every place of a run."""
    deepest: dict[tuple[str, float, float], float] = {}
    for visit in found.visits:
        deepest[visit.place] = max(deepest.get(visit.place, _LEAST_MM), visit.path.deepest_mm)
    points = afferents.points_mm(finger)
    shapes = {name: from_copy(run.folder.path, name) for name, _, _ in deepest}
    tables = {}
    for number, (place, deepest_mm) in enumerate(deepest.items()):
        show_progress(number, len(deepest))
        name, x_mm, along_mm = place
        shape = parse_shape(shapes[name])
        z_mm = finger.config.receptor_plane_mm + along_mm if along_mm and Z in shape.axes else None
        presses = table_of_presses(finger, shapes[name], deepest_mm, shape.lateral_mm(x_mm), z_mm)
        fields = finger.fields(presses, points)
        tables[place] = MeasureTable(
            np.array([one.doi_mm for one in presses]), np.array([afferents.measure(one.measures) for one in fields])
        )
    return tables


def stream_of(model: AfferentModel, afferents: Sequence[Afferent], step_s: float = MOST_STEP_S) -> SpikeStream:
    """Return the stream of afferents of one class, the same whether a run is computed afterwards or served."""
    sensitivity = [one.sensitivity for one in afferents]
    return SpikeStream(model, step_s, sensitivity, [[one.seed, 0] for one in afferents])


def _pieces(end_s: float, step_s: float) -> Iterator[tuple[int, int]]:
    """Yield the first sample of each piece, and that after its last."""
    end = math.ceil((end_s + _AFTER_S) / step_s)
    each = round(PIECE_S / step_s)
    yield from ((begin, min(begin + each, end)) for begin in range(0, end, each))


def _depths(found: Visits, begin: int, end: int, step_s: float) -> list[tuple[tuple[str, float, float], int, Array]]:
    """Return the place, the first sample and the depths of each visit in a piece."""
    depths = []
    for visit in found.visits:
        a = max(math.ceil(float(visit.path.times_s[0]) / step_s), begin)
        b = min(math.ceil(float(visit.path.times_s[-1]) / step_s), end)
        if a < b:
            depths.append((visit.place, a - begin, visit.path.depth_mm(step_s * np.arange(a, b))))
    return depths


def _train(afferent: Afferent, depth_mm: float, pieces: list[Array], path_m: float) -> SpikeTrain:
    delay_s = afferent.delay_s(path_m)
    return SpikeTrain(
        afferent.name,
        afferent.model,
        afferent.x_mm,
        afferent.along_mm,
        depth_mm,
        afferent.sensitivity,
        delay_s,
        np.concatenate([*pieces, np.empty(0)]) + delay_s,
    )
