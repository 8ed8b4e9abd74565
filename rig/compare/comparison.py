"""Comparison of stimuli with recordings: shape tests, correlations, joint fits, positions that no run covers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from rig.compare.exceptions import ComparisonError
from rig.compare.fit import Fit, Flags, correlation, fit_all, in_play
from rig.compare.plausible_fingers import PlausibleFingers
from rig.compare.profile_shape_test import THRESHOLD, shape_flags
from rig.compare.recordings.recording import Recording
from rig.compare.stimuli import FAMILIES, StimulusRow
from rig_shared.natural_order import natural_order
from rig_shared.outputs import CommandLine, File, Name, Output, Range, Shape
from sim.measures.measures import MEASURES
from sim.models.small_strain_error import SmallStrain, small_strain

if TYPE_CHECKING:
    from rig.compare.wider_run import WiderRun

Array = NDArray[np.float64]
Pair = tuple[int, int]
"""Values by measure and receptor."""

COLLINEAR = 0.98
"""|r| from which two measures count as nearly collinear."""

NEAR_CENTRE_MM = 0.25
"""Largest distance from x = 0 (mm) of a receptor at which bars must pass."""


class MissingPositionsJson(Output):
    """Positions that one receptor does not cover."""

    receptor_mm: float
    positions_mm: list[float]


class LeftOutOfRecordingJson(Output):
    """Positions of a recording that are left out."""

    shape: Shape
    condition: Name
    recording: File
    positions: int
    left_out: list[MissingPositionsJson]
    range_needed_mm: Range
    covered_receptor_x_mm: list[float]
    command: CommandLine
    covered_by_command: int


@dataclass(frozen=True)
class Overlay:
    """Recording aligned with the SSRPs of one stimulus, in the frame x_indentor = position + x_receptor."""

    stimulus: StimulusRow
    recording: Recording

    @cached_property
    def eps(self) -> Array:
        """SSRPs (18, p, receptors) at the recorded positions; NaN outside the schedule of the run."""
        return self.stimulus.at(self.recording.position_mm)

    @cached_property
    def eps_on_fingers(self) -> Array:
        """SSRPs (fingers, 18, p, receptors) on the design of plausible fingers."""
        return self.stimulus.on_fingers_at(self.recording.position_mm)

    @cached_property
    def r(self) -> Array:
        """Pearson's correlation (18, receptors)."""
        return correlation(self.eps, self.recording.rate)

    @cached_property
    def used(self) -> NDArray[np.int64]:
        """Numbers (receptors,) of recorded positions that a receptor's SSRP covers: the n of `r`."""
        return np.asarray(np.isfinite(self.eps[0]).sum(axis=0))


@dataclass(frozen=True)
class Joint:
    """Recordings of one family under one condition, with one k and one ε₀ for each pair."""

    overlays: tuple[Overlay, ...]

    @property
    def title(self) -> str:
        """Title, e.g. "step:1, step:3, step:5 at 8 gwt"."""
        return _conditions([overlay.stimulus for overlay in self.overlays])

    @cached_property
    def eps(self) -> Array:
        """SSRPs (18, all positions, receptors)."""
        return np.concatenate([overlay.eps for overlay in self.overlays], axis=1)

    @cached_property
    def rate(self) -> Array:
        """Mean rates (all positions,)."""
        return np.concatenate([overlay.recording.rate for overlay in self.overlays])

    @cached_property
    def fit(self) -> Fit:
        """Fit (18, receptors)."""
        return fit_all(self.eps, self.rate)

    @cached_property
    def explained(self) -> Array:
        """R² (18, receptors) over the positions that each pair covers."""
        return self.explained_by(self.fit)

    def explained_by(self, fit: Fit) -> Array:
        """Return R² of another fit of every pair."""
        known = ~np.isnan(self.eps)
        y = np.where(known, self.rate[:, None], np.nan)
        with np.errstate(invalid="ignore", divide="ignore"):
            n = known.sum(axis=1)
            total = np.nansum(y * y, axis=1) - np.nansum(y, axis=1) ** 2 / n
            return np.asarray(1 - fit.rss / total)

    @cached_property
    def in_play(self) -> Flags:
        """Flags (receptors,) of receptors whose SSRPs cover enough of the recordings."""
        return in_play(self.eps)

    @cached_property
    def eps_on_fingers(self) -> Array:
        """SSRPs (fingers, 18, all positions, receptors) on the design of plausible fingers."""
        return np.concatenate([overlay.eps_on_fingers for overlay in self.overlays], axis=2)


