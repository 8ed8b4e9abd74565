"""State of a bench between commands: zero of the sensor, position of the stage, contact.

Every command reads the same record of contact. It is written before the first motion below clearance, and only a
confirmed lift clears it. It therefore outlives a killed program, and runs that never moved. A finger moves: what
another process measured is the state of its time, and unknown since.

Each command is a process of its own, and a driver that has just connected trusts no position. It may trust the
position if the stage still reports exactly where the last command left it, homed.
"""

import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Literal

from platformdirs import user_state_path
from pydantic import BaseModel, ConfigDict

from rig.clock import WallClock
from rig.data.folder import put_in_place
from rig.devices.base import Stage, StageStatus
from rig.devices.registry import stage_ports
from rig.engine.contact import KnownContact
from rig.engine.motion import is_where_left
from rig.engine.sensing import ForceZero
from rig.errors import LimitError, RecordError
from rig.settings import BenchSettings
from rig_shared.user_files import read_text


class ManualEnd(BaseModel, frozen=True):
    """What ended the last motion under manual control: a stop, or a trip; unix_s: when."""

    status: Literal["aborted", "tripped"]
    reason: str
    unix_s: float


class LastKnown(BaseModel):
    """Record on disk, in mm, N, gwt and seconds since 1970; None if unknown."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    zero_offset_n: float | None = None
    zero_noise_gwt: float = 0.0
    zero_unix_s: float = 0.0
    zero_of: str = ""  # the sensor and its settings, without which the offset is another force
    left_at_mm: tuple[float, float, float] | None = None
    contact: KnownContact | None = None
    lifted_unix_s: float = 0.0  # when the indentor was last at clearance, by force or by a trusted position
    lifted_by_unix_s: float = 0.0  # when the command that lifted it had begun
    contact_by_unix_s: float = 0.0  # when the command that recorded `contact` had begun
    manual_end: ManualEnd | None = None

    @property
    def zero(self) -> ForceZero | None:
        """Zero of the force sensor."""
        return None if self.zero_offset_n is None else ForceZero(self.zero_offset_n, self.zero_noise_gwt)

    @property
    def is_lifted(self) -> bool:
        """Whether a lift is on record, with nothing since that may have touched."""
        return self.contact is not None and not self.contact.may_touch

    def aged_contact(self, at: StageStatus | None) -> KnownContact | None:
        """Return the contact on record as another process reports it; at: where the stage stands now, if known."""
        return self.contact and self.contact.after(math.inf, trusted=at is not None and self.is_where_left(at))

    def is_where_left(self, at: StageStatus) -> bool:
        """Return whether a stage is still where it was left, homed."""
        return is_where_left(at, self.left_at_mm)


_NO_ZERO: Mapping[str, object] = {
    "zero_offset_n": None,
    "zero_noise_gwt": 0.0,
    "zero_unix_s": 0.0,
    "zero_of": "",
}


class BenchMemory:
    """File of one bench, identified by its ports; a command that moves opens it before its first motion, once."""

    def __init__(self, settings: BenchSettings) -> None:
        ports = " ".join((*stage_ports(settings.stage), settings.force.port))
        self.began_unix_s = WallClock().unix_s()
        self._path = state_folder() / f"bench-{sha256(ports.encode()).hexdigest()[:16]}.json"
        scale = settings.calibration.value("force_scale", 1.0)
        self._sensor = sha256(f"{settings.force.model_dump_json()} {scale!r}".encode()).hexdigest()[:16]

    def read(self) -> LastKnown:
        """Return the record, without a zero of another sensor or scale; an empty one if the file cannot be read."""
        try:
            found = LastKnown.model_validate_json(read_text(self._path))
        except (OSError, ValueError):
            return LastKnown()
        return found if found.zero_of == self._sensor else found.model_copy(update=_NO_ZERO)

    def record_zero(self, zero: ForceZero | None) -> None:
        """Record a new zero; None: the sensor was zeroed, and its new zero is not yet measured."""
        if zero is None:
            self._write(**_NO_ZERO)
            return
        now_s = WallClock().unix_s()
        about = {"zero_noise_gwt": zero.noise_gwt, "zero_unix_s": now_s, "zero_of": self._sensor}
        self._write(zero_offset_n=zero.offset_n, **about)

    def moves(self) -> None:
        """Forget the position before a motion, until `left` records it again."""
        self._write(left_at_mm=None)

    def left(self, at: StageStatus) -> None:
        """Record the position of a homed stage at rest."""
        self._write(left_at_mm=(at.x_mm, at.y_mm, at.z_mm))

    def record_manual_end(self, end: ManualEnd) -> None:
        """Record a stop or a trip under manual control, which holds until a later lift."""
        self._write(manual_end=end)

    @contextmanager
    def moving(self, stage: Stage) -> Iterator[None]:
        """Forget the position of a stage while a command moves it; record it at the end, also after a refusal."""
        self.moves()
        try:
            yield
        except LimitError:  # Refused, at rest.
            self._leave(stage)
            raise
        self._leave(stage)

    def _leave(self, stage: Stage) -> None:
        if stage.homed:
            self.left(stage.status())

    def touched(self, known: KnownContact) -> None:
        """Record the known state of contact.

        Only a confirmed lift clears a finger that may have been touched, and only a motion below clearance or a force
        makes a clear one doubtful; a position alone does neither. Raises RecordError if the file would still record a
        clear finger.
        """
        last = self.read()
        before, clear = last.contact, last.is_lifted
        lifted = {}
        if known.kind in ("lifted", "raised"):
            lifted = {"lifted_unix_s": known.unix_s, "lifted_by_unix_s": self.began_unix_s}
        if clear and known.kind == "raised":
            self._write(**lifted)
            return
        self._write(contact=known, contact_by_unix_s=self.began_unix_s, **lifted)
        if clear and known.may_touch and self.read().contact == before:
            with suppress(OSError):
                self._path.unlink()  # possible even on a full disk
            if self.read().contact == before:
                raise RecordError(
                    f"cannot write {self._path}, which still records that the finger is not touched; free disk "
                    "space or make it writable",
                    "says_not_touched",
                )

    def _write(self, **changes: object) -> None:
        known = self.read().model_copy(update=changes)
        with suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            temporary = self._path.with_suffix(f".{os.getpid()}")
            temporary.unlink(missing_ok=True)
            with temporary.open("x", encoding="utf-8") as file:  # writes through no link
                file.write(known.model_dump_json())
            put_in_place(temporary, self._path)


def state_folder() -> Path:
    """Return RIG_STATE_DIR, or the user's state folder."""
    chosen = os.environ.get("RIG_STATE_DIR")
    return Path(chosen) if chosen else user_state_path("indentation-rig")
