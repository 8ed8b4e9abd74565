"""Virtual devices in real time: ports that any program can open, and a finger that answers without blocking them."""

from sim.serve.ports import PortBusyError, PtyPort, TcpPort
from sim.serve.press_ahead import PressAhead

__all__ = ["PortBusyError", "PressAhead", "PtyPort", "TcpPort"]
