"""How a placed indentor is pressed to a depth: at once, or in steps from first touch where a corner may bear."""

from dataclasses import dataclass, field, replace

import numpy as np

from sim.contact.solver import ContactState, solve_contact
from sim.models.placed import PlacedIndentor

_PRESS_IN_MM, _PRESS_IN_CORNER_MM, _PRESS_IN_FINE_MM = 0.2, 0.05, 0.0125
_ON_THE_WAY = 1e-4  # residual that is enough where the next step starts


@dataclass(frozen=True)
class Pressing:
    """Answers at one depth after another, each solved to a target residual."""

    placed: PlacedIndentor
    between_nodes: bool  # contact is enforced between nodes, too
    target: float
    _pressed: dict[float, ContactState] = field(default_factory=dict)  # by depth past first touch, loosely solved

    def solve_from_rest(self, doi_mm: float, _: ContactState | None) -> ContactState:
        """The answer at a depth, whatever was solved before."""
        return self.solve(doi_mm, None)

    def solve(self, doi_mm: float, start: ContactState | None) -> ContactState:
        """At once from a start or for a smooth shape, else pressed in from first touch, finely if that misses."""
        in_steps = start is None and self.placed.indentor.sharp
        state = self._pressed_in(doi_mm) if in_steps else self._at(doi_mm, start, self.target)
        if state.residual <= self.target:
            return state
        finer = self._pressed_in_finely(doi_mm)
        better = min((state, finer), key=lambda s: s.residual)
        if not better.converged:
            self.placed.refuse_rim(self.placed.pose(doi_mm), better)
        return replace(better, passes=state.passes + finer.passes)

    def _pressed_in(self, doi_mm: float) -> ContactState:
        """From first touch in long steps, and from where a corner bears in short ones: its side is chosen there."""
        before_mm, state = self.placed.first_mm, None
        for depth in self._depths(_PRESS_IN_MM, before_mm, doi_mm):
            if depth not in self._pressed:
                self._pressed[depth] = self._onward(before_mm, depth, state, _ON_THE_WAY)
            before_mm, state = depth, self._pressed[depth]
        return self._onward(before_mm, doi_mm, state, self.target)

    def _onward(self, before_mm: float, doi_mm: float, start: ContactState | None, target: float) -> ContactState:
        if start is None or not self.placed.bears_on_corner(start):
            state = self._step(doi_mm, start, target)
            if not self.placed.bears_on_corner(state):
                return state
        for depth in self._depths(_PRESS_IN_CORNER_MM, before_mm, doi_mm):
            if depth not in self._pressed:
                self._pressed[depth] = self._step(depth, start, _ON_THE_WAY)
            start = self._pressed[depth]
        return self._step(doi_mm, start, target)

    def _pressed_in_finely(self, doi_mm: float) -> ContactState:
        state = None
        for depth in self._depths(_PRESS_IN_FINE_MM, self.placed.first_mm, doi_mm):
            state = self._step(depth, state, self.target)
        return self._step(doi_mm, state, self.target)

    def _step(self, doi_mm: float, start: ContactState | None, target: float) -> ContactState:
        """Solved at a depth, the passes counted from rest."""
        state = self._at(doi_mm, start, target)
        return state if start is None else replace(state, passes=start.passes + state.passes)

    @staticmethod
    def _depths(step_mm: float, after_mm: float, before_mm: float) -> list[float]:
        """Depths in equal steps between two others, both left out."""
        return np.arange(after_mm + step_mm, before_mm - 1e-9, step_mm).tolist()

    def _at(self, doi_mm: float, start: ContactState | None, target: float) -> ContactState:
        pose = self.placed.pose(doi_mm)
        state = solve_contact(self.placed.model.patch, pose, start, between_nodes=self.between_nodes, target=target)
        if state.converged:  # an unfinished state may touch anything on its way
            self.placed.refuse_rim(pose, state)
        return state
