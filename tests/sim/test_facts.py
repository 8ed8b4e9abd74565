"""Facts that Raju (1998, ch. 4) reports of his three-dimensional model, on the default fingertip.

Nothing is tuned: layer thicknesses, nail and bone are the defaults of `sim.config`. Pressures are in pseudo-units,
raw nodal values unless said to be filtered; the source's plots went through a 4 × 1 median filter.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import find_peaks

from sim.config import MeshSpec
from sim.contact.profiles import BAR_EDGE_RADIUS_MM, STEP_HALF_WAVELENGTH_MM
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

Array = NDArray[np.float64]

SPACING_MM = MeshSpec().spacing_mm


@dataclass(frozen=True)
class InPlane:
    """Skin nodes in the receptor plane, seen from the indentor."""

    x_mm: Array  # undeformed
    s_mm: Array  # displaced, from the indentor's reference
    pressure: Array
    touching_mm: Array  # undeformed places that carry force, nodes and between
    touching_s_mm: Array  # the same, displaced, from the indentor's reference

    @classmethod
    def of(cls, result: IndentationResult) -> "InPlane":
        assert result.state.residual <= 1e-8, (result, result.state.residual)
        x, pressure = result.pressure_profile
        touching, moved = result.touching_mm
        return cls(x, result.skin_profile[0] - result.x_mm, pressure, touching, moved - result.x_mm)

    def near(self, s_mm: float) -> float:
        """Highest nodal pressure within one node of a place on the indentor."""
        close = np.abs(self.s_mm - s_mm) <= SPACING_MM
        return float(self.pressure[close].max(initial=0.0))


def median_of_four(x_mm: Array, pressure: Array) -> Array:
    """Pressure through the source's 4 × 1 filter: every 170 µm the mean of the middle two of four values."""
    even = np.interp(np.arange(x_mm[0], x_mm[-1], 0.17), x_mm, pressure)
    return np.sort(np.lib.stride_tricks.sliding_window_view(even, 4), axis=1)[:, 1:3].mean(axis=1)


# ------------------------------------------------------------------------------------------------- fact 1

HALF_MM = 1.5
FLAT_MM = HALF_MM - BAR_EDGE_RADIUS_MM  # where the rounding of the edge begins


@pytest.fixture(scope="module")
def bar(finger: Fingertip) -> dict[float, InPlane]:
    """The 3.0 mm bar, centred, at the source's four depths."""
    return {doi: InPlane.of(finger.indent("bar:3.0", 0.0, doi_mm=doi)) for doi in (0.33, 0.67, 1.0, 1.33)}


def edges(at: InPlane) -> tuple[float, float, str]:
    """Pressure at the left and at the right edge over the one at the bar's middle.

    An edge is touched when the highest pressure within one node (0.17 mm) of where its rounding begins exceeds the
    pressure at the middle.
    A contact that ends before the edge falls to zero at its end, so it stays below the middle there; an edge that
    bears presses harder than the middle, without bound as the mesh is refined.
    """
    middle = float(np.interp(0.0, at.s_mm, at.pressure))
    left, right = at.near(-FLAT_MM) / middle, at.near(FLAT_MM) / middle
    return left, right, f"left {left:.2f}, right {right:.2f}, middle {middle:.0f}, raw {np.round(at.pressure)}"


def test_a_bar_pressed_0_33_mm_touches_with_neither_edge(bar: dict[float, InPlane]) -> None:
    # Raju (1998): no edge in contact at DOI 0.33 mm.
    left, right, shown = edges(bar[0.33])
    assert left == 0.0, shown
    assert right == 0.0, shown


def test_a_bar_pressed_0_67_mm_touches_with_its_left_edge_only(bar: dict[float, InPlane]) -> None:
    # Raju (1998): the pad leans, so that the left edge comes first.
    left, right, shown = edges(bar[0.67])
    assert left > 1.1, shown
    assert right < 0.9, shown


def test_a_bar_pressed_1_mm_touches_fully_with_its_left_edge_and_slightly_with_its_right(
    bar: dict[float, InPlane],
) -> None:
    # Raju (1998). "Slightly": the right edge presses harder than the middle, but less than the left one, and in the
    # source's own display, after the filter, it does not yet stand out while the left one does.
    left, right, shown = edges(bar[1.0])
    assert left > right > 1.0, shown
    filtered = median_of_four(bar[1.0].x_mm, bar[1.0].pressure)
    half = len(filtered) // 2
    middle = float(np.interp(0.0, bar[1.0].s_mm, bar[1.0].pressure))
    shown += f", filtered {np.round(filtered)}"
    assert filtered[:half].max() > 1.2 * middle, shown
    assert filtered[half:].max() < 1.05 * middle, shown


