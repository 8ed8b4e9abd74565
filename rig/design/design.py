"""A design from request to result: presses, script, expected confusion beside usual designs, and sample sizes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from rig.compare.place_grid import nodes
from rig.compare.plausible_fingers import PlausibleFingers
from rig.design.choose import QUICK, ChosenPresses, Effort, PressChooser, some_of
from rig.design.confusion import Confusion, DesignName, OrderedDesign, expected_confusion
from rig.design.counts import CountModel
from rig.design.exceptions import DesignError
from rig.design.fibers import Unknowns
from rig.design.order import blocks_of, carry_over, history, imbalance, ordered
from rig.design.press_times import PressTimes, allowed, press_times
from rig.design.presses import Kind, PossiblePress, possible_presses
from rig.design.recorded_counts import SessionVerdict, read_counts, session_verdict
from rig.design.refined import FEW
from rig.design.response_table import (
    CANDIDATES,
    DEPTH_STEP_MM,
    X_STEP_MM,
    Counted,
    ResponseTable,
    finger_with_nodes,
    response_table,
)
from rig.design.usual_designs import everything, usual_designs
from rig.plan.config import Config
from sim.config import FingertipConfig
from sim.contact.shapes import parse_shape, shape_name
from sim.finger_process import Finger
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

CURVE_MIN = (5.0, 10.0, 20.0, 40.0)
"""Durations at which designs are compared (min)."""

BOUND_MIN = 60.0
"""Duration of the design of all presses, which bounds what this bench can separate (min)."""

DESIGNED: DesignName = "designed"

DEPTHS_MM = (0.25, 0.5, 0.75, 1.0)
"""Depths to choose from, by default."""


@dataclass(frozen=True)
class DesignRequest:
    """Request for a design. `targets` are depths (mm) or forces (gwt), by `kind`."""

    candidates: tuple[str, ...] = MEASURES
    shapes: tuple[str, ...] = ("step:1", "bar:3.0", "cylinder:3")
    minutes: float = 20.0
    kind: Kind = "doi_mm"
    targets: tuple[float, ...] = DEPTHS_MM
    unknowns: Unknowns = field(default_factory=Unknowns)
    hold_s: float = 1.0
    rest_s: float = 2.0
    change_s: float = 60.0
    seed: int = 1
    quick: bool = False

    def refuse(self) -> None:
        """Raise DesignError for candidates that do not exist; ShapeError for shapes that do not."""
        for name in self.candidates:
            if name not in CANDIDATES:
                raise DesignError(f"--candidates {name}: must be among {', '.join(CANDIDATES)}", "unknown_candidate")
        if len(set(self.candidates)) < 2 or len(set(self.candidates)) < len(self.candidates):
            raise DesignError(
                f"--candidates {', '.join(self.candidates)}: must be two or more different ones", "too_few_candidates"
            )
        names = list(map(shape_name, self.shapes))
        for number, shape in enumerate(self.shapes):
            parse_shape(shape)
            if names[number] in names[:number]:
                raise DesignError(f"--shapes: {shape} is named twice; remove one", "shape_twice")
        for target in self.targets:
            if not (math.isfinite(target) and target > 0):
                raise DesignError(f"{self.kind} = {target:g}: must be a positive number", "not_positive")


class Sizes(NamedTuple):
    """Experiments for each design, draws of fibers for each candidate, and effective draws that suffice."""

    experiments: int
    draws: int
    of_curve: int
    draws_of_curve: int
    draws_of_bound: int
    few: float


_COARSE = 3.0
_SIZES, _QUICK_SIZES = Sizes(360, 16384, 180, 8192, 16384, FEW), Sizes(120, 4096, 60, 2048, 4096, _COARSE)


@dataclass(frozen=True, eq=False)
class Design:
    """Design with all results on its page.

    `made` is the design in order. `outcomes` has every design at every duration, and `outcome` this one at the
    requested duration; `bound` all presses in an hour.
    """

    request: DesignRequest
    table: ResponseTable
    times: PressTimes
    chosen: ChosenPresses
    blocks: tuple[Ints, ...]
    made: OrderedDesign
    outcomes: tuple[Confusion, ...]
    bound: Confusion
    possible: int
    carried_over: float | None
    fingers: int

    @property
    def presses(self) -> list[PossiblePress]:
        """Presses in order."""
        return [self.table.presses[k] for k in self.made.order]

    @property
    def duration_s(self) -> float:
        """Duration with homing, rests and changes of indentor (s)."""
        return self.times.session_s(self.made.order.tolist(), len(self.chosen.shapes))

    @property
    def outcome(self) -> Confusion:
        """Expected confusion of this design."""
        return self.at(DESIGNED, self.request.minutes)

    def at(self, name: str, minutes: float) -> Confusion:
        """Return the outcome of a design at a duration."""
        return next(one for one in self.outcomes if one.name == name and one.minutes == minutes)

    @property
    def durations(self) -> list[float]:
        """Durations at which there are outcomes (min)."""
        return sorted({one.minutes for one in self.outcomes})

    @property
    def names(self) -> list[str]:
        """Names of the designs, this one first."""
        return list(dict.fromkeys(one.name for one in self.outcomes))

    @property
    def dependence(self) -> float:
        """Largest |correlation| of a press with the one before, over the blocks."""
        return max(history(block, self.table.presses) for block in self.blocks)

    @property
    def imbalance(self) -> float:
        """Largest difference of how often a depth follows another from independence, over the blocks."""
        return max(imbalance(block, self.table.presses) for block in self.blocks)


def design(
    request: DesignRequest,
    config: Config,
    finger: Finger,
    plausible: PlausibleFingers | None,
    count: Counted,
    progress: Progress,
) -> Design:
    """Return the design; raise DesignError if the request does not fit the bench.

    `count` shows the progress of the table of responses; `progress` gets what is computed, and how far it is.
    """
    with threadpool_limits(1):  # many small products of matrices, which threads only slow down
        table, times, possible = bench_of(request, config, finger, plausible, count, progress)
        return _designed(request, config, table, times, possible, progress)


def judged(
    request: DesignRequest,
    path: Path,
    config: Config,
    finger: Finger,
    plausible: PlausibleFingers | None,
    count: Counted,
    progress: Progress,
) -> SessionVerdict:
    """Return the verdict on the counts in a file, for the same request that designed the session.

    Raises RecordingError for the file, DesignError for the request.
    """
    request.refuse()
    read_counts(path, possible_presses(request.shapes, request.kind, request.targets), request.hold_s)  # early
    with threadpool_limits(1):
        table, times, _ = bench_of(request, config, finger, plausible, count, progress)
        counted = read_counts(path, table.presses, request.hold_s)
        progress("session compared with the candidates", 0, 1)
        model = CountModel(request.hold_s, request.unknowns)
        return session_verdict(table, times, request.candidates, model, counted, _SIZES.draws, request.seed)


def finger_of(request: DesignRequest, config: FingertipConfig) -> Fingertip:
    """Return the finger with the receptors of the table of responses, so that it is factorized once for both.

    Raises DesignError.
    """
    request.refuse()
    return finger_with_nodes(config, *_nodes(request))


def _nodes(request: DesignRequest) -> tuple[Array, Array]:
    return nodes(request.unknowns.x_mm, X_STEP_MM), nodes(request.unknowns.below_mm, DEPTH_STEP_MM)


def bench_of(
    request: DesignRequest,
    config: Config,
    finger: Finger,
    plausible: PlausibleFingers | None,
    count: Counted,
    progress: Progress,
) -> tuple[ResponseTable, PressTimes, int]:
    """Return the presses within the limits with their responses, their times, and how many there were at first."""
    request.refuse()
    if plausible is not None and "receptor_depth_mm" in plausible.ranges:
        raise DesignError(
            f"{plausible.source}: receptor_depth_mm belongs into --receptor-below-mm; remove it", "depth_of_receptor"
        )
    possible = possible_presses(request.shapes, request.kind, request.targets)
    table = response_table(config.finger, possible, *_nodes(request), plausible, count)
    # Bands of an identified finger take minutes for so many presses; the script is checked against them.
    single = config.model_copy(update={"identified": None})
    table = allowed(single, finger, table, request.hold_s, _part(progress, "presses compared with the limits"))
    progress("rehearsal of a few presses", 0, 1)
    times = press_times(single, finger, table, request.hold_s, request.rest_s, request.change_s)
    return table, times, len(possible)


def _designed(
    request: DesignRequest, config: Config, table: ResponseTable, times: PressTimes, possible: int, progress: Progress
) -> Design:
    model = CountModel(request.hold_s, request.unknowns)
    effort, sizes = (QUICK, _QUICK_SIZES) if request.quick else (Effort(), _SIZES)
    chooser = PressChooser(table, request.candidates, model, times, effort, request.seed)
    minutes = request.minutes
    coarse = chooser.coarse(minutes, some_of(request.shapes), _part(progress, "combinations of shapes"))
    chosen = chooser.chosen(minutes, coarse.shapes, _part(progress, "groups of presses"))
    blocks = blocks_of(chosen.repeats, table.presses, chosen.shapes, request.seed)
    made = ordered(DESIGNED, blocks, times, minutes)
    main = [made, *usual_designs(table.presses, times, minutes, request.seed)]
    curve: list[OrderedDesign] = []
    for other in () if request.quick else CURVE_MIN:
        if other != minutes:
            curve += _at(chooser, request, coarse.shapes, other, progress)
    bound = everything(table.presses, times, BOUND_MIN)
    evaluate = _Evaluation(table, request, model, progress)
    outcomes = [
        *evaluate(main, sizes.experiments, sizes.draws, sizes.few, "steps of the outcome"),
        *evaluate(curve, sizes.of_curve, sizes.draws_of_curve, _COARSE, "steps of outcomes after other durations"),
    ]
    (most,) = evaluate(
        [bound], sizes.of_curve, sizes.draws_of_bound, sizes.few, "steps of the outcome of all presses"
    )
    series = _relaxation(config)
    gap_s = float(times.press_s.mean()) - request.hold_s
    carried = carry_over(series, request.hold_s, gap_s) if series else None
    return Design(
        request,
        table,
        times,
        chosen,
        tuple(blocks),
        made,
        tuple(outcomes),
        most,
        possible,
        carried,
        len(table.values),
    )


def _at(
    chooser: PressChooser, request: DesignRequest, shapes: tuple[str, ...], minutes: float, progress: Progress
) -> list[OrderedDesign]:
    """Return the designs of another duration; none if it is too short for one press.

    A shorter one may need fewer shapes than the requested duration, a longer one more.
    """
    table, times = chooser.table, chooser.times
    likely = some_of(shapes) if minutes < request.minutes else [shapes, request.shapes[:3]]
    try:
        coarse = chooser.coarse(
            minutes, list(dict.fromkeys(likely)), _part(progress, "combinations of shapes for another duration")
        )
    except DesignError:
        return []
    blocks = blocks_of(coarse.repeats, table.presses, coarse.shapes, request.seed)
    return [
        ordered(DESIGNED, blocks, times, minutes),
        *usual_designs(table.presses, times, minutes, request.seed),
    ]


@dataclass(frozen=True)
class _Evaluation:
    table: ResponseTable
    request: DesignRequest
    model: CountModel
    progress: Progress

    def __call__(
        self, designs: Sequence[OrderedDesign], experiments: int, draws: int, few: float, what: str
    ) -> list[Confusion]:
        if not designs:
            return []
        names = self.request.candidates
        each = -(-experiments // len(names))
        shown = _part(self.progress, what)
        return expected_confusion(self.table, names, self.model, designs, each, draws, self.request.seed, shown, few)


def _part(progress: Progress, what: str) -> Callable[[int, int], None]:
    return lambda done, total: progress(what, done, total)


def _relaxation(config: Config) -> tuple[tuple[float, float], ...]:
    """Return the Prony series of the configured or identified finger; empty if it does not relax."""
    if config.virtual.relaxation:
        return config.virtual.relaxation
    return () if config.identified is None else config.identified.draw[0].relaxation


def with_own_outcome(found: Design) -> Design:
    """Return a design that was shortened with the outcome of the presses that are left."""
    request, sizes = found.request, _QUICK_SIZES if found.request.quick else _SIZES
    model = CountModel(request.hold_s, request.unknowns)
    evaluate = _Evaluation(found.table, request, model, lambda *_: None)
    (mine,) = evaluate([found.made], sizes.experiments, sizes.draws, sizes.few, "")
    kept = (mine if one is found.outcome else one for one in found.outcomes)
    return replace(found, outcomes=tuple(kept))


def shortened(found: Design, presses: int) -> Design:
    """Return the design without its last presses; its outcome is still that of all of them."""
    left, blocks = presses, []
    for block in found.blocks:
        blocks.append(block[: max(left, 0)])
        left -= len(block)
    kept = tuple(block for block in blocks if len(block))
    return replace(found, blocks=kept, made=ordered(DESIGNED, kept, found.times, found.request.minutes))
