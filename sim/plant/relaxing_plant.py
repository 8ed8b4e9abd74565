"""A finger whose tissue relaxes, under a stage: what it has borne decides where the indentor meets it next."""

from collections.abc import Sequence
from dataclasses import replace

from sim.devices.clock import Scheduler
from sim.models.fingertip import Fingertip
from sim.models.relaxing.prony import Ahead, Memory, Prony, PronyTerm
from sim.plant.plant import AS_MODELLED, Carriage, Plant, Pose, Press, Truth
from sim.plant.sampled import SampledForce


class RelaxingPress(Press):
    """A finger under an indentor, from one instant to the next."""

    def __init__(
        self, finger: Fingertip, indentor: str, terms: Sequence[PronyTerm], truth: Truth = AS_MODELLED
    ) -> None:
        """Tissue that was never touched. Raises ValueError for no Prony series, and what Press raises."""
        super().__init__(finger, indentor, truth)
        self._patch = finger.model_for(self._indentor.axes).patch
        self._memory = Memory.none(Prony(terms), (len(self._patch.axes), len(self._patch)))
        self._held: Fingertip | None = finger

    def moved_to(self, pose: Pose, step_s: float) -> float:
        """The force so much later, N, the indentor having gone to a pose meanwhile. Raises ModelRangeError."""
        ahead = self._memory.ahead(step_s)
        self._lie(ahead)
        force_n = self.force_n(pose)
        if self._known is None or force_n == 0:
            self._memory = self._memory.released(step_s)
        else:
            borne = ahead.carried + self._known.stiffer * self._known.state.force
            self._memory = self._memory.after(ahead, borne)
        return force_n

    def _lie(self, ahead: Ahead) -> None:
        """Nothing is known yet of the skin as it lies now; a contact that goes on begins with it where it was."""
        self._carried, self._held = ahead.carried, None
        self._stiffness = self._truth.stiffness * ahead.stiffness
        if self._known is not None:
            stayed = self._patch.displaced((self._memory.borne - ahead.carried) / self._known.stiffer)
            self._last = replace(self._known, state=replace(self._known.state, displacement=stayed))
        self._known = self._before = None

    @property
    def _lying(self) -> Fingertip:
        """Held by what it has borne; made when it is touched."""
        if self._held is None:
            self._held = self._finger.held_by(self._indentor.axes, self._carried)
        return self._held


class RelaxingPlant(Plant):
    """A fingertip under a stage; an indentor that is mounted finds it recovered."""

    def __init__(
        self,
        finger: Fingertip,
        carriage: Carriage,
        terms: Sequence[PronyTerm],
        truth: Truth,
        scheduler: Scheduler,
        period_s: float,
    ) -> None:
        """Its force is known at the sample instants of a load cell."""
        super().__init__(finger, carriage, truth)
        self._terms = terms
        self._relaxing: RelaxingPress | None = None
        self._sampled = SampledForce(scheduler, self._moved, period_s)

    def mount(self, indentor: str) -> None:
        """Put an indentor on the carriage; raises ShapeError."""
        self._press = self._relaxing = RelaxingPress(self._finger, indentor, self._terms, self._truth)

    def force_n(self, t_s: float) -> float:
        """Downward force on the finger at the last sample instant, N. Raises ModelRangeError."""
        return self._sampled.force_n(t_s)

    def _moved(self, t_s: float, step_s: float) -> float:
        return 0.0 if self._relaxing is None else self._relaxing.moved_to(self._carriage.pose_at(t_s), step_s)