def test_a_bar_pressed_1_33_mm_has_sharp_pressure_peaks_at_both_edges(bar: dict[float, InPlane]) -> None:
    # Raju (1998). "Sharp": more than twice the middle, and after the filter still a peak by the measure of DOI 1.0:
    # 1.05 of the middle separates the edge that stands out there from the one that does not.
    left, right, shown = edges(bar[1.33])
    assert left > 2, shown
    assert right > 2, shown
    filtered = median_of_four(bar[1.33].x_mm, bar[1.33].pressure)
    half = len(filtered) // 2
    middle = float(np.interp(0.0, bar[1.33].s_mm, bar[1.33].pressure))
    shown += f", filtered {np.round(filtered)}"
    assert filtered[:half].max() > 1.05 * middle, shown
    assert filtered[half:].max() > 1.05 * middle, shown


def test_contact_is_never_wider_than_the_bar(bar: dict[float, InPlane], finger: Fingertip) -> None:
    # Raju (1998): the lateral contact width never exceeds the bar's. On the undeformed skin, and where the skin has
    # moved to: 2 µm is what the nearly vertical side (slope 1000) adds over a depth of 1.33 mm.
    for doi, at in bar.items():
        assert np.ptp(at.touching_mm) <= 2 * HALF_MM, (doi, at.touching_mm)
        assert np.abs(at.touching_s_mm).max() <= HALF_MM + 0.002, (doi, at.touching_s_mm)
    for doi in (0.33, 1.33):  # all over the patch, not only in the plane
        state, patch = finger.indent("bar:3.0", 0.0, doi_mm=doi).state, finger.model.patch
        s = state.held.on(patch).interpolate(patch.x + state.displacement[0])
        assert np.abs(s).max() <= HALF_MM + 0.002, doi


@pytest.mark.parametrize("x", [-0.085, 0.085])
def test_bar_edge_contacts_are_the_same_half_a_sample_to_either_side(finger: Fingertip, x: float) -> None:
    # Half an element to either side of the centre the raw verdicts are the same.
    seen = {d: edges(InPlane.of(finger.indent("bar:3.0", x, doi_mm=d))) for d in (0.33, 0.67, 1.0, 1.33)}
    verdict = {d: (left > 1, right > 1) for d, (left, right, _) in seen.items()}
    assert verdict == {0.33: (False, False), 0.67: (True, False), 1.0: (True, True), 1.33: (True, True)}, seen
    assert seen[1.0][0] > seen[1.0][1], seen[1.0]


# ------------------------------------------------------------------------------------------------- fact 2

OFFSETS = 4  # positions per element: raw peaks under the corner scatter by about ± 25 % with the offset


@dataclass(frozen=True)
class Pass:
    """A step moved from x = +2 to −3.7 mm at 2.33 gwt."""

    x_mm: Array
    results: list[IndentationResult]
    planes: list[InPlane]

    @property
    def peaks(self) -> Array:
        """Highest raw nodal pressure in the plane, at each position."""
        return np.array([p.pressure.max() for p in self.planes])

    @property
    def regions(self) -> Array:
        """Number of contact regions in the plane, at each position."""
        return np.array([len(r.contact_regions_mm) for r in self.results])

    def at(self, x_mm: float) -> int:
        """The position nearest to x."""
        return int(np.argmin(np.abs(self.x_mm - x_mm)))


def moved(finger: Fingertip, shape: str, step_mm: float) -> Pass:
    # Flats alone touch beyond 1.2 mm and −2.8 mm: an element from one place to the next.
    ends = np.append(np.arange(2.0, 1.2, -SPACING_MM), np.arange(-2.8, -3.7, -SPACING_MM))
    x_mm = np.concatenate([ends, np.arange(1.2, -2.8, -step_mm), [-1.63, -3.7]])
    x_mm = np.sort(x_mm)[::-1]
    results = [finger.indent(shape, float(x), force_gwt=2.33) for x in x_mm]
    return Pass(x_mm, results, [InPlane.of(r) for r in results])


@pytest.fixture(scope="module")
def step_1(finger: Fingertip) -> Pass:
    return moved(finger, "step:1", SPACING_MM / OFFSETS)


def over_offsets(values: Array) -> Array:
    """Mean over one element of positions."""
    return np.convolve(values, np.ones(OFFSETS) / OFFSETS, "same")


def test_step_1_first_touches_with_its_flat_only(step_1: Pass) -> None:
    # Raju (1998): far from the flank only the lower flat touches.
    for k in np.flatnonzero(step_1.x_mm >= 0.9):
        plane = step_1.planes[k]
        assert plane.touching_s_mm.max() < 0, step_1.x_mm[k]
        assert step_1.regions[k] == 1
    alone = step_1.peaks[step_1.x_mm >= 0.9]
    np.testing.assert_allclose(alone, alone[0], rtol=1e-6)


