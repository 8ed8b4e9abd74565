"""Virtual devices in real time: ports that any program can open, and a finger that answers without blocking them.

`ports` on a `wall_clock`; `press_ahead` has coming forces solved in a process of its own (`press_process`).
"""

from sim.serve.ports import PortBusyError, PtyPort, TcpPort
from sim.serve.prefetch import PressAhead

__all__ = ["PortBusyError", "PressAhead", "PtyPort", "TcpPort"]
