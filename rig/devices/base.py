"""The interfaces of a stage and of a force sensor, and their errors."""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

from rig.errors import RigError

Axis = Literal["x", "y", "z"]

LOOK_S = 0.1
"""Time between two status polls of a motion (s); a shorter motion is polled at its end."""


class StageError(RigError):
    """Error of a stage; its position is trusted only if `Stage.homed` is true."""

    default_code = "stage_failed"


class MoveError(RigError, ValueError):
    """Error of a move that this stage cannot make; nothing was sent."""

    default_code = "bad_move"


class StageAlarm(StageError):  # noqa: N818
    """Error of a controller that has locked itself.

    Parameters
    ----------
    number : int or str
        Number of the alarm in the manual of the controller, or its letters.
    meaning : str
        What the manual says about this number.
    """

    default_code = "alarm"

    def __init__(self, number: int | str, meaning: str) -> None:
        super().__init__(f"stage alarm {number}: {meaning}")
        self.number = number
        self.meaning = meaning


class StageReset(StageError):  # noqa: N818
    """Error of a controller that has restarted; its queue is empty and its position is not trusted."""

    default_code = "was_reset"


class StageTimeout(StageError):  # noqa: N818
    """Error of a controller that does not answer, or of a move that does not arrive, in time."""

    default_code = "timeout"


class StageNotHomed(StageError):  # noqa: N818
    """Error of a move that is requested before homing; nothing was sent.

    Parameters
    ----------
    who : str
        The stage or the axis that must be homed.
    """

    default_code = "not_homed"

    def __init__(self, who: str) -> None:
        super().__init__(f"{who} must be homed before a move; home the stage first")


class StageHeld(StageError):  # noqa: N818
    """Error of a stage that an operator has stopped at the controller.

    Its command waits until the operator releases the stage; the program does not wait for it.

    Parameters
    ----------
    state : str
        State that the controller reports, for example ``"Hold:0"``.
    who : str, optional
        Beginning of the message, before "the stage is held".
    """

    default_code = "held"

    def __init__(self, state: str, who: str = "") -> None:
        super().__init__(f"{who}the stage is held at its controller (state {state}); release the hold there")


class StageOverridden(StageError):  # noqa: N818
    """Error of a stage whose speed an operator has changed; its position is trusted.

    `Stage.halt` stops the motion and restores the full speed.
    """

    default_code = "overridden"


class StageRejected(StageError):  # noqa: N818
    """Error of a line that the controller refuses.

    Parameters
    ----------
    number : int or str
        Number of the error in the manual of the controller, or its word.
    line : str
        The line that was sent.
    meaning : str
        What the manual says about this number.
    """

    default_code = "line_refused"

    def __init__(self, number: int | str, line: str, meaning: str) -> None:
        super().__init__(f"the stage's controller refused {line!r} with error {number}: {meaning}")
        self.number = number
        self.line = line
        self.meaning = meaning


def is_held(state: str) -> bool:
    """Return whether this state means that an operator has stopped the stage.

    Parameters
    ----------
    state : str
        State that the controller reports.

    Returns
    -------
    bool
        True if the stage continues as soon as the operator releases it.

    Examples
    --------
    >>> is_held("Hold:0"), is_held("Idle")
    (True, False)
    """
    return state.startswith(("Hold", "Door"))


@dataclass(frozen=True, slots=True)
class StageStatus:
    """State and position of a stage.

    Attributes
    ----------
    state : str
        State as the controller names it, for example ``"Idle"``.
    x_mm, y_mm, z_mm : float
        Position in machine coordinates (mm).
    referenced : bool
        Whether the controller still counts from its home position, as far as it reports this. A controller that was
        switched off counts from 0 wherever the carriage stands, which is the position of a homed one.
    """

    state: str
    x_mm: float
    y_mm: float
    z_mm: float
    referenced: bool = field(default=True, repr=False)


Looks = Iterator[StageStatus | None]
"""A motion under way: each item is a status poll, LOOK_S after the previous one; it ends on arrival.

An item is None where the controller reports nothing while it moves. The first item starts the motion. Code that does
not run it to its end calls Stage.halt() or Stage.stop().
"""


