"""Prescribed force: the depth at which the monotone force–DOI curve reaches it."""

from collections.abc import Callable
from dataclasses import replace

from sim.contact.solver import ContactState
from sim.errors import SimError

_TOLERANCE = 1e-11
_MAX_SOLVES = 40
_NO_CLOSER_MM = 1e-3
_EXPONENT = 1.5  # a point contact of a sphere; only the start and the scale of the secant depend on it


class ForceNotReachedError(SimError, ValueError):
    """Error of a force beyond the deepest indentation allowed."""

    default_code = "force_not_reached"


class TooDeepError(SimError, ValueError):
    """Error of a depth without a solution; a smaller depth may have one."""

    default_code = "too_deep"


def solve_for_force(
    force: float,
    first_guess_mm: float,
    deepest_mm: float,
    solve: Callable[[float, ContactState | None], ContactState],
    factor: Callable[[float], float] = lambda doi_mm: 1.0,
) -> tuple[float, ContactState]:
    """Return the DOI in mm and the state at which a force is reached, by a bracketed secant on F^(2/3).

    The force at a depth is `factor` times the state's. Where it jumps across the target, the remaining difference
    counts as residual. Raises ForceNotReachedError if the deepest indentation does not reach the force, and
    TooDeepError if the solver fails before.
    """
    goal = force ** (1 / _EXPONENT)
    low, f_low = 0.0, 0.0
    high, f_high = deepest_mm, None
    refused: TooDeepError | None = None  # at `high`
    doi, previous, state = min(first_guess_mm, deepest_mm), (0.0, 0.0), None
    for _ in range(_MAX_SOLVES):
        try:
            state = solve(doi, state)
        except TooDeepError as error:
            if doi - low < _NO_CLOSER_MM:
                raise
            high, f_high, refused = doi, None, error
            doi = 0.5 * (low + high)
            continue
        reached = state.normal_force * factor(doi)
        if abs(reached - force) <= _TOLERANCE * force:
            return doi, state
        value = max(reached, 0.0) ** (1 / _EXPONENT)
        if reached < force:
            if doi >= deepest_mm:
                raise ForceNotReachedError(f"not reached at the largest DOI allowed, {deepest_mm:g} mm")
            if refused and high - doi < _NO_CLOSER_MM:
                raise refused
            low, f_low = doi, value
        else:
            high, f_high, refused = doi, value, None
        x, f = previous
        previous = (doi, value)
        guess = doi + (goal - value) * (doi - x) / (value - f) if value != f else high
        if not low < guess < high:
            guess = high if f_high is None else low + (high - low) * (goal - f_low) / (f_high - f_low)
        if not low < guess < high and (f_high is not None or refused):
            guess = 0.5 * (low + high)
        if high - low <= 1e-15 * high:
            break
        doi = guess
    assert state is not None
    missed = abs(state.normal_force * factor(previous[0]) - force) / force
    return previous[0], replace(state, residual=max(state.residual, missed))
