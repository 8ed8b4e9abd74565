"""Virtual devices in real time: ports that any program can open, and a finger that answers without blocking them.

`ports` run on a `real_time_loop`; `prefetch` has upcoming forces solved in a separate process (`force_process`).
"""

from sim.serve.ports import PortBusyError, PtyPort, TcpPort, UdpPort
from sim.serve.prefetch import PressAhead

__all__ = ["PortBusyError", "PressAhead", "PtyPort", "TcpPort", "UdpPort"]