@dataclass(frozen=True)
class Comparison:
    """Stimuli in order, with the recordings that belong to them."""

    stimuli: tuple[StimulusRow, ...]
    overlays: tuple[Overlay, ...]
    plausible: PlausibleFingers | None = None
    normalized: bool = False  # rates of each family have their own unit
    wider: Mapping[StimulusRow, "WiderRun"] = field(default_factory=dict)
    """Range that would cover more of the recording, for stimuli that leave positions out."""

    @property
    def interpolated(self) -> bool:
        """Flag of a comparison in which plausible fingers were interpolated."""
        return any(overlay.stimulus.interpolated for overlay in self.overlays)

    @property
    def small_strain(self) -> SmallStrain:
        """Difference between finite strain and small strain at the deepest press."""
        deepest = max(self.stimuli, key=lambda s: float(np.max(s.doi_mm)), default=None)
        if deepest is None:
            return small_strain("finger", 0.0)
        depth_mm = float(np.max(deepest.doi_mm))
        return small_strain("finger", depth_mm, deepest.stiffening, compared=deepest.default_finger)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """Overlays grouped by family and condition; each other shape on its own."""
        ordered = sorted(self.overlays, key=lambda p: _ordered_group(p.stimulus))
        return tuple(Joint(tuple(group)) for _, group in groupby(ordered, key=lambda p: _group(p.stimulus)))

    @property
    def judged(self) -> list[StimulusRow]:
        """Stimuli to report: a shape test is defined, or a recording exists."""
        recorded = [overlay.stimulus for overlay in self.overlays]
        return [s for s in self.stimuli if s in recorded or self.passes(s) is not None]

    def passes(self, stimulus: StimulusRow, threshold: float = THRESHOLD) -> Flags | None:
        """Return (18, receptors) results of the shape test, or None if none is defined."""
        key = stimulus, threshold
        if key not in self._passed:
            profiles = np.moveaxis(stimulus.measures, 1, -1)
            self._passed[key] = shape_flags(stimulus.indentor, stimulus.x_mm, profiles, threshold)
        return self._passed[key]

    def candidates(self, threshold: float = THRESHOLD, stimuli: Sequence[StimulusRow] | None = None) -> list[str]:
        """Return measures that pass at one receptor under every step, and at one near x = 0 under every bar.

        `stimuli` defaults to all. The list is empty if there is neither a step nor a bar.
        """
        found = {family: self._passing(family, threshold, stimuli or self.stimuli) for family in FAMILIES}
        families = [flags for flags in found.values() if flags is not None]
        if not families:
            return []
        return [name for name, passed in zip(MEASURES, np.logical_and.reduce(families), strict=True) if passed]

    def candidates_by_condition(self, threshold: float = THRESHOLD) -> list[tuple[str, list[str]]]:
        """Return the candidates for each condition of a family, and for every pair of steps and bars."""
        steps, bars = ([g for g in self._groups if g[0].family == family] for family in FAMILIES)
        named = [(_conditions(group), group) for group in (*steps, *bars)]
        named += [(f"{_conditions(a)} and {_conditions(b)}", [*a, *b]) for a in steps for b in bars]
        return [(name, self.candidates(threshold, group)) for name, group in named]

    def collinear(self) -> list[tuple[str, list[list[str]]]]:
        """Return, for each family and condition, the groups of nearly collinear measures.

        Measures are linked if |r| over all positions and receptors is at least `COLLINEAR`. A stimulus at a single
        position is ignored.
        """
        moved = [group for group in self._groups if any(len(stimulus.x_mm) > 1 for stimulus in group)]
        return [(_conditions(group), _collinear(group)) for group in moved]

    @cached_property
    def _passed(self) -> dict[tuple[StimulusRow, float], Flags | None]:
        """Return the results of the shape test, computed once per stimulus and threshold."""
        return {}

    @cached_property
    def _groups(self) -> list[list[StimulusRow]]:
        return [list(group) for _, group in groupby(self.stimuli, key=_group)]

    def _passing(self, family: str, threshold: float, stimuli: Sequence[StimulusRow]) -> Flags | None:
        """Return (18,) flags of measures that pass at some receptor under every stimulus of a family."""
        flags = []
        for stimulus in stimuli:
            passed = self.passes(stimulus, threshold) if stimulus.family == family else None
            if passed is not None:
                near = np.abs(stimulus.receptor_mm) <= NEAR_CENTRE_MM
                flags.append(passed & near if family == "bar" else passed)
        return np.logical_and.reduce(flags).any(axis=1) if flags else None


