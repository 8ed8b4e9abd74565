"""The default finger under the indentors of the published tests, at the receptors of each class."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from sim.models.strain_at_points import mesh_key
from sim.nerve.integrator import spikes
from sim.nerve.models import BUILT_IN, AfferentModel
from sim.nerve.population import sensitivity_of
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

STEP_S = 5e-4
"""Step of signals (s), where a vibration needs none shorter."""
AFFERENTS = 30
SEEDS = (1, 2, 3, 4, 5)


def sensitivities(name: str, seed: int, n: int = AFFERENTS, spread: float | None = None) -> Array:
    """Return sensitivities of a drawn population of a class with median 1, with its own spread or another."""
    return sensitivity_of(name, np.random.default_rng((seed, 7)).standard_normal(n), spread)


@dataclass
class Scenes:
    """Tables of presses, made when they are first needed."""

    finger: Fingertip = field(default_factory=lambda: load("finger"))
    classes: dict[str, AfferentModel] = field(default_factory=lambda: dict(BUILT_IN))

    def __post_init__(self) -> None:
        self._presses: dict[tuple[str, float], list[IndentationResult]] = {}
        self._skins: dict[tuple[str, str, float], SkinUnderIndentor] = {}

    def probe(self, name: str) -> SkinUnderIndentor:
        """Return the skin of a class under the middle of the probe."""
        return self._under(name, PROBE, PROBE_DEEPEST_MM, 0.0, 24)

    def bar(self, name: str, x_mm: float) -> SkinUnderIndentor:
        """Return the skin of a class at x = 0 under the bar at a place."""
        return self._under(name, BAR, BAR_DEEPEST_MM, x_mm, 8)

    def step(self, name: str, x_mm: float) -> SkinUnderIndentor:
        """Return the skin of a class at x = 0 under the step at a place."""
        return self._under(name, STEP, STEP_DEEPEST_MM, x_mm, 8)

    def _under(self, name: str, indentor: str, deepest_mm: float, x_mm: float, levels: int) -> SkinUnderIndentor:
        key = (name, indentor, x_mm)
        if key not in self._skins:
            model = self.classes[name]
            if key[1:] not in self._presses:
                self._presses[key[1:]] = table_of_presses(self.finger, indentor, deepest_mm, x_mm, levels=levels)
            points = self.finger.points_below([0.0], model.depth_mm)
            presses = self._presses[key[1:]]
            self._skins[key] = SkinUnderIndentor(
                self.finger, indentor, points, model.measure, deepest_mm, x_mm, presses=presses
            )
        return self._skins[key]

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

    def pin(self, name: str) -> SkinUnderIndentor:
        """Return the skin of a class at all of `SITES_MM`, against the depth of the array and its deeper pin."""
        model, plane = self.classes[name], self.pin_finger.config.receptor_plane_mm
        x, z = (grid.ravel() for grid in np.meshgrid(SITES_MM, SITES_MM))
        points = self.pin_finger.points_below(x, model.depth_mm, plane + z)
        values = np.stack([model.measure(one.measures) for one in self.pin_finger.fields(self.pinned, points)])
        return SkinUnderIndentor.of_values(ARRAY_MM + 1e-3 * np.array([0.0, *PIN_UM]), values)


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
    skin: SkinUnderIndentor,
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
    return Signal(step_s, skin.value(depth)[..., 0])