class Stage(Protocol):
    """Interface of a stage with three axes in machine coordinates.

    x is lateral, y runs along the finger, z is vertical with + up, all in mm. Before homing, a driver refuses each
    move with StageNotHomed and sends nothing. If an operator interferes with a move or a jog, the next status poll
    raises StageHeld or StageOverridden; a driver whose controller reports no hold need not do this.
    """

    @property
    @abstractmethod
    def homed(self) -> bool:
        """Whether the position is trusted, homed and without alarm, reset, timeout or stop since."""
        ...

    @abstractmethod
    def connect(self) -> str:
        """Connect to the controller.

        Returns
        -------
        str
            Identity of the controller.

        Raises
        ------
        StageError
            If the controller does not answer, or is not the configured one.
        """
        ...

    @abstractmethod
    def homing(self) -> Looks:
        """Start the search for the home switches; the position is trusted at its end.

        Returns
        -------
        iterator of StageStatus or None
            One item for each status poll; it ends on arrival. Run it to its end, or call `halt` or `stop`.

        Raises
        ------
        StageError
            If the controller does not answer, or does not find a switch.
        """
        ...

    @abstractmethod
    def moving(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
        look_s: float = LOOK_S,
    ) -> Looks:
        """Start a move in a straight line that the caller monitors.

        Parameters
        ----------
        x_mm, y_mm, z_mm : float, optional
            Target in machine coordinates (mm). An axis without a target does not move.
        speed_mm_s : float
            Speed along the line (mm/s).
        look_s : float, optional
            Time between two status polls (s).

        Returns
        -------
        iterator of StageStatus or None
            One item for each status poll, None where the controller reports nothing while it moves. The first item
            starts the motion; it ends on arrival. Run it to its end, or call `halt` or `stop`.

        Raises
        ------
        MoveError
            If the stage cannot make this move; nothing was sent.
        StageNotHomed
            If the position is not trusted; nothing was sent.
        StageError
            If the controller reports an error, or does not answer.
        """
        ...

    @abstractmethod
    def halt(self) -> None:
        """Halt the motion under way and return at rest; the position stays as trusted as before.

        This also ends a change of speed by an operator.

        Raises
        ------
        StageError
            If the stage does not come to rest.
        TransportError
            If the port fails.
        """
        ...

    def home(self) -> None:
        """Home and return on arrival.

        Raises
        ------
        StageError
            As `homing`.
        """
        arrive(self.homing())

    def move_to(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
    ) -> None:
        """Move in a straight line and return on arrival.

        Parameters
        ----------
        x_mm, y_mm, z_mm : float, optional
            Target in machine coordinates (mm). An axis without a target does not move.
        speed_mm_s : float
            Speed along the line (mm/s).

        Raises
        ------
        MoveError
            If the stage cannot make this move; nothing was sent.
        StageNotHomed
            If the position is not trusted; nothing was sent.
        StageError
            As `moving`.
        """
        arrive(self.moving(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm, speed_mm_s=speed_mm_s, look_s=math.inf))

    @abstractmethod
    def status(self) -> StageStatus:
        """Read the state and the position.

        Returns
        -------
        StageStatus
            State and position now.

        Raises
        ------
        StageError
            If the controller does not answer.
        """
        ...

    @abstractmethod
    def look(self) -> StageStatus:
        """Read the state and the position without changing anything, also before `connect`.

        Returns
        -------
        StageStatus
            State and position now.

        Raises
        ------
        StageError
            If the controller does not answer.
        """
        ...

    @abstractmethod
    def steps_per_mm(self, axis: Axis) -> float:
        """Return the motor steps for one mm of an axis.

        Parameters
        ----------
        axis : {'x', 'y', 'z'}
            The axis.

        Returns
        -------
        float
            Steps for each mm, negative where the motor turns against the axis.
        """
        ...

    @abstractmethod
    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """Jog an axis by a distance and return at once.

        The stage stops after this distance, even if the program sends nothing more.

        Parameters
        ----------
        axis : {'x', 'y', 'z'}
            The axis.
        by_mm : float
            Distance, with its sign (mm).
        speed_mm_s : float
            Speed (mm/s).

        Raises
        ------
        MoveError
            If the stage cannot make this move; nothing was sent.
        StageError
            If the controller reports an error, or does not answer.
        """
        ...

    @abstractmethod
    def end_jog(self) -> None:
        """Stop jogging and return at rest; the position stays trusted.

        Raises
        ------
        StageError
            If the stage does not come to rest.
        """
        ...

    @abstractmethod
    def set_output(self, on: bool) -> None:
        """Switch the output that marks events on a recording amplifier, and return when it has switched.

        Parameters
        ----------
        on : bool
            Whether the output is high.

        Raises
        ------
        StageError
            If the controller does not confirm the output.
        """
        ...

    @abstractmethod
    def stop(self) -> None:
        """Stop now, ahead of every queue and every wait; the position is not trusted afterwards.

        A driver may then verify the stop for one second at most.

        Raises
        ------
        StageError
            If the controller reports that it did not stop.
        TransportError
            If the port fails.
        """
        ...

    def limit_depth(self, lowest_z_mm: float) -> None:
        """Set the lowest height that the controller itself accepts, where it has a volatile limit.

        The default does nothing: not every controller has such a limit.

        Parameters
        ----------
        lowest_z_mm : float
            Lowest allowed position of the vertical axis, in machine coordinates (mm).

        Raises
        ------
        StageError
            If the controller does not confirm the limit.
        """
        return

    def allow_unhomed_jogs(self) -> None:
        """Allow short jogs of the vertical axis in both directions before homing.

        The position stays untrusted, and an alarm that homing refuses is not cleared. Limits that count from a home
        position which the controller does not have are set aside; homing sets them again. The default does nothing:
        most controllers jog unhomed.

        Raises
        ------
        StageError
            If the controller does not answer, or refuses.
        """
        return

    def trust_position(self) -> None:
        """Allow moves from the position of a stage that an earlier connection has homed.

        The caller has compared it with where that connection left the stage. The default does nothing: the stage must
        then be homed again.
        """
        return

    def active_inputs(self) -> frozenset[str]:
        """Return the names of the controller's stop inputs that are active now.

        Returns
        -------
        frozenset of str
            For example ``{"door"}``. Empty by default: not every controller has inputs that it can report.

        Raises
        ------
        StageError
            If the controller does not answer.
        """
        return frozenset()

    @abstractmethod
    def unlock(self) -> None:
        """Clear an alarm without homing; the position stays untrusted.

        Raises
        ------
        StageError
            If the controller does not answer, or stays locked.
        """
        ...

    @abstractmethod
    def close(self) -> None:
        """Release the port."""
        ...