def compare(
    stimuli: Sequence[StimulusRow],
    recordings: Mapping[str, Recording],
    *,
    normalize: bool = False,
    plausible: PlausibleFingers | None = None,
) -> Comparison:
    """Pair each recording, by its shape's canonical name, with every stimulus of that shape.

    A name such as "step:1@8 gwt" selects one condition.

    `normalize` divides rates by the largest mean rate of their family; `plausible` describes the further fingers in
    the stimuli. Raises ComparisonError if two runs pressed the same shape to the same target, or if no run pressed a
    recorded shape.
    """
    if normalize:
        recordings = _normalized(recordings)
    ordered = tuple(sorted(stimuli, key=lambda s: (*_ordered_group(s), natural_order(s.shape))))
    _refuse_twins(ordered)
    _refuse_strays(ordered, recordings)
    laid = [(s, recordings.get(f"{s.shape}@{s.condition}", recordings.get(s.shape))) for s in ordered]
    overlays = tuple(Overlay(s, found) for s, found in laid if found is not None)
    return Comparison(ordered, overlays, plausible, normalize)


def _refuse_twins(ordered: Sequence[StimulusRow]) -> None:
    for one, other in pairwise(ordered):
        if (_group(one), one.shape) == (_group(other), other.shape):
            raise ComparisonError(
                f"runs {one.run} and {other.run} both contain {one.title}; give only one of them", "held_twice"
            )


def _refuse_strays(ordered: Sequence[StimulusRow], recordings: Mapping[str, Recording]) -> None:
    held = {stimulus.shape for stimulus in ordered}
    conditions = {f"{stimulus.shape}@{stimulus.condition}" for stimulus in ordered}
    for shape in recordings:
        if shape not in held | conditions:
            same = [one.title for one in ordered if one.shape == shape.partition("@")[0]]
            names = ", ".join(sorted(same or held, key=natural_order))
            known = f"{names}; use that" if same else f"no such shape; use one of {names}"
            raise ComparisonError(f"--recorded {shape}: the runs contain {known}", "never_pressed")


def _normalized(recordings: Mapping[str, Recording]) -> dict[str, Recording]:
    families: dict[str, float] = {}
    for shape, found in recordings.items():
        family = shape.partition(":")[0]
        families[family] = max(families.get(family, 0.0), float(found.rate.max()))
    return {s: found.normalized(families[s.partition(":")[0]] or 1.0) for s, found in recordings.items()}


def _group(stimulus: StimulusRow) -> tuple[str, str, float]:
    """Return the group of stimuli that are tested together."""
    family = stimulus.family if stimulus.family in FAMILIES else stimulus.shape
    return family, stimulus.kind, stimulus.commanded


def _ordered_group(stimulus: StimulusRow) -> tuple[object, ...]:
    family, kind, commanded = _group(stimulus)
    return natural_order(family), kind, commanded


def _collinear(group: Sequence[StimulusRow]) -> list[list[str]]:
    values = np.concatenate([stimulus.measures.reshape(len(MEASURES), -1) for stimulus in group], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):  # a constant measure is collinear with none
        linked = np.abs(np.corrcoef(values)) >= COLLINEAR
    _, number = connected_components(linked, directed=False)
    groups = [[name for name, mine in zip(MEASURES, number, strict=True) if mine == k] for k in np.unique(number)]
    return [names for names in groups if len(names) > 1]


def _conditions(group: Sequence[StimulusRow]) -> str:
    """Return the title of a group, e.g. "step:1, step:3, step:5 at 8 gwt"."""
    return f"{', '.join(stimulus.indentor for stimulus in group)} at {group[0].condition}"


_DECIMALS = 6


