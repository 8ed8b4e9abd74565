"""Keys and text that wait at standard input: by the terminal driver of POSIX systems, or the console of Windows."""

import os
import queue
import sys
import threading
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rig.clock import WallClock

ReadKeys = Callable[[], bytes | None]
"""Returns the bytes typed since the last call, or None at the end of the input."""

if sys.platform == "win32":
    import msvcrt

    _POLL_S = 0.01
    _PREFIXES = ("\x00", "\xe0")  # before the code of a function or arrow key
    _CTRL_C = "\x03"

    def line_waits(within_s: float) -> bool:
        """Return whether a line has been begun at the keyboard, or True for a pipe, since that is unknown."""
        if not sys.stdin.isatty():
            return True
        clock = WallClock()
        deadline_s = clock.monotonic_s() + within_s
        while not msvcrt.kbhit():
            if clock.monotonic_s() >= deadline_s:
                return False
            clock.wait_s(_POLL_S)
        return True

    def text_waits(file: int) -> bool:
        """Return whether a pipe or a file has text to read; True, since that is unknown."""
        return True

    @contextmanager
    def single_keys() -> Iterator[ReadKeys]:
        """Yield a function that reads keys from standard input without waiting for the end of a line."""
        yield _console_keys if sys.stdin.isatty() else _in_a_thread(sys.stdin.fileno())

    def _console_keys() -> bytes:
        typed = ""
        while msvcrt.kbhit():
            key = msvcrt.getwch()
            if key == _CTRL_C:
                raise KeyboardInterrupt
            if key in _PREFIXES:
                msvcrt.getwch()
                key = "\x00"  # no key of ours, so that it releases a held one
            typed += key
        return typed.encode("utf-8", "replace")

    def _in_a_thread(file: int) -> ReadKeys:
        """Return a function that reads a pipe or file in a thread, because Windows cannot poll them."""
        read: queue.SimpleQueue[bytes] = queue.SimpleQueue()

        def serve() -> None:
            data = b"."
            while data:
                try:
                    data = os.read(file, 256)
                except OSError:
                    data = b""
                read.put(data)

        def keys() -> bytes | None:
            try:
                return read.get_nowait() or None
            except queue.Empty:
                return b""

        threading.Thread(target=serve, name="keys", daemon=True).start()
        return keys
else:
    import fcntl
    import select
    import termios
    import tty

    def line_waits(within_s: float) -> bool:
        """Return whether a line is waiting at the keyboard, or True if that is unknown."""
        try:
            return bool(select.select([sys.stdin], [], [], within_s)[0])
        except (OSError, ValueError, TypeError):  # not a file
            return True

    def text_waits(file: int) -> bool:
        """Return whether a pipe or a file has text to read. Raises OSError for a device that never has text."""
        waiting = array("i", [0])
        fcntl.ioctl(file, termios.FIONREAD, waiting)
        return waiting[0] > 0

    @contextmanager
    def single_keys() -> Iterator[ReadKeys]:
        """Yield a function that reads keys from standard input without waiting for the end of a line."""
        file = sys.stdin.fileno()

        def read() -> bytes | None:
            ready, _, _ = select.select([file], [], [], 0.0)
            try:
                return (os.read(file, 256) or None) if ready else b""
            except OSError:  # the terminal now belongs to another program
                return None

        if not os.isatty(file):
            yield read
            return
        before = termios.tcgetattr(file)
        tty.setcbreak(file)
        try:
            yield read
        finally:
            termios.tcsetattr(file, termios.TCSADRAIN, before)
