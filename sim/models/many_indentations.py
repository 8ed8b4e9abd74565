"""Many indentations of one finger, in several processes if requested; each starts from rest."""

import os
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from multiprocessing import parent_process
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from sim.contact.indentor import Indentor
from sim.contact.profiles import IndentorProfile
from sim.errors import ArgumentError, SimError, refuse_unless_numbers
from sim.models.fingertip import Fingertip, Reference
from sim.models.pictures import ModelOutline
from sim.models.result import IndentationOutcome, IndentationRequest, IndentationResult, Indentations
from sim.tables import broadcast, numbers_of
from sim.workers import here_and_in_processes, keep_freed_memory

Shape = Indentor | IndentorProfile | str
Progress = Callable[[int, int], object]
Numbered = tuple[int, IndentationRequest]

_TASKS_A_CORE = 16
_MOST_PLACES_A_TASK = 16


class How(TypedDict):
    """Options that hold for every press of a call."""

    reference: Reference
    other_paths: bool


class WorkerLostError(SimError, RuntimeError):
    """Error of a process that ended before it answered."""

    default_code = "worker_lost"


def indent_many(
    finger: Fingertip,
    shapes: Shape | Sequence[Shape],
    x_mm: ArrayLike = 0.0,
    *,
    z_mm: ArrayLike | None = None,
    doi_mm: ArrayLike | None = None,
    force_gwt: ArrayLike | None = None,
    reference: Reference = "contact",
    other_paths: bool = False,
    friction: float | None = None,
    cores: int | None = 1,
    progress: Progress | None = None,
) -> Indentations:
    """Press shapes at positions, each to a depth or a force.

    Arguments broadcast against each other, and results keep that order. Each press starts from rest and is the same
    to the last bit as if it were the only one. A press that cannot be made is a row with its reason.

    Parameters
    ----------
    finger : Fingertip
        The finger.
    shapes : Indentor, IndentorProfile or str, or a sequence of these
        The shapes, for example ``["bar:3.0", "step:1"]``.
    x_mm : array_like, broadcast, optional
        Lateral positions (mm).
    z_mm : array_like, broadcast, optional
        Positions along the finger (mm). Default, also for nan: the receptor plane.
    doi_mm : array_like, broadcast, optional
        Depths of indentation (mm); nan where the row has a force.
    force_gwt : array_like, broadcast, optional
        Forces (gwt); nan where the row has a depth.
    reference : {'contact', 'apex'}, optional
        As in `Fingertip.indent`.
    other_paths : bool, optional
        As in `Fingertip.indent`.
    friction : float, optional
        As in `Fingertip.indent`.
    cores : int or None, optional
        Number of processes, this one included; None for one on each core. With more than one, call this function
        under ``if __name__ == "__main__":``.
    progress : callable, optional
        Called as ``progress(done, of)`` with numbers of presses.

    Returns
    -------
    Indentations
        Results and problems.

    Raises
    ------
    ArgumentError
        If there is neither a depth nor a force, `cores` is less than 1, or the arguments do not broadcast.
    WorkerLostError
        If a process was killed.

    Examples
    --------
    >>> from sim import indent_many, load
    >>> found = indent_many(load("halfspace"), ["cylinder:9", "sphere:4"], doi_mm=0.1)
    >>> [result.indentor.name for result in found]
    ['cylinder:9', 'sphere:4']
    """
    if doi_mm is None and force_gwt is None:
        raise ArgumentError("give a depth (doi_mm) or a force (force_gwt)", "no_target")
    if cores is not None:
        refuse_unless_numbers(cores=cores)
        if cores < 1:
            raise ArgumentError(f"cores = {cores}: must be 1 or more, or None for all", "no_cores")
    requests = _rows(shapes, x_mm=x_mm, z_mm=z_mm, doi_mm=doi_mm, force_gwt=force_gwt)
    if friction is not None:
        finger = finger.with_friction(friction)
    answers: dict[int, IndentationOutcome] = {}
    outlines: dict[Hashable, ModelOutline] = {}
    how: How = {"reference": reference, "other_paths": other_paths}
    for found in _outcomes(finger, how, _by_position(requests), cores or os.cpu_count() or 1):
        answers |= {row: _with_shared(answer, outlines) for row, answer in found}
        if progress:
            progress(len(answers), len(requests))
    return Indentations(tuple(requests), tuple(answers[row] for row in range(len(requests))))


def _rows(shapes: Shape | Sequence[Shape], **places: ArrayLike | None) -> list[IndentationRequest]:
    """Return one request for each element of the broadcast arguments."""
    named = {name: numbers_of(name, np.nan if values is None else values) for name, values in places.items()}
    every = [array.ravel().tolist() for array in broadcast(shapes=np.array(shapes, dtype=object), **named)]
    return [
        IndentationRequest(shape, x, *(None if np.isnan(value) else value for value in rest))
        for shape, x, *rest in zip(*every, strict=True)
    ]


def _by_position(requests: Sequence[IndentationRequest]) -> list[list[Numbered]]:
    """Group presses at the same position: their depths share one path."""
    groups: dict[Hashable, list[Numbered]] = defaultdict(list)
    for row, request in enumerate(requests):
        groups[request.shape, request.x_mm, request.z_mm].append((row, request))
    return list(groups.values())


def _outcomes(
    finger: Fingertip, how: How, groups: list[list[Numbered]], cores: int
) -> Iterator[list[tuple[int, IndentationOutcome]]]:
    """Yield outcomes with their rows, a few positions at a time."""
    press = partial(_press_groups, finger, how)
    if cores == 1 or len(groups) < 2:
        yield from (press([group]) for group in groups)
        return
    size = min(_MOST_PLACES_A_TASK, 1 + len(groups) // (_TASKS_A_CORE * cores))
    tasks = [groups[k : k + size] for k in range(0, len(groups), size)]
    try:
        yield from here_and_in_processes(press, tasks, min(cores, len(tasks)))
    except BrokenProcessPool:
        raise WorkerLostError(
            "a process ended before it returned a result: it was killed, memory ran out, or a script calls "
            'indent_many outside of `if __name__ == "__main__":`'
        ) from None


def _press_groups(finger: Fingertip, how: How, groups: list[list[Numbered]]) -> list[tuple[int, IndentationOutcome]]:
    if parent_process() is not None:
        keep_freed_memory()
    found = []
    for group in groups:
        here = finger.keeping_ways()
        found += [(row, _press(here, how, request)) for row, request in group]
    return found


def _press(finger: Fingertip, how: How, request: IndentationRequest) -> IndentationOutcome:
    shape, x_mm, z_mm, doi_mm, force_gwt = request
    try:
        result = finger.indent(shape, x_mm, z_mm=z_mm, doi_mm=doi_mm, force_gwt=force_gwt, **how)
    except ValueError as error:  # errors of models and shapes
        return IndentationOutcome(
            None, str(error), error.code if isinstance(error, SimError) else ArgumentError.default_code
        )
    if not result.state.converged:
        return IndentationOutcome(result, f"not converged, residual {result.state.residual:.0e}", "not_converged")
    return IndentationOutcome(result)


def _with_shared(answer: IndentationOutcome, outlines: dict[Hashable, Any]) -> IndentationOutcome:
    """Replace the outline of an outcome from another process by the one that its model's outcomes share."""
    result: IndentationResult | None = answer.result
    if result is None:
        return answer
    patch = result.model.patch
    outline = outlines.setdefault((patch.axes, patch.shape, result.model.widened_mm), result.model)
    return answer if outline is result.model else answer._replace(result=replace(result, model=outline))