def left_out(overlay: Overlay) -> NDArray[np.bool_]:
    """Return (p, receptors) flags of recorded positions at which a receptor's SSRP is unknown."""
    return np.isnan(overlay.eps[0])


def range_needed(overlay: Overlay) -> tuple[float, float]:
    """Return the lowest and highest x (mm) of a run that covers the recording at every receptor."""
    position, receptor = overlay.recording.position_mm, overlay.stimulus.receptor_mm
    return float(position.min() + receptor.min()), float(position.max() + receptor.max())


def covered_receptors(overlay: Overlay) -> list[float]:
    """Return the x (mm) of the receptors that the run covers at every recorded position.

    If it covers none of the overlay's, one in the middle of those that it would cover; empty if there is none.
    """
    at = overlay.stimulus.receptor_mm[~left_out(overlay).any(axis=0)]
    if len(at):
        return _rounded(at)
    position, x_mm = overlay.recording.position_mm, overlay.stimulus.x_mm
    low, high = x_mm.min() - position.min(), x_mm.max() - position.max()
    return _rounded(np.array([0.5 * (low + high)])) if low <= high else []


def left_out_rows(comparison: Comparison) -> list[LeftOutOfRecordingJson]:
    """Return the uncovered positions of each recording at each receptor, for `--json`."""
    return [_row(overlay, comparison.wider.get(overlay.stimulus)) for overlay in comparison.overlays]


def _row(overlay: Overlay, wider: "WiderRun | None") -> LeftOutOfRecordingJson:
    missing = left_out(overlay)
    ends = range_needed(overlay) if wider is None else (wider.to_mm, wider.from_mm)
    return {
        "shape": overlay.stimulus.indentor,
        "condition": overlay.stimulus.condition,
        "recording": overlay.recording.name,
        "positions": len(missing),
        "left_out": [
            {"receptor_mm": round(float(x), _DECIMALS), "positions_mm": _rounded(overlay.recording.position_mm[gone])}
            for x, gone in zip(overlay.stimulus.receptor_mm, missing.T, strict=True)
            if gone.any()
        ],
        "range_needed_mm": (round(ends[0], _DECIMALS), round(ends[1], _DECIMALS)),
        "covered_receptor_x_mm": covered_receptors(overlay),
        "command": wider.command if wider else "",
        "covered_by_command": wider.measured if wider else len(missing) - int(missing.any(axis=1).sum()),
    }


def left_out_lines(comparison: Comparison) -> list[str]:
    """Return a sentence for each recording that is not covered at every receptor."""
    return [
        left_out_line(overlay, comparison.wider.get(overlay.stimulus))
        for overlay in comparison.overlays
        if left_out(overlay).any()
    ]


def left_out_line(overlay: Overlay, wider: "WiderRun | None", used: Flags | None = None) -> str:
    """Return how many positions are left out, why, and what would measure them.

    `used` (p,) are the positions of a comparison; default: those that every receptor covers.
    """
    stimulus = overlay.stimulus
    if used is None:
        used = np.asarray(~left_out(overlay).any(axis=1))
    low, high = range_needed(overlay)
    what = (
        f"{(~used).sum()} of {len(used)} positions of {overlay.recording.name} are left out: {stimulus.title} was "
        f"pressed from {_end(stimulus.x_mm.max())} to {_end(stimulus.x_mm.min())} mm, and the receptors need it "
        f"from {_end(high)} to {_end(low)} mm"
    )
    covered = covered_receptors(overlay)
    own = f"; `--receptor-x-mm={','.join(map(_end, covered))}` compares all of them" if covered else ""
    if wider is None:
        return f"{what}{own}."
    reach = f"from {_end(wider.from_mm)} to {_end(wider.to_mm)} mm"
    if not wider.wider:
        return f"{what}{own}; the planner accepts no wider run."
    by = f"`{wider.command}`" if wider.command else f"a run of {stimulus.title} {reach}"
    if wider.complete:
        return f"{what}{own}; {by} would cover all of them."
    return f"{what}{own}; {by} would cover {wider.measured} at every receptor, and the planner accepts no wider run."


def _end(x_mm: float) -> str:
    return f"{round(float(x_mm), 3) + 0.0:g}"


def _rounded(position: NDArray[np.float64]) -> list[float]:
    return [round(float(x), _DECIMALS) + 0.0 for x in position]
