"""A reading that stays the same although the stage moves in contact: frozen, or the motor does not turn."""

_MOVES, _STEPS, _SHARE = 3, 5, 0.1


class Unanswered:
    """Moves, and the change of force (gwt) that was expected of them, since the reading last changed."""

    def __init__(self, resolution_gwt: float) -> None:
        self._resolution_gwt, self._moves, self._expected_gwt = resolution_gwt, 0, 0.0

    def too_long(self, before_gwt: float, force_gwt: float, expected_gwt: float) -> bool:
        """Whether the force has not answered by any step of the sensor for far too long, this move included."""
        if abs(force_gwt - before_gwt) > 0.5 * self._resolution_gwt:
            self._moves, self._expected_gwt = 0, 0.0
            return False
        self._expected_gwt += expected_gwt
        self._moves += 1
        enough_gwt = max(_STEPS * self._resolution_gwt, _SHARE * force_gwt)
        return self._moves >= _MOVES and self._expected_gwt > enough_gwt
