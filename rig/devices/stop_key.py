"""Stop button: USB key or foot switch, a Linux input device reserved for this program.

Source: Linux kernel documentation, input event interface (`struct input_event`, EVIOCGRAB, EVIOCGKEY). A named pipe
with the same events can replace a device.
"""

import os
import select
import stat
import struct
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rig.transport.wire import TransportError

if sys.platform == "win32":
    import errno

    _NONBLOCK = 0

    def _ioctl(file: int, request: int, argument: int | bytearray) -> None:
        raise OSError(errno.ENOSYS, "stop buttons on an input device need Linux")
else:
    import fcntl

    _NONBLOCK = os.O_NONBLOCK

    def _ioctl(file: int, request: int, argument: int | bytearray) -> None:
        fcntl.ioctl(file, request, argument)


_EVENT = struct.Struct("llHHi")  # seconds, microseconds, type, code, value
_KEY = 1
_RELEASED, _PRESSED = 0, 1
_GRAB = 0x40044590
_KEY_BYTES = 96
_HELD_KEYS = 0x80000000 | _KEY_BYTES << 16 | ord("E") << 8 | 0x18
_READ = 64 * _EVENT.size


class StopKeyError(TransportError):
    """Error of a stop button that cannot be read."""

    default_code = "no_button"


class StopKey:
    """Reserved input device with a reading thread; close() releases it.

    A press calls the function passed to arm(), in that thread. If the device disappears, `problem` is set.
    """

    def __init__(self, path: Path, code: int | None = None) -> None:
        """Open and reserve an input device, e.g. below /dev/input/by-id.

        `code` is the Linux code of the only key that counts. Raises StopKeyError if it is missing, is no input
        device, or is used by another program.
        """
        self.path, self.problem, self._why = path, "", ""
        self._code, self._held = code, set[int]()
        self._on_press: Callable[[], object] | None = None
        self._file = _opened(path)
        self._held.update(key for key in _held_keys(self._file) if self._counts(key))
        self._woken, self._wake = os.pipe()
        self._thread = threading.Thread(target=self._read, name="stop button", daemon=True)
        self._thread.start()

    @property
    def pressed(self) -> bool:
        """Whether the key is held down. Raises StopKeyError if that is unknown."""
        if self.problem:
            raise StopKeyError(self.problem, self._why)
        return bool(self._held)

    def arm(self, on_press: Callable[[], object]) -> None:
        """Call a function on each press from now on, in another thread; it must handle its own exceptions."""
        self._on_press = on_press

    def close(self) -> None:
        """Release the device."""
        os.write(self._wake, b".")
        self._thread.join()
        for file in (self._file, self._woken, self._wake):
            os.close(file)

    def _counts(self, code: int) -> bool:
        return self._code is None or self._code == code

    def _read(self) -> None:
        while True:
            ready, _, _ = select.select([self._file, self._woken], [], [])
            if self._woken in ready:
                return
            try:
                data = os.read(self._file, _READ)
            except OSError as error:
                self._why, self.problem = "gone", f"{self.path}: {error.strerror}"
                return
            if len(data) % _EVENT.size or not data:
                self._why, self.problem = (
                    "no_key_events",
                    f"{self.path}: the device was closed or sends no key events",
                )
                return
            for _, _, kind, code, value in _EVENT.iter_unpack(data):
                if kind == _KEY and self._counts(code):
                    self._changed(code, value)

    def _changed(self, code: int, value: int) -> None:
        if value == _RELEASED:
            self._held.discard(code)
        elif value == _PRESSED:  # Other values are repetitions.
            self._held.add(code)
            if self._on_press is not None:
                self._on_press()


def _opened(path: Path) -> int:
    try:
        pipe = stat.S_ISFIFO(path.stat().st_mode)
        file = os.open(path, (os.O_RDWR if pipe else os.O_RDONLY) | _NONBLOCK)
    except OSError as error:
        raise StopKeyError(
            f"{path}: {_what(error)}; connect the stop button, or correct stop.device", "not_opened"
        ) from None
    if pipe:
        return file
    try:
        _ioctl(file, _GRAB, 1)
    except OSError as error:
        os.close(file)
        raise StopKeyError(
            f"{path}: cannot be reserved for the rig: {_what(error)}; close other programs that use it", "not_grabbed"
        ) from None
    return file


def _what(error: Exception) -> str:
    return str(getattr(error, "strerror", error))


def _held_keys(file: int) -> list[int]:
    """Return the codes of the keys that are down at opening; none for a pipe."""
    bits = bytearray(_KEY_BYTES)
    with suppress(OSError):
        _ioctl(file, _HELD_KEYS, bits)
    return [8 * byte + bit for byte, word in enumerate(bits) for bit in range(8) if word >> bit & 1]
