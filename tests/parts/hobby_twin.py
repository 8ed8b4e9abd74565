"""The virtual twin of the hobby board."""

from sim.devices.grbl.board import VirtualGrbl


class VirtualHobby(VirtualGrbl):
    """A GRBL board with a name of its own."""

    def _execute_at_rest(self, line: str, now_s: float) -> int | None:
        if line == "$I":
            return self._print("[VER:1.1h.hobby:]")
        return super()._execute_at_rest(line, now_s)