def next_look_s(last_s: float, over_s: float, look_s: float) -> float:
    """Return when to poll a motion again: never just before or just after its predicted end.

    Parameters
    ----------
    last_s : float
        Time of the last status poll (s).
    over_s : float
        Time at which the motion should end (s).
    look_s : float
        Time between two status polls (s).

    Returns
    -------
    float
        Time of the next status poll (s).

    Examples
    --------
    >>> next_look_s(1.0, 5.0, 0.5)
    1.5
    >>> next_look_s(1.0, 1.6, 0.5)
    2.1
    """
    due_s = last_s + look_s
    in_time = over_s - due_s >= look_s / 2
    return due_s if in_time else max(due_s, over_s + look_s)


def arrive(looks: Looks) -> None:
    """Run a motion to its end.

    Parameters
    ----------
    looks : iterator of StageStatus or None
        What `Stage.moving` or `Stage.homing` returned.
    """
    for _ in looks:
        pass


class ForceError(RigError):
    """Error of a force sensor that has no valid reading; the engine stops the press."""

    default_code = "no_force"


class ForceOverload(ForceError):  # noqa: N818
    """Error of a load above the range of the instrument."""

    default_code = "overload"


class ForceUnderload(ForceError):  # noqa: N818
    """Error of a load below the range of the instrument: the cell is lifted off its support, or broken."""

    default_code = "underload"


