"""Indentor on tissue that relaxes: presses in sequence, each on the skin that the last one left.

With one Prony series for all layers, contact at any time is elastic contact on displaced skin: nodal forces are
f = α (p − c), with the elastic forces p of the displacement, and α and c from history and time step alone
(`relaxation`). c displaces the skin beforehand, contact adds f / α, and the indentor measures f. Tissue that stiffens
bears k times the force of linear tissue at a depth: p is k times the linear forces, and c / k displaces the skin.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.contact.solver import ContactState
from sim.models.fingertip import Fingertip
from sim.models.relaxation import Memory, Prony, RelaxationStep
from sim.models.result import IndentationResult
from sim.units import GWT_N

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Instant:
    """State of indentor and tissue at one time."""

    t_s: float
    doi_mm: float  # relative to the skin at rest
    force_n: float
    contact: (
        IndentationResult | None
    )  # elastic contact on the displaced skin, with forces f / α; None without contact
    memory: Memory

    @property
    def force_gwt(self) -> float:
        """Force (gwt)."""
        return self.force_n / GWT_N

    @property
    def converged(self) -> bool:
        """Whether the contact, if there is one, was solved to 1e-8."""
        return self.contact is None or self.contact.state.converged


class InTime:
    """Indentor over one position of a finger; a time step is exact where the skin moves linearly in time."""

    def __init__(
        self, finger: Fingertip, indentor: Indentor | str, prony: Prony, x_mm: float = 0.0, z_mm: float | None = None
    ) -> None:
        """Start at 0 s with tissue that was never loaded."""
        self._finger, self._x_mm, self._z_mm = finger, x_mm, z_mm
        self._indentor = parse_shape(indentor) if isinstance(indentor, str) else indentor
        self._model = finger.model_for(self._indentor.axes)
        patch = self._model.patch
        self.now = Instant(0.0, 0.0, 0.0, None, Memory.none(prony, (len(patch.axes), len(patch))))

    def to_depth(self, step_s: float, doi_mm: float) -> Instant:
        """Advance by a time step to a depth past first touch; ≤ 0 releases the skin. Raises ModelRangeError."""
        if doi_mm <= 0:
            return self._arrived(Instant(self.now.t_s + step_s, doi_mm, 0.0, None, self.now.memory.released(step_s)))
        ahead = self.now.memory.ahead(step_s)
        return self._touching(step_s, ahead, self._pressed(ahead, doi_mm=doi_mm))

    def to_force(self, step_s: float, force_gwt: float) -> Instant:
        """Advance by a time step to the depth that carries a force > 0. Raises ModelRangeError."""
        ahead = self.now.memory.ahead(step_s)
        return self._touching(step_s, ahead, self._pressed(ahead, force_gwt=force_gwt / ahead.stiffness))

    def strain(self) -> Array:
        """Return (n_receptors, 6) current engineering strains; stress also depends on their history."""
        return self._model.strain(self.now.memory.borne / self._stiffer)

    @property
    def _stiffer(self) -> float:
        """Force of the tissue over that of linear tissue, now."""
        return 1.0 if self.now.contact is None else self.now.contact.strained.force

    def _pressed(
        self, ahead: RelaxationStep, *, doi_mm: float | None = None, force_gwt: float | None = None
    ) -> IndentationResult:
        held = self._finger.held_by(self._indentor.axes, ahead.carried)
        return held.indent(
            self._indentor, self._x_mm, z_mm=self._z_mm, doi_mm=doi_mm, force_gwt=force_gwt, start=self._start(ahead)
        )

    def _start(self, ahead: RelaxationStep) -> ContactState | None:
        """Return the last contact, with the skin where it was."""
        if self.now.contact is None:
            return None
        stayed = self._model.patch.displaced((self.now.memory.borne - ahead.carried) / self._stiffer)
        return replace(self.now.contact.state, displacement=stayed)

    def _touching(self, step_s: float, ahead: RelaxationStep, contact: IndentationResult) -> Instant:
        t_s, force_n = self.now.t_s + step_s, ahead.stiffness * contact.force_n
        memory = self.now.memory.after(ahead, ahead.carried + contact.strained.force * contact.state.force)
        return self._arrived(Instant(t_s, contact.doi_mm, force_n, contact, memory))

    def _arrived(self, instant: Instant) -> Instant:
        self.now = instant
        return instant