def test_step_1_peak_grows_under_the_convex_part(step_1: Pass) -> None:
    # Raju (1998): the peak grows under the convex part of the flank, highest near 2 000 pseudo-units near x = −1.6.
    # The corner's radius, L² / (π² · 0.25) = 0.08 mm, is half an element: raw nodal peaks scatter by some ± 25 % with
    # the sub-element offset, so they are averaged over the offsets of one element. Measured: highest 2 570 near −1.2,
    # then nearly level, 2 240 near −1.6. Asserted: within ± 30 % of 2 000 at both, and the highest within half a
    # millimetre of −1.6 and above what is there by no more than the scatter.
    smooth = over_offsets(step_1.peaks)
    top, there = int(np.argmax(smooth)), smooth[step_1.at(-1.6)]
    k = step_1.at(-1.6)
    shown = (
        f"highest {smooth[top]:.0f} at {step_1.x_mm[top]:.2f}; {there:.0f} at −1.6; raw {step_1.peaks[k - 4 : k + 5]}"
    )
    assert 1400 < there < 2600, shown
    assert 1400 < smooth[top] < 2600, shown
    assert -2.1 <= step_1.x_mm[top] <= -1.0, shown
    assert smooth[top] < 1.25 * there, shown
    # It lies on the convex part, 0 ≤ s ≤ L / 2, within one node, wherever it stands out of the flat's 540.
    for k in np.flatnonzero(step_1.peaks > 1.5 * step_1.peaks[0]):
        plane = step_1.planes[k]
        s = plane.s_mm[np.argmax(plane.pressure)]
        assert -SPACING_MM <= s <= 0.225, (step_1.x_mm[k], s)
    # Growing: from one element of travel to the next, smoothed, up to where it is level.
    rising = smooth[(step_1.x_mm < 0.5) & (step_1.x_mm > -0.9)][:: 2 * OFFSETS]
    assert (np.diff(rising) > 0).all(), rising


def test_step_1_splits_the_contact_in_two(step_1: Pass) -> None:
    # Raju (1998): from x = −1.63 on two disconnected regions, until the left one vanishes; never more than two.
    shown = list(zip(step_1.x_mm.round(2), step_1.regions, strict=True))
    after = step_1.regions[step_1.x_mm <= -1.63]
    assert after[0] == 2, shown
    assert after[-1] == 1, shown
    assert (np.diff(after) <= 0).all(), shown
    assert step_1.regions.max() == 2, shown
    (left, right) = step_1.results[step_1.at(-1.63)].contact_regions_mm
    assert left[1] < -1.3 < -0.6 < right[0], (left, right)
    last = int(np.flatnonzero(step_1.regions == 2)[-1])
    (remaining,) = step_1.results[last + 1].contact_regions_mm
    assert remaining[0] > step_1.results[last].contact_regions_mm[0][1]


def test_step_1_concave_part_never_touches(step_1: Pass) -> None:
    # Raju (1998): L / 2 < s < L of the flank carries no pressure, at any node of the patch.
    length = STEP_HALF_WAVELENGTH_MM["1"]
    for x, result in zip(step_1.x_mm, step_1.results, strict=True):
        patch, state = result.model.patch, result.state
        s = state.held.on(patch).interpolate(patch.x + state.displacement[0]) - x
        assert not ((s > length / 2) & (s < length)).any(), x


def test_step_1_ends_with_the_pressure_it_began_with(step_1: Pass) -> None:
    # Raju (1998): finally the flat again, now the upper one, with the same pressure as at the start. The same flat on
    # the same nodes: equal to the residuals, 1e-8, plus what the force's tolerance leaves.
    first, last = step_1.results[0], step_1.results[-1]
    assert (step_1.x_mm[0], step_1.x_mm[-1]) == (2.0, -3.7)
    np.testing.assert_allclose(
        last.nodal_pressure_pseudo, first.nodal_pressure_pseudo, rtol=0, atol=1e-6 * first.peak_pressure_pseudo
    )
    plane = step_1.planes[-1]
    assert plane.touching_s_mm.min() > STEP_HALF_WAVELENGTH_MM["1"]


# ------------------------------------------------------------------------------------------------- fact 3


def test_step_5_stays_below_1000_pseudo_units_with_one_contact_region(finger: Fingertip) -> None:
    # Raju (1998): with a half-wavelength of 3.134 mm the peak stays below 1 000 pseudo-units at 2.33 gwt, and there
    # are never two regions. Raw values of all nodes: no filter can hide a peak.
    passed = moved(finger, "step:5", SPACING_MM)
    peaks = np.array([r.peak_pressure_pseudo for r in passed.results])
    k = int(np.argmax(peaks))
    assert peaks[k] < 1000, f"{peaks[k]:.0f} at x = {passed.x_mm[k]:.2f}"
    assert (passed.regions == 1).all(), list(zip(passed.x_mm.round(2), passed.regions, strict=True))


# ------------------------------------------------------------------------------------------------- fact 4


def test_sed_under_step_1_has_two_peaks_by_depth_and_one_by_force(finger: Fingertip) -> None:
    # Raju (1998) at his own receptors, by the rule of 5 % of the shape test for bars (`docs/statistics.md`): two
    # at DOI 0.73, the second by 22 %; one at 2.33 gwt, where a second stands out by 4.8 % only.
    for target, number in (({"doi_mm": 0.73}, 2), ({"force_gwt": 2.33}, 1)):
        sed = finger.indent("step:1", -1.63, **target).receptor_measures["sed"]
        assert len(find_peaks(sed, prominence=0.05 * np.ptp(sed))[0]) == number, sed
