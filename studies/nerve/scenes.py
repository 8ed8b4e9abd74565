"""The default finger under the indentors of the published tests, at the receptors of each class."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RegularGridInterpolator

from sim.measures.receptors import ReceptorError
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from sim.models.strain_at_points import mesh_key
from sim.nerve.integrator import spikes
from sim.nerve.models import BUILT_IN, AfferentModel
from sim.nerve.population import draw_organs, sensitivity_of
from sim.nerve.skin import Signal, SkinUnderIndentor, table_of_presses
from sim.nerve.stimulus import Stimulus
from studies.nerve.published import PIN_UM

Array = NDArray[np.float64]

PROBE, PROBE_DEEPEST_MM = "flat:0.5", 1.5
"""Flat probe of 1 mm diameter."""
PRELOAD_MM = 0.5
BAR, BAR_DEEPEST_MM = "bar:3.0", 1.0
STEP, STEP_DEEPEST_MM = "step:3", 1.0
STEP_X_MM = tuple(np.round(np.arange(-2.5, 2.51, 0.25), 2))
"""Places of the step (mm); the raised flat is at smaller x."""
ARRAY_MM = 1.6
PIN_RADIUS_MM = 0.25
PIN_PITCH_MM = 0.83
"""Spacing of the pins of the array: 73 sites on 50 mm² of skin (Vega-Bermudez and Johnson 1999)."""
PINNED_MESH_MM = 0.17
"""Size of elements under the array, in both directions, as under any round shape."""
SITES_MM = np.round(np.arange(-2.4, 2.41, 0.4), 2)
"""Places of receptors relative to the pin, in both directions (mm)."""

PINNED_GRID_MM = 0.2
"""Spacing of the places at which the measure under the array is computed; between them it is linear."""
PLACES_AT_ONCE = 5

STEP_S = 5e-4
"""Step of signals (s), where a vibration needs none shorter."""
AFFERENTS = 30
SEEDS = (1, 2, 3, 4, 5)


def sensitivities(name: str, seed: int, n: int = AFFERENTS, spread: float | None = None) -> Array:
    """Return sensitivities of a drawn population of a class with median 1, with its own spread or another."""
    return sensitivity_of(name, np.random.default_rng((seed, 7)).standard_normal(n), spread)


def organs_mm(model: AfferentModel, seed: int, n: int) -> Array:
    """Return the end organs of a drawn population of a class, (n, n_organs, 2) in mm.

    The stimulus is over the most sensitive place of each afferent, as in the sources: the organ nearest to the center
    of its field is at 0.
    """
    found = np.array([draw_organs(model, np.random.default_rng((seed, 8, k))) for k in range(n)])
    nearest = np.linalg.norm(found, axis=-1).argmin(axis=1)
    return found - found[np.arange(n), nearest][:, None]


class Afferents:
    """Afferents under an indentor, each with a skin of its own that has a column for each of its end organs."""

    def __init__(self, skins: Sequence[SkinUnderIndentor]) -> None:
        self.skins = list(skins)
        self.depths_mm = skins[0].depths_mm

    @classmethod
    def of_values(cls, depths_mm: ArrayLike, values: Array) -> "Afferents":
        """Return the afferents of a table (n_depths, n_afferents, n_organs)."""
        return cls([SkinUnderIndentor.of_values(depths_mm, values[:, k]) for k in range(values.shape[1])])

    def only(self, which: NDArray[np.bool_]) -> "Afferents":
        """Return some of them."""
        return Afferents([one for one, kept in zip(self.skins, which, strict=True) if kept])

    def signal(self, stimulus: Stimulus, step_s: float, lasts_s: float | None = None) -> Signal:
        """Return the signal of a stimulus at all end organs."""
        return Signal(step_s, np.stack([one.signal(stimulus, step_s, lasts_s).value for one in self.skins]))

    def at(self, depth_mm: Array) -> Array:
        """Return the measure, (n_rows, n_organs, n_samples), at depths with a row for each afferent or one for all.

        One afferent alone may have several rows.
        """
        depth = np.atleast_2d(depth_mm)
        skins = self.skins if len(self.skins) > 1 else len(depth) * self.skins
        depths = depth if len(depth) > 1 else len(skins) * [depth[0]]
        return np.stack([one.value(mm).T for one, mm in zip(skins, depths, strict=True)])


@dataclass
class Scenes:
    """Tables of presses, made when they are first needed."""

    finger: Fingertip = field(default_factory=lambda: load("finger"))
    classes: dict[str, AfferentModel] = field(default_factory=lambda: dict(BUILT_IN))

    def __post_init__(self) -> None:
        self._presses: dict[tuple[str, float], list[IndentationResult]] = {}
        self._under_probe: dict[tuple[str, int, int], Afferents] = {}
        self._shifted: dict[tuple[str, str, int], dict[float, list[Afferents]]] = {}
        self._grids: dict[str, list[RegularGridInterpolator]] = {}

    def probe(self, name: str, seed: int, n: int = AFFERENTS) -> Afferents:
        """Return afferents of a class under the middle of the probe."""
        key = (name, seed, n)
        if key not in self._under_probe:
            presses = self._pressed(PROBE, PROBE_DEEPEST_MM, 0.0, 24)
            organs = organs_mm(self.classes[name], seed, n)
            values = self._measured(name, presses, organs.reshape(-1, 2)).reshape(len(presses), *organs.shape[:2])
            self._under_probe[key] = Afferents.of_values([one.doi_mm for one in presses], values)
        return self._under_probe[key]

    def bar(self, name: str, x_mm: Sequence[float], seed: int) -> Afferents:
        """Return one afferent of a class at x = 0 under the bar; each of the skins is of a place of the bar."""
        return Afferents([self._over(name, BAR, BAR_DEEPEST_MM, x_mm, 1)[x][seed - 1].skins[0] for x in x_mm])

    def step(self, name: str, x_mm: float, seed: int, n: int) -> Afferents:
        """Return afferents of a class at x = 0 under the step at a place."""
        return self._over(name, STEP, STEP_DEEPEST_MM, STEP_X_MM, n)[x_mm][seed - 1]

    def _over(
        self, name: str, indentor: str, deepest_mm: float, x_mm: Sequence[float], n: int
    ) -> dict[float, list[Afferents]]:
        """Return n afferents of each seed under an indentor at each of its places."""
        done = self._shifted.setdefault((name, indentor, n), {})
        left = [x for x in x_mm if x not in done]
        organs = np.stack([organs_mm(self.classes[name], seed, n) for seed in SEEDS])
        for k in range(0, len(left), PLACES_AT_ONCE):
            places = left[k : k + PLACES_AT_ONCE]
            presses = [one for x in places for one in self._pressed(indentor, deepest_mm, x, 8)]
            values = self._measured(name, presses, organs.reshape(-1, 2))
            values = values.reshape(len(places), 8, *organs.shape[:3])
            for place, x in enumerate(places):
                depths_mm = [one.doi_mm for one in presses[8 * place : 8 * place + 8]]
                done[x] = [Afferents.of_values(depths_mm, values[place][:, s]) for s in range(len(SEEDS))]
        return done

    def _pressed(self, indentor: str, deepest_mm: float, x_mm: float, levels: int) -> list[IndentationResult]:
        key = (indentor, x_mm)
        if key not in self._presses:
            self._presses[key] = table_of_presses(self.finger, indentor, deepest_mm, x_mm, levels=levels)
        return self._presses[key]

    def _measured(self, name: str, presses: Sequence[IndentationResult], at_mm: Array) -> Array:
        """Return the signal of a class under presses, (n_presses, n), at places from the middle of the pad."""
        model, plane = self.classes[name], self.finger.config.receptor_plane_mm
        points = self.finger.points_below(at_mm[:, 0], model.depth_mm, plane + at_mm[:, 1])
        return np.stack([model.measure(one.measures) for one in self.finger.fields(presses, points)])

    def with_classes(self, classes: dict[str, AfferentModel]) -> "Scenes":
        """Return the scenes of other parameters, with the same presses."""
        other = replace(self, classes=classes)
        other._presses = self._presses
        for name in ("pin_finger", "pinned"):
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other

    # --- an array of pins, one of them deeper ---

    @cached_property
    def pin_finger(self) -> Fingertip:
        """The finger on a mesh that is fine enough for a pin."""
        spacing = {"spacing_mm": PINNED_MESH_MM, "axial_spacing_mm": PINNED_MESH_MM}
        mesh = self.finger.config.mesh.model_copy(update=spacing)
        return load("finger", self.finger.config.model_copy(update={"mesh": mesh}))

    @cached_property
    def pinned(self) -> list[IndentationResult]:
        """Presses of the array alone, then with one pin deeper by each of `PIN_UM`, at x = 0 and z of the plane."""
        plate = self.pin_finger.indent("flat", doi_mm=ARRAY_MM)
        patch = self.pin_finger.model_for(*mesh_key(plate)).patch
        n = len(patch)
        at = patch.position_mm[:, [0, 2]] - (0.0, self.pin_finger.config.receptor_plane_mm)
        from_pin = np.linalg.norm(at - PIN_PITCH_MM * np.round(at / PIN_PITCH_MM), axis=1)
        below = patch.y - (plate.touch_height_mm - ARRAY_MM)
        overlap = np.where(from_pin <= PIN_RADIUS_MM, below, -np.inf)
        deeper = np.linalg.norm(at, axis=1) <= PIN_RADIUS_MM
        found = []
        for pin_um in (0.0, *PIN_UM):
            p = held(patch.compliance[-n:, -n:], overlap + np.where(deeper, 1e-3 * pin_um, 0.0))
            force = np.concatenate([np.zeros((len(patch.axes) - 1, n)), -p[None]])
            found.append(replace(plate, state=replace(plate.state, force=force)))
        return found

    def pin(self, name: str, seed: int, number: int) -> list[Afferents]:
        """Return one afferent of a class, its best place at each of `SITES_MM`, one for each row of sites.

        Depths are those of the array and its deeper pin.
        """
        organ = organs_mm(self.classes[name], seed, number + 1)[number]
        z, x = np.meshgrid(SITES_MM, SITES_MM, indexing="ij")
        at = np.stack([x, z], axis=-1)[:, :, None] + organ
        values = np.stack([read(at) for read in self._pinned_measure(name)])  # (depths, z, x, organs)
        depths_mm = ARRAY_MM + 1e-3 * np.array([0.0, *PIN_UM])
        return [Afferents.of_values(depths_mm, values[:, k]) for k in range(len(SITES_MM))]

    def _pinned_measure(self, name: str) -> list[RegularGridInterpolator]:
        """Return the measure of a class at any place, one for each press; 0 where it has no tissue."""
        if name not in self._grids:
            model, plane = self.classes[name], self.pin_finger.config.receptor_plane_mm
            x, z = (PINNED_GRID_MM * np.arange(-n, n + 1) for n in (17, 24))
            across, along = (grid.ravel() for grid in np.meshgrid(x, z, indexing="ij"))
            places, points = [], []
            for k, (one_x, one_z) in enumerate(zip(across, plane + along, strict=True)):
                with suppress(ReceptorError):
                    points.append(self.pin_finger.points_below(one_x, model.depth_mm, one_z))
                    places.append(k)
            self._grids[name] = []
            for one in self.pin_finger.fields(self.pinned, np.array(points)):
                value = np.zeros(len(across))
                value[places] = model.measure(one.measures)
                table = value.reshape(len(x), len(z))
                self._grids[name].append(RegularGridInterpolator((x, z), table, bounds_error=False, fill_value=0.0))
        return self._grids[name]


def held(compliance: Array, overlap_mm: Array) -> Array:
    """Return the forces p ≥ 0 with which a rigid surface displaces nodes by at least its overlap with them."""
    active = overlap_mm > 0
    for _ in range(200):
        p = np.zeros(len(overlap_mm))
        p[active] = np.linalg.solve(compliance[np.ix_(active, active)], overlap_mm[active])
        wrong = active & (p < 0) | ~active & (compliance @ p < overlap_mm - 1e-9)
        if not wrong.any():
            return p
        active ^= wrong
    raise RuntimeError("no equilibrium under the array")


# --- spikes ---


def fired(
    model: AfferentModel,
    signal: Signal,
    sensitivity: ArrayLike,
    seed: int,
    from_s: float = 0.0,
) -> list[Array]:
    """Return spike times of afferents; before `from_s` only their currents have a history."""
    first = round(from_s / signal.step_s)
    currents = model.current(signal, np.atleast_1d(np.asarray(sensitivity, dtype=float)))[:, first:]
    return [from_s + one for one in fire(model, currents, signal.step_s, seed)]


def fire(model: AfferentModel, currents: Array, step_s: float, seed: int) -> list[Array]:
    """Return spike times of afferents from their currents."""
    return [
        spikes(one, step_s, model.membrane, model.sites, np.random.default_rng((seed, k)))
        for k, one in enumerate(currents)
    ]


def counts(trains: Sequence[Array], begin_s: float, end_s: float) -> Array:
    """Return the number of spikes of each afferent in a window."""
    return np.array([np.searchsorted(t, end_s) - np.searchsorted(t, begin_s) for t in trains], dtype=float)


def ramp(doi_mm: float, speed_mm_s: float, hold_s: float, begins_s: float = 0.1) -> Stimulus:
    """Return a ramp, a hold and the retraction, just above the skin before and after."""
    return Stimulus.ramp(doi_mm, speed_mm_s, hold_s, begins_s=begins_s, away_mm=0.1)


SETTLED_S = 1.0
"""Time before a vibration (s); the preload is reached in the first half of it."""


def vibrated(
    skin: Afferents,
    frequency_hz: float,
    amplitude_um: ArrayLike,
    lasts_s: float,
    preload_mm: float = PRELOAD_MM,
) -> Signal:
    """Return signals, a row for each amplitude, of sines on a preload, from `SETTLED_S` after the first sample."""
    step_s = min(STEP_S, 1 / (16 * frequency_hz))
    amplitude = 1e-3 * np.atleast_1d(np.asarray(amplitude_um, dtype=float))[:, None]
    t = np.arange(-SETTLED_S, lasts_s, step_s)
    rise = np.clip(2 * (t + SETTLED_S) / SETTLED_S, 0.0, 1.0)
    wave = np.where(t >= 0, np.sin(2 * np.pi * frequency_hz * t), 0.0)
    depth = preload_mm * np.sin(0.5 * np.pi * rise) ** 2 + amplitude * wave
    depth = np.clip(depth, 0.0, skin.depths_mm[-1])
    return Signal(step_s, skin.at(depth))
