"""Modules of POSIX systems for the studies that fork, limit or signal processes; elsewhere such a study refuses.

from studies.posix import os, resource
"""

import sys

REFUSES = "This study needs Linux or macOS."

if sys.platform == "win32":
    from typing import Any

    class _Absent:
        """Module that is not available."""

        def __getattr__(self, name: str) -> Any:
            raise SystemExit(REFUSES)

    def forking() -> Any:
        """Return the context of forked processes."""
        raise SystemExit(REFUSES)

    os: Any = _Absent()
    pty: Any = _Absent()
    resource: Any = _Absent()
    signal: Any = _Absent()
    tty: Any = _Absent()
else:
    import multiprocessing
    import os
    import pty
    import resource
    import signal
    import tty
    from multiprocessing.context import ForkContext

    def forking() -> ForkContext:
        """Return the context of forked processes."""
        return multiprocessing.get_context("fork")


__all__ = ["forking", "os", "pty", "resource", "signal", "tty"]
