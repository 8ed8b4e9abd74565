"""The engine: what a rig can be told to do. Every verb of a protocol ends here."""

from collections.abc import Callable

from rig.devices.force.base import ForceSensor
from rig.devices.heartbeat import Heartbeat
from rig.devices.stage.base import Stage
from rig.devices.units import GWT_N
from rig.engine.errors import LimitError, NotReadyError, PressPaused, RunAborted
from rig.engine.journal import Recorder
from rig.engine.operator import Operator
from rig.engine.records import NO_PRESS, PressId
from rig.engine.rig_settings import RigSettings
from rig.engine.safety import State
from rig.engine.sensing import SensingRig
from rig.transport.clock import Clock


class Engine(SensingRig):
    """A sensing rig with an operator; positions are x and height above the pad's nominal apex, in mm."""

    def __init__(
        self,
        settings: RigSettings,
        clock: Clock,
        stage: Stage,
        force: ForceSensor,
        journal: Recorder,
        operator: Operator,
        interrupted: Callable[[], bool] = lambda: False,
        soft_trip_n: float | None = None,
        go_on: Callable[[], bool] = lambda: False,
        heartbeat: Heartbeat | None = None,
        contact_s: float = 0.0,
    ) -> None:
        """contact_s: how long the finger was touched in the parts of the run before this one."""
        super().__init__(settings, clock, stage, force, journal, soft_trip_n, heartbeat, contact_s)
        self.operator = operator
        self.indentor: str | None = None
        self._placed = False
        self._next_index = 0
        self._interrupted, self._go_on = interrupted, go_on

    # verbs

    def mount(self, indentor: str) -> None:
        """Have an indentor mounted; the finger must be clear of it."""
        if self._may_touch or self.state is State.TRIPPED:
            raise NotReadyError(f"mount: not allowed while {self.state.value}, the finger may be touched; lift first")
        self.indentor = None
        mounted = self.operator.mount(indentor)
        if mounted != indentor:
            raise NotReadyError(f"mount: {mounted} is on, expected {indentor}; nothing is pressed with the wrong one")
        self.indentor = indentor
        self.record("mount", {"indentor": indentor})

    def home(self) -> None:
        """Find the switches; from then on the position is trusted."""
        if self.state is State.TRIPPED:
            raise NotReadyError("home: the rig has tripped, an operator must reset it")
        self._heartbeat.rest()  # homing lifts first, and takes its time
        controller = self._guarded(self._stage.connect)
        self._guarded(self._stage.home)
        at = self._guarded(self._stage.status)
        self.x_mm = at.x_mm - self.settings.frame.pad_centre_x_mm
        self.height_mm = at.z_mm - self.settings.frame.apex_z_mm
        self._placed = False
        self._lifted()
        self.record("home", {"controller": controller})

    def move_to(self, x_mm: float, along_mm: float = 0.0) -> None:
        """Go to a place, at clearance: sideways, and along the finger where the stage has that axis."""
        self._require_clear("move_to")
        limits = self.settings.limits
        for name, mm, (low, high) in (("x", x_mm, limits.x_mm), ("along", along_mm, limits.along_mm)):
            if not low <= mm <= high:
                raise LimitError(f"move_to: {name} = {mm:g} mm is outside the limits {low:g} … {high:g} mm")
        self.safe_point()
        frame, speed = self.settings.frame, self.settings.habits.travel_speed_mm_s
        self._guarded(
            lambda: self._stage.move_to(
                x_mm=frame.pad_centre_x_mm + x_mm, y_mm=frame.pad_y_mm + along_mm, speed_mm_s=speed
            )
        )
        self.x_mm, self.along_mm = x_mm, along_mm
        self._go_to_clearance(speed)
        self._placed = True
        self.record("move", {"x_mm": x_mm, "along_mm": along_mm, "height_mm": self.height_mm})

    def be_over(self, x_mm: float) -> None:
        """Go to a lateral position unless there already."""
        if not self._placed or (self.x_mm, self.along_mm) != (x_mm, 0.0):
            self.move_to(x_mm)

    def retract(self) -> None:
        """Lift to clearance, straight up."""
        if self.state not in (State.READY, State.IN_CONTACT):
            raise NotReadyError(f"retract: not allowed while {self.state.value}")
        self._lift(self.settings.habits.clearance_mm)
        self._lifted()
        self.record("retract", {"height_mm": self.height_mm, "contact_s": self._contact_s})

    def rest(self, seconds: float) -> None:
        """Let the finger be for so long, at clearance; a pause is taken at once, and its time counts."""
        self._require_clear("rest")
        until_s = self.clock.monotonic_s() + seconds
        while self.clock.monotonic_s() < until_s:
            self.clock.wait_until(self._interrupted, until_s)
            self.safe_point()
        self.record("rest", {"rest_s": seconds})

    def checkpoint(self, name: str) -> None:
        """Write into the journal that the script has come to here."""
        self.record("checkpoint", {"name": name})

    def note(self, text: str) -> None:
        """Write a line into the journal."""
        self.record("note", {"text": text})

    # what an indentation is made of

    def ready_to_indent(self) -> None:
        """Raise NotReadyError unless homed, zeroed, mounted, placed and clear."""
        self._require_clear("indent")
        if self.indentor is None:
            raise NotReadyError("indent: no indentor is mounted")
        if self._zero is None:
            raise NotReadyError("indent: the force sensor has not been zeroed")
        if not self._placed:
            raise NotReadyError("indent: the indentor has not been moved to a position since homing")
        self._refuse_long_contact()

    def next_index(self) -> int:
        """The number of the indentation that begins now; never given twice in a run."""
        self._next_index += 1
        return self._next_index - 1

    def pulse(self, press: PressId, at: str) -> None:
        """Tell the recording amplifier that this is the instant, where an output is configured; of data only.

        rise_s is when the device had confirmed the rise, uncertainty_s how long before that it may have been.
        """
        sync = self.settings.sync
        if sync.output == "off" or press.purpose != "data":
            return
        asked_s = self.clock.monotonic_s()
        self._guarded(lambda: self._stage.set_output(True))
        rise_s = self.clock.monotonic_s()
        self.clock.wait_s(sync.width_s)
        self._guarded(lambda: self._stage.set_output(False))
        width_s = self.clock.monotonic_s() - rise_s
        self.record(
            "sync",
            {
                "index": press.index,
                "at": at,
                "rise_s": round(rise_s, 6),
                "uncertainty_s": round(rise_s - asked_s, 6),
                "width_s": round(width_s, 6),
            },
        )

    def safe_point(self) -> None:
        """Where an operator's pause takes effect: lift and journal; then go on, or raise RunAborted.

        Raises PressPaused where the lift has interrupted an indentation.
        """
        if not self._interrupted():
            return
        pressing = self.state is State.IN_CONTACT
        if pressing:
            self.retract()
        self.record("paused", {"reason": "operator"})
        if not self._go_on():
            raise RunAborted("stopped by the operator at a safe point; the indentor is lifted")
        self.record("resumed", {"by": "operator"})
        if pressing:
            raise PressPaused("paused by the operator")

    def _go_to_clearance(self, speed_mm_s: float) -> None:
        """Down to clearance; the first time since homing step by step, since frame and screw may not be right."""
        habits = self.settings.habits
        clearance = habits.clearance_mm
        while self._zero is not None and self.height_mm > clearance + habits.descent_step_mm:
            self.go_to_height(self.height_mm - habits.descent_step_mm, speed_mm_s)
            self._refuse_contact(self._reading().force_n / GWT_N)
        self.go_to_height(clearance, speed_mm_s)
        if self._zero is not None:
            self._refuse_contact(self.read_force_gwt(NO_PRESS, "clearance"))

    def _refuse_contact(self, force_gwt: float) -> None:
        if abs(force_gwt) >= self.touch_gwt:
            self.trip(
                f"{force_gwt:.2f} gwt at clearance, {self.height_mm:.2f} mm above the nominal apex: "
                "is frame.apex_z_mm right, and the sensor zeroed?",
                force_gwt,
            )