class ForceBusy(ForceError):  # noqa: N818
    """Error of an instrument that is busy, or found no stable value in its own time."""

    default_code = "busy"


class ForceBroken(ForceError):  # noqa: N818
    """Error of a broken cell, converter or cable."""

    default_code = "broken"


class ForceTimeout(ForceError):  # noqa: N818
    """Error of an instrument that does not answer in time."""

    default_code = "no_reply"


SHOWN_BYTES = 40
"""Most bytes that an error shows."""


def no_line(port: str, unended: bytes, silence: str, code: str) -> ForceTimeout:
    """Return the error of a line that did not arrive.

    Parameters
    ----------
    port : str
        Name of the port.
    unended : bytes
        What arrived without an end of line.
    silence : str
        Sentence for a device that sent nothing, without its port.
    code : str
        Code of a device that sent nothing.

    Returns
    -------
    ForceTimeout
        The error, with the code ``no_line_end`` if bytes arrived.
    """
    if not unended:
        return ForceTimeout(f"{port}: {silence}", code)
    return ForceTimeout(
        f"{port}: {len(unended)} bytes arrived without an end of line (LF), {unended[-SHOWN_BYTES:]!r}; set the "
        "device to end each line with CR LF, and check force.baud and force.character",
        "no_line_end",
    )


@dataclass(frozen=True, slots=True)
class ForceReading:
    """One reading of a force sensor.

    Attributes
    ----------
    force_n : float
        Force (N); press on the sensor is positive.
    stable : bool
        Whether the instrument reports the value as stable.
    t_s : float
        Monotonic time of the host at which the reading arrived (s).
    also : mapping of str to float, optional
        What else the sensor measured, for the journal, by the keys of its `sample` stream: all axes of a sensor with
        several, and counts of its packets. Default: nothing.
    """

    force_n: float
    stable: bool
    t_s: float
    also: Mapping[str, float] = field(default_factory=dict, compare=False, repr=False)


class ForceSensor(Protocol):
    """Interface of a force sensor; the rig uses one axis, on which a press is positive."""

    @property
    def sample_period_s(self) -> float:
        """Time after which a value consists of new samples only, filter included (s)."""
        ...

    @property
    def resolution_gwt(self) -> float:
        """Smallest step of the value that the instrument shows (gwt)."""
        ...

    def connect(self) -> str:
        """Connect to the instrument, and refuse it if its settings differ from the configuration.

        Returns
        -------
        str
            Identity of the instrument.

        Raises
        ------
        ForceError
            If the instrument does not answer, or is set otherwise than configured.
        """
        ...

    def identify(self) -> str:
        """Read the identity without changing anything; another program may use the instrument.

        Returns
        -------
        str
            Identity of the instrument.

        Raises
        ------
        ForceError
            If the instrument does not answer.
        """
        ...

    def read(self) -> ForceReading:
        """Read the latest value, stable or not.

        Returns
        -------
        ForceReading
            Force, stability and time.

        Raises
        ------
        ForceError
            If there is no valid reading: no answer, a load outside the range, a broken cell.
        """
        ...

    def zero(self) -> None:
        """Zero the sensor at the present load, and verify it.

        Raises
        ------
        ForceError
            If the sensor does not confirm zero.
        """
        ...

    def close(self) -> None:
        """Release the port."""
        ...


@runtime_checkable
class ZeroedByDriver(Protocol):
    """Interface of a sensor that is zeroed by its driver, and so no longer in the next command."""

    @property
    def subtracted_n(self) -> float:
        """Load that the driver subtracts since its last zero (N)."""
        ...


@runtime_checkable
class HasSetPoint(Protocol):
    """Interface of a sensor whose instrument switches a relay at a force and reports that force."""

    def set_point_gwt(self, register: int) -> float:
        """Return the force at which the relay switches.

        Parameters
        ----------
        register : int
            Number of the register that holds the set point.

        Returns
        -------
        float
            Force (gwt).

        Raises
        ------
        ForceError
            If the instrument does not answer.
        """
        ...
