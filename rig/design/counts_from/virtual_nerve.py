"""Counts of a virtual nerve: a fiber of a known candidate, or a simulated SA-I afferent (sim/nerve)."""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from rig.design.counts import CountModel, draw_counts
from rig.design.counts_from.source import MadePress
from rig.design.fibers import draw_fibers, relative_rates
from rig.design.presses import PossiblePress
from rig.design.response_table import ResponseTable
from rig.plan.config import Config
from sim.contact.shapes import parse_shape
from sim.models.fingertip import Fingertip
from sim.nerve.integrator import MOST_STEP_S
from sim.nerve.models import BUILT_IN, spikes_of
from sim.nerve.skin import SkinUnderIndentor
from sim.nerve.stimulus import Stimulus

AFFERENT, ITS_CANDIDATE = "SA1", "sed"
"""The afferent whose measure is among the candidates, and that measure."""

_LEAD_S = 0.05


class VirtualFiber:
    """Fiber drawn from the unknowns, for which a candidate is true."""

    def __init__(self, name: str, seed: int, table: ResponseTable, model: CountModel) -> None:
        fiber = draw_fibers(1, table, model.unknowns, seed, evenly=False)
        self._gain = float(model.draw_gains(1, np.random.default_rng([seed, 1]))[0])
        self._rate = relative_rates(table, name, fiber)[0]
        self._drift = float(fiber.drift[0])
        self._dispersion = float(model.unknowns.dispersions[fiber.level[0]])
        self._threshold = float(fiber.threshold[0])
        self._name, self._seed, self._window_s = name, seed, model.window_s
        self._new: list[tuple[int, int]] = []

    def made(self, press: MadePress) -> None:
        """Draw the count of a press."""
        mean = self._window_s * self._gain * self._rate[press.possible] * np.exp(self._drift * press.tau)
        chance = np.random.default_rng([self._seed, 2, press.index])
        self._new.append((press.index, int(draw_counts(np.array([mean]), self._dispersion, chance)[0])))

    def new(self) -> list[tuple[int, int]]:
        """Return the new counts."""
        found, self._new = self._new, []
        return found

    def truth(self) -> Mapping[str, Any]:
        """Return the candidate and the fiber."""
        return {
            "candidate": self._name,
            "seed": self._seed,
            "rate_per_s": self._gain,
            "threshold": self._threshold,
            "drift": self._drift,
            "dispersion": self._dispersion,
        }

    def close(self) -> None:
        """Do nothing."""


class VirtualAfferent:
    """SA-I afferent whose receptor and sensitivity are drawn; it answers each press from rest."""

    def __init__(self, seed: int, config: Config, model: CountModel) -> None:
        chance = np.random.default_rng([seed, 3])
        self._finger = Fingertip.load(config.finger)
        self._config, self._seed, self._window_s = config, seed, model.window_s
        self._x_mm = float(chance.uniform(*model.unknowns.x_mm))
        self._sensitivity = float(np.exp(chance.normal(0.0, 0.3)))
        self._afferent = BUILT_IN[AFFERENT]
        self._skin = cache(self._skin_of)
        self._new: list[tuple[int, int]] = []

    def made(self, press: MadePress) -> None:
        """Simulate the spikes of a press, and count those in its hold."""
        skin = self._skin(press.press)
        depth_mm = float(skin.depths_mm[-1])
        reached_s = _LEAD_S + depth_mm / self._config.habits.press_speed_mm_s
        ends_s = reached_s + self._window_s
        path = Stimulus([0.0, _LEAD_S, reached_s, ends_s], [0.0, 0.0, depth_mm, depth_mm])
        (spikes,) = spikes_of(
            self._afferent, skin.signal(path, MOST_STEP_S), [self._sensitivity], [[self._seed, press.index]]
        )
        held = (spikes >= reached_s) & (spikes < ends_s)
        self._new.append((press.index, int(held.sum())))

    def new(self) -> list[tuple[int, int]]:
        """Return the new counts."""
        found, self._new = self._new, []
        return found

    def truth(self) -> Mapping[str, Any]:
        """Return the measure that the afferent follows, and the afferent."""
        return {
            "candidate": ITS_CANDIDATE,
            "afferent": AFFERENT,
            "seed": self._seed,
            "x_mm": self._x_mm,
            "depth_mm": self._afferent.depth_mm,
            "sensitivity": self._sensitivity,
        }

    def close(self) -> None:
        """Do nothing."""

    def _skin_of(self, press: PossiblePress) -> SkinUnderIndentor:
        shape = parse_shape(press.shape)
        finger, x_mm = self._finger, shape.lateral_mm(press.x_mm)
        doi_mm = press.target if press.kind == "doi_mm" else finger.indent(shape, x_mm, force_gwt=press.target).doi_mm
        points = finger.points_below([self._x_mm], [self._afferent.depth_mm], [finger.config.receptor_plane_mm])
        return SkinUnderIndentor(finger, press.shape, points, self._afferent.measure, doi_mm, x_mm)
