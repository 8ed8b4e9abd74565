"""Where the finger was touched in this run, and so down to where nothing is met on the way to it."""

from rig.engine.rig_settings import RigSettings
from rig.engine.stopping import Stopping


class Touched:
    """Heights of first contact above the nominal apex, mm, by place; of one indentor, since the last homing."""

    def __init__(self, settings: RigSettings) -> None:
        self._settings = settings
        self._contact_mm: dict[tuple[float, float], float] = {}

    def at(self, x_mm: float, along_mm: float, contact_mm: float) -> None:
        """Contact was here, and the indentor has been lifted from it."""
        self._contact_mm[x_mm, along_mm] = contact_mm

    def forget_at(self, x_mm: float, along_mm: float) -> None:
        """What was here counts no more."""
        self._contact_mm.pop((x_mm, along_mm), None)

    def forget(self) -> None:
        """Nothing counts any more: another indentor, a new homing, somebody at the finger."""
        self._contact_mm.clear()

    def free_mm(self, x_mm: float, along_mm: float, speed_mm_s: float) -> float:
        """Above which height one move at this speed meets nothing, and stops in time for what has come nearer.

        The last contact here, the margin, and how far the stage goes on after a touch; clearance where that is lower,
        or where this place was not touched.
        """
        habits = self._settings.habits
        contact_mm = self._contact_mm.get((x_mm, along_mm))
        if contact_mm is None:
            return habits.clearance_mm
        goes_on_mm = Stopping.in_one_move(self._settings, speed_mm_s).distance_mm
        return min(contact_mm + habits.retouch_margin_mm + goes_on_mm, habits.clearance_mm)
