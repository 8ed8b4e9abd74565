"""How old what was heard is."""


def age_s(then_s: float | None, now_s: float) -> float | None:
    """Seconds, never less than none; None where nothing was heard."""
    return None if then_s is None else max(now_s - then_s, 0.0)
