"""Height maps: what surface goes through the points, what a finger feels of it, and which maps are refused."""

from copy import copy
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from sim.contact.height_map import MOST_POINTS, HeightMap, HeightMapError
from sim.contact.indentor import BOTH, Prismatic
from sim.contact.measured_profile import MeasuredProfile
from sim.contact.profiles import STEEPEST_SLOPE
from sim.contact.shapes import ShapeError, parse_shape
from sim.errors import ArgumentError
from sim.models.fingertip import Fingertip
from tests.error_codes import raises

Array = NDArray[np.float64]

RADIUS_MM = 3.0


def spherical(spacing_mm: float, half_mm: float = 2.0, turn_deg: float = 0.0) -> HeightMap:
    """A sphere's lower part."""
    n = round(half_mm / spacing_mm)
    at = spacing_mm * np.arange(-n, n + 1)
    x, z = np.meshgrid(at, at)
    height = 7.0 + RADIUS_MM - np.sqrt(RADIUS_MM**2 - x**2 - z**2)
    return HeightMap.from_arrays(at, at, height, raised="low", turn_deg=turn_deg)


def waves(turn_deg: float = 0.0) -> HeightMap:
    """Without symmetry, and longer along z than along x."""
    x, z = np.arange(-1.0, 1.01, 0.1), np.arange(-1.5, 1.61, 0.1)
    height = 0.1 * np.sin(2 * x[None] + 0.3) * np.cos(1.5 * z[:, None]) + 0.05 * x[None]
    return HeightMap.from_arrays(x, z, height, raised="low", turn_deg=turn_deg)


def letter(path: Path, text: str = "R", size: tuple[int, int] = (80, 100)) -> str:
    """A picture of a letter, black on white, as high as it."""
    picture = Image.new("L", size, 255)
    font = ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans-Bold.ttf", int(0.95 * size[1]))
    ImageDraw.Draw(picture).text((size[0] / 2, size[1] / 2), text, fill=0, font=font, anchor="mm")
    picture.save(path)
    return str(path)


# ------------------------------------------------------------------------------------------------- the surface


def test_a_height_map_passes_through_its_points_counted_from_the_lowest() -> None:
    x, z = np.arange(-1.0, 1.01, 0.25), np.arange(-0.5, 1.01, 0.25)
    height = 5.0 + 0.1 * np.random.default_rng(0).uniform(size=(len(z), len(x)))
    height[2, 3] = 4.9
    there = HeightMap.from_arrays(x, z, height, raised="low")
    places = np.stack([side.ravel() for side in np.meshgrid(x, z)])
    seen = there.evaluate(places).height_mm
    np.testing.assert_allclose(seen - seen[2 * len(x) + 3], (height - 4.9).ravel(), atol=1e-12)
    finely = np.stack([s.ravel() for s in np.meshgrid(np.linspace(-1, 1, 65), np.linspace(-0.5, 1, 49))])
    assert 0 <= there.evaluate(finely).height_mm.min() < 2e-3  # 8 places a cell


@pytest.mark.parametrize("turn_deg", [0.0, -110.0])
def test_slope_and_curvature_of_a_height_map_are_derivatives_of_its_height(turn_deg: float) -> None:
    # Central differences of a cubic: h = 1e-4 leaves h² f''' / 6 < 1e-8 of the slope; C² so that no joint shows.
    there, rng = waves(turn_deg), np.random.default_rng(1)
    at = rng.uniform(-0.6, 0.6, size=(2, 200))
    surface, h = there.evaluate(at), 1e-4
    for axis in (0, 1):
        step = h * np.eye(2)[:, axis : axis + 1]
        low, high = there.evaluate(at - step), there.evaluate(at + step)
        np.testing.assert_allclose((high.height_mm - low.height_mm) / (2 * h), surface.slope[axis], atol=1e-7)
        np.testing.assert_allclose((high.slope - low.slope) / (2 * h), surface.curvature[:, axis], atol=1e-3)
    np.testing.assert_allclose(surface.curvature[0, 1], surface.curvature[1, 0], atol=1e-15)


def test_a_turned_height_map_rotates_from_x_towards_the_tip() -> None:
    plain, turned = waves(), waves().turned(90.0)
    at = np.random.default_rng(2).uniform(-0.9, 0.9, size=(2, 50))
    one, other = plain.evaluate(at), turned.evaluate(np.stack([-at[1], at[0]]))  # (x, z) → (−z, x)
    np.testing.assert_allclose(one.height_mm, other.height_mm, atol=1e-14)
    np.testing.assert_allclose(one.slope, np.stack([other.slope[1], -other.slope[0]]), atol=1e-13)
    assert turned.name == "heightmap,across"
    assert waves().turned(30.0).name == "heightmap,turn_deg=30"
    with raises(ArgumentError, "turned_already"):
        turned.turned(10.0)


def test_beyond_its_rim_a_height_map_is_a_steep_wall() -> None:
    there = waves()
    rim, beyond = (there.evaluate(np.array([[x], [0.4]])) for x in (1.0, 1.01))
    assert beyond.height_mm[0] - rim.height_mm[0] == pytest.approx(0.01 * STEEPEST_SLOPE)
    np.testing.assert_allclose(beyond.slope[:, 0], [STEEPEST_SLOPE, rim.slope[1, 0]])
    np.testing.assert_allclose(beyond.curvature[:, :, 0], [[0, 0], [0, rim.curvature[1, 1, 0]]])
    corner = there.evaluate(np.array([[-1.03], [-1.54]]))
    np.testing.assert_allclose(corner.slope[:, 0], [-0.6 * STEEPEST_SLOPE, -0.8 * STEEPEST_SLOPE])
    # below the rim and beside it: the plane through its nearest place, square to the way there
    tangent = there.tangent(np.array([[1.3], [0.4]]), rim.height_mm - 0.4)
    np.testing.assert_allclose(tangent.slope[:, 0], [0.75, rim.slope[1, 0]])
    assert tangent.height_mm[0] - rim.height_mm[0] == pytest.approx(0.75 * 0.3)
    within = np.random.default_rng(3).uniform(-0.9, 0.9, size=(2, 20))
    for a, b in zip(there.evaluate(within), there.tangent(within, np.zeros(20)), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("spacing_mm", "allowed"), [(0.4, 3e-4), (0.1, 3e-6)])
def test_a_mapped_sphere_errs_with_the_fourth_power_of_its_spacing(spacing_mm: float, allowed: float) -> None:
    # 5/384 h⁴ of the fourth derivative, 3/R³ at the pole: 4e-5, 2e-6, 2e-7 mm; more towards the rim.
    there, exact = spherical(spacing_mm), parse_shape(f"sphere:{RADIUS_MM}")
    at = np.random.default_rng(4).uniform(-1.0, 1.0, size=(2, 400))
    for mine, other, by in zip(there.evaluate(at), exact.evaluate(at), (1, 10, 300), strict=True):
        assert np.abs(mine - other).max() < by * allowed
    assert spherical(0.1, 1.0).sharpest_radius_mm == pytest.approx(RADIUS_MM, rel=0.01)


def test_the_normals_of_a_mapped_sphere_turn_as_those_of_a_sphere() -> None:
    at = np.array([[0.0, 0.5], [0.0, 0.2]])
    np.testing.assert_allclose(spherical(0.1).turning(at, 0.1)[0], 2 * np.arcsin(0.1 / RADIUS_MM), rtol=1e-3)


# ------------------------------------------------------------------------------------------------ on the finger


@pytest.mark.parametrize(("spacing_mm", "allowed", "turn_deg"), [(0.4, 1e-4, 0.0), (0.2, 1e-5, 30.0)])
def test_a_mapped_sphere_presses_as_the_sphere(
    coarse_finger: Fingertip, spacing_mm: float, allowed: float, turn_deg: float
) -> None:
    # On the default mesh 2.5e-5, 8e-7 and 2e-9 of the force at these spacings.
    place = {"x_mm": 0.2, "z_mm": 7.0, "doi_mm": 0.5}
    exact = coarse_finger.indent(f"sphere:{RADIUS_MM:g}", **place)
    mapped = coarse_finger.indent(spherical(spacing_mm, turn_deg=turn_deg), **place)
    assert mapped.state.residual <= 1e-10
    assert not len(mapped.state.points.between)  # it turns nowhere within less than a node's spacing
    assert mapped.touch_height_mm == pytest.approx(exact.touch_height_mm, abs=allowed)
    assert mapped.force_n == pytest.approx(exact.force_n, rel=allowed)
    np.testing.assert_allclose(mapped.receptor_strain, exact.receptor_strain, atol=10 * allowed)


def test_a_pressed_letter_o_bears_no_force_in_its_hole(coarse_finger: Fingertip, tmp_path: Path) -> None:
    shape = parse_shape(f"heightmap:{letter(tmp_path / 'o.png', 'O', (80, 80))},width_mm=3.2,height_mm=0.5")
    forces = []
    for doi_mm in (0.1, 0.3, 0.6):
        result = coarse_finger.indent(shape, 0.0, doi_mm=doi_mm)
        assert result.state.residual <= 1e-10
        forces.append(result.force_n)
        at = result.state.held.on(result.model.patch).interpolate(result.model.patch.position_mm.T)
        way = np.hypot(at[0], at[2] - result.z_mm)
        assert way.min() > 0.4  # the hole is some 0.6 mm wide to either side
        assert way.max() < 1.5
    assert 0 < forces[0] < forces[1] < forces[2]
    assert len(result.state.points.between)  # the letter's edges are sharper than the mesh
    again = coarse_finger.indent(shape, 0.0, force_gwt=result.force_gwt)
    assert again.doi_mm == pytest.approx(0.6, rel=1e-8)


@pytest.mark.parametrize(("shape", "between"), [("grating:0.5,1.2", 2e-3), ("step:1", 5e-3)])
def test_a_shape_turned_by_zero_degrees_presses_as_the_unturned_shape(
    coarse_finger: Fingertip, shape: str, between: float
) -> None:
    """Solved with forces along the finger too; between nodes it has points on the segments along the finger too."""
    straight = parse_shape(shape)
    free = Prismatic("free", straight.profile, BOTH, (1.0, 0.0))  # type: ignore[attr-defined]
    x = -1.0 if shape.startswith("step") else 0.1
    nodes_only = nodes_alone(coarse_finger)
    one, other = (nodes_only.indent(s, x, doi_mm=0.3) for s in (straight, free))
    assert other.force_n == pytest.approx(one.force_n, rel=2e-6)  # touch is found on another table of the skin
    np.testing.assert_allclose(other.receptor_strain, one.receptor_strain, atol=1e-6)
    one, other = (coarse_finger.indent(s, x, doi_mm=0.3) for s in (straight, free))
    assert other.force_n == pytest.approx(one.force_n, rel=between)
    assert straight.turned(0.0) == straight == straight.turned(360.0)


def nodes_alone(finger: Fingertip) -> Fingertip:
    """The same finger, its models shared, contact at nodes only."""
    other = copy(finger)
    other.config = finger.config.model_copy(
        update={"contact": finger.config.contact.model_copy(update={"between_nodes": False})}
    )
    return other


def test_a_turned_mapped_grating_presses_as_the_turned_grating(coarse_finger: Fingertip) -> None:
    """Ridges as half waves, which both can have: a profile from the same points, turned."""
    x = np.arange(-2.6, 2.61, 0.05)
    height = 0.15 * (1 - np.cos(2 * np.pi * x / 1.3))
    profile = MeasuredProfile("waves", tuple(x.tolist()), tuple(height.tolist()))
    there = HeightMap.from_arrays(x, x, np.tile(height, (len(x), 1)), raised="low")
    one = coarse_finger.indent(Prismatic.along(profile).turned(30.0), doi_mm=0.3)
    other = coarse_finger.indent(there.turned(30.0), doi_mm=0.3)
    assert other.state.residual <= 1e-10
    assert other.force_n == pytest.approx(one.force_n, rel=0.01)  # PCHIP and spline; points between nodes


# -------------------------------------------------------------------------------------------------- from files


def test_a_picture_shows_the_face_of_the_indentor_with_dark_raised(tmp_path: Path) -> None:
    pixels = np.full((40, 60), 255, np.uint8)
    pixels[:10, :30] = 0  # dark at the top left: towards the tip and −x
    Image.fromarray(pixels).save(tmp_path / "a.png")
    there = parse_shape(f"heightmap:{tmp_path / 'a.png'},width_mm=6,height_mm=0.4")
    height = there.evaluate(np.array([[-1.5, 1.5, -1.5, 1.5], [1.6, 1.6, -1.6, -1.6]])).height_mm
    np.testing.assert_allclose(height, [0.0, 0.4, 0.4, 0.4], atol=3e-3)
    light = parse_shape(f"heightmap:{tmp_path / 'a.png'},width_mm=6,height_mm=0.4,raised=light")
    np.testing.assert_allclose(light.evaluate(np.array([[-1.5, 1.5], [1.6, 1.6]])).height_mm, [0.4, 0.0], atol=3e-3)
    assert there.name.endswith("a.png,width_mm=6,height_mm=0.4")


@pytest.mark.parametrize(
    ("width_mm", "option", "edge_mm"),
    [(3.0, "", 0.05), (3.0, ",edge_mm=0.2", 0.2), (12.0, "", 0.14)],
)
def test_edges_of_a_picture_are_rounded_by_the_edge_width(
    tmp_path: Path, width_mm: float, option: str, edge_mm: float
) -> None:
    """As by a Gaussian of 0.05 mm, or of 0.7 pixels where these are large: a step's slope says so, in its middle."""
    Image.fromarray(np.tile(np.where(np.arange(60) < 30, 0, 255), (60, 1)).astype(np.uint8)).save(tmp_path / "a.png")
    there = parse_shape(f"heightmap:{tmp_path / 'a.png'},width_mm={width_mm},height_mm=0.1{option}")
    slope = there.evaluate(np.zeros((2, 1))).slope[0, 0]
    assert slope == pytest.approx(0.1 / (edge_mm * np.sqrt(2 * np.pi)), rel=0.15)


@pytest.mark.parametrize("mode", ["L", "RGBA", "I;16", "P"])
def test_pictures_of_every_color_mode_are_read_alike(tmp_path: Path, mode: str) -> None:
    black = np.zeros((40, 40), bool)
    black[:, 15:25] = True
    picture = Image.fromarray(np.where(black, 0, 255).astype(np.uint8))
    if mode == "I;16":
        picture = Image.fromarray(np.where(black, 0, 65535).astype(np.uint16))
    elif mode == "RGBA":  # what is transparent is white
        picture = Image.fromarray(np.stack([np.zeros((40, 40))] * 3 + [255 * black], -1).astype(np.uint8), "RGBA")
    else:
        picture = picture.convert(mode)
    picture.save(tmp_path / "a.png")
    there = parse_shape(f"heightmap:{tmp_path / 'a.png'},width_mm=2,height_mm=0.3")
    np.testing.assert_allclose(
        there.evaluate(np.array([[0.0, -0.8, 0.8], [0.0, 0.0, 0.5]])).height_mm, [0, 0.3, 0.3], atol=1e-4
    )


@pytest.mark.parametrize("tint", [0, 2])
def test_grays_with_the_rounding_of_their_colors_are_read(tmp_path: Path, tint: int) -> None:
    gray = np.tile(np.linspace(0, 250, 40).astype(np.uint8), (40, 1))
    Image.fromarray(np.stack([gray, gray + np.uint8(tint), gray], axis=-1)).save(tmp_path / "a.png")
    low, high = (
        parse_shape(f"heightmap:{tmp_path / 'a.png'},width_mm=2,height_mm=0.3")
        .evaluate(np.array([[-0.8, 0.8], [0.0, 0.0]]))
        .height_mm
    )
    assert high - low > 0.2


@pytest.mark.parametrize(
    ("dark", "light", "white"), [(0, 4095, 65535), (0, 400, 65535), (60, 160, 255), (255, 255, 255)]
)
def test_a_picture_with_less_than_half_of_the_grays_is_refused_with_their_range(
    tmp_path: Path, dark: int, light: int, white: int
) -> None:
    """As 12 bits, or micrometers, in a file of 16."""
    grays = np.full((40, 40), light, np.uint16 if white > 255 else np.uint8)
    grays[10:30, 10:30] = dark
    Image.fromarray(grays).save(tmp_path / "a.png")
    relief_mm = 0.4 * (light - dark) / white
    with raises(ShapeError, "few_grays", grays=f"{dark} to {light} of {white}", relief_mm=f"{relief_mm:.2g} mm"):
        parse_shape(f"heightmap:{tmp_path / 'a.png'},width_mm=2,height_mm=0.4")


def test_height_maps_from_npy_csv_and_points_are_read_alike(tmp_path: Path) -> None:
    there = waves()
    rows = there.height_mm[::-1]  # the first nearest the tip
    np.save(tmp_path / "a.npy", rows)
    np.savetxt(tmp_path / "rows.csv", rows, delimiter=",")
    points = [
        f"{x},{z},{h}"
        for z, row in zip(there.z_mm, there.height_mm, strict=True)
        for x, h in zip(there.x_mm, row, strict=True)
    ]
    np.random.default_rng(5).shuffle(points)
    (tmp_path / "points.csv").write_text("\n".join(["x_mm,z_mm,height_mm", *points]), encoding="utf-8")
    at = np.random.default_rng(6).uniform(-0.9, 0.9, size=(2, 30))
    given = there.evaluate(at).height_mm
    listed = parse_shape(f"heightmap:{tmp_path / 'points.csv'},raised=low")
    np.testing.assert_allclose(listed.evaluate(at).height_mm, given)
    middle = at - np.array([[0.0], [0.05]])  # of z from −1.5 to 1.6
    for name in ("a.npy", "rows.csv"):
        found = parse_shape(f"heightmap:{tmp_path / name},spacing_mm=0.1,raised=low")
        np.testing.assert_allclose(found.evaluate(middle).height_mm, given, atol=1e-12)
        assert found.name == f"heightmap:{tmp_path / name},spacing_mm=0.1,raised=low"
        assert parse_shape(found.name) == found


DOT = -0.3 * (np.linspace(-1, 1, 21) ** 2 + np.linspace(-1, 1, 21)[:, None] ** 2)  # the largest number in the middle
MIDDLE_TOUCHES = {  # whether the middle touches first, in a file or array of raised dots; None: it must be said
    "dot.npy,spacing_mm=0.1": None,  # heights above a table or depths below a probe: numbers cannot tell
    "dot.npy,spacing_mm=0.1,raised=high": True,
    "dot.npy,spacing_mm=0.1,raised=low": False,
    "points.csv": None,
    "dot.png,width_mm=2,height_mm=0.5": True,  # ink is raised, as of a letter
    "dot.png,width_mm=2,height_mm=0.5,raised=light": False,
}


def a_dot(folder: Path) -> None:
    np.save(folder / "dot.npy", DOT)
    at = np.linspace(-1, 1, 21)
    rows = [f"{x:.1f},{z:.1f},{DOT[k, i]}" for k, z in enumerate(at) for i, x in enumerate(at)]
    (folder / "points.csv").write_text("\n".join(["x_mm,z_mm,height_mm", *rows]), encoding="utf-8")
    dark = np.rint(-DOT / 0.6 * 255)
    Image.fromarray(dark.astype(np.uint8)).save(folder / "dot.png")


@pytest.mark.parametrize("name", MIDDLE_TOUCHES)
def test_a_height_map_file_needs_its_raised_side_unless_it_is_clear(tmp_path: Path, name: str) -> None:
    a_dot(tmp_path)
    shape, touches = f"heightmap:{tmp_path / name}", MIDDLE_TOUCHES[name]
    if touches is None:
        with raises(ShapeError, "which_side_is_up", high="raised=high", low="raised=low"):
            parse_shape(shape)
        return
    middle, corner = parse_shape(shape).evaluate(np.array([[0.0, 0.9], [0.0, 0.9]])).height_mm
    assert (middle < corner) == touches


def test_a_height_map_from_arrays_needs_its_raised_side() -> None:
    at = np.linspace(-1, 1, 21)
    with raises(HeightMapError, "which_side_is_up", high='raised="high"', low='raised="low"'):
        HeightMap.from_arrays(at, at, DOT)
    places = np.array([[0.0, 0.9], [0.0, 0.9]])
    high, low = (HeightMap.from_arrays(at, at, sign * DOT, raised=raised).evaluate(places).height_mm
                 for sign, raised in ((1, "high"), (-1, "low")))  # fmt: skip
    np.testing.assert_array_equal(high, low)
    assert high[0] < high[1]


def test_edges_of_a_table_are_rounded_on_request(tmp_path: Path) -> None:
    step = np.tile(np.where(np.arange(60) < 30, 0.0, 0.3), (60, 1))
    np.save(tmp_path / "a.npy", step)
    with raises(ShapeError, "swings_below", relief_mm=0.3):
        parse_shape(f"heightmap:{tmp_path / 'a.npy'},spacing_mm=0.05,raised=low")
    there = parse_shape(f"heightmap:{tmp_path / 'a.npy'},spacing_mm=0.05,edge_mm=0.1,raised=low")
    slope = there.evaluate(np.array([[0.0], [0.0]])).slope[0, 0]
    assert slope == pytest.approx(0.3 / (0.1 * np.sqrt(2 * np.pi)), rel=0.05)  # of a step under a Gaussian


# ------------------------------------------------------------------------------------------------------ refused


def grid(rows: int = 6, columns: int = 6) -> Array:
    return np.zeros((rows, columns))


def with_one(value: float) -> Array:
    height = grid()
    height[2, 4] = value
    return height


EVEN = 0.1 * np.arange(6)
REFUSED_ARRAYS = [
    (EVEN, EVEN, with_one(np.nan), "missing_height"),
    (EVEN, EVEN, grid(5), "heights_unlike_grid"),
    (EVEN[:3], EVEN, grid(6, 3), "too_small"),
    (EVEN[::-1], EVEN, grid(), "axis_not_rising"),
    (EVEN, [0, 0.1, 0.2, 0.35, 0.4, 0.5], grid(), "uneven_spacing"),
    (EVEN, EVEN, with_one(9.0), "too_steep"),
    (EVEN, EVEN, with_one(0.5), "swings_below"),
    (1e-3 * EVEN, EVEN, grid(), "too_narrow"),
    (EVEN, 1e-3 * EVEN, grid(), "too_narrow"),
    (1e3 * EVEN, EVEN, grid(), "too_wide"),
    (EVEN, EVEN, with_one(0.0005), "too_flat"),
    (EVEN, EVEN, with_one(500.0), "too_tall"),
]


@pytest.mark.parametrize(("x", "z", "height", "code"), REFUSED_ARRAYS)
def test_arrays_that_make_no_height_map_are_refused(x: Array, z: Array, height: Array, code: str) -> None:
    with raises(HeightMapError, code, name="mine") as caught:
        HeightMap.from_arrays(x, z, height, raised="low", name="mine")
    assert "\n" not in str(caught.value)


def test_height_maps_are_limited_in_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert MOST_POINTS == 1_000_000
    monkeypatch.setattr("sim.contact.height_map.MOST_POINTS", 36)
    HeightMap.from_arrays(EVEN, EVEN, grid(), raised="low")
    HeightMap.from_arrays(EVEN[:4], EVEN[:4], grid(4, 4), raised="low")
    seven = 0.1 * np.arange(7)
    with raises(HeightMapError, "too_large", columns=7, rows=6, most=36):
        HeightMap.from_arrays(seven, EVEN, grid(6, 7), raised="low")
    monkeypatch.setattr("sim.contact.map_files.MOST_POINTS", 36)
    np.savetxt(tmp_path / "more.csv", grid(6, 7), delimiter=",")
    with raises(ShapeError, "too_many_numbers", most=36):
        parse_shape(f"heightmap:{tmp_path / 'more.csv'},spacing_mm=0.1,raised=low")


COLOR_MAPS = ("viridis", "jet", "coolwarm", "Blues", "Greens", "Purples", "bone", "copper", "pink", "cool", "Wistia")


def files(folder: Path) -> None:
    """One of each kind that cannot be, and some that can."""
    np.save(folder / "good.npy", grid())
    np.save(folder / "words.npy", np.array([["a"] * 5] * 5))
    np.save(folder / "pickled.npy", np.array([[{}] * 5] * 5), allow_pickle=True)
    np.save(folder / "large.npy", np.zeros((1001, 1000), np.float32))
    (folder / "folder.png").mkdir()
    Image.fromarray(np.full((20, 20), 255, np.uint8)).save(folder / "good.png")
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (20, 20), np.uint8)).save(folder / "noise.png")
    (folder / "cut.png").write_bytes((folder / "noise.png").read_bytes()[:200])
    Image.new("L", (1001, 1000)).save(folder / "large.png")
    for colors in COLOR_MAPS:
        painted = matplotlib.colormaps[colors](np.linspace(0.0, 1.0, 400).reshape(20, 20))
        Image.fromarray((255 * painted).astype(np.uint8)).save(folder / f"{colors}.png")
    red = np.full((20, 20, 3), 255, np.uint8)
    red[5:15, 5:15, 1:] = 0
    Image.fromarray(red).save(folder / "red.png")
    rows = [f"{x},{z},0" for x in range(4) for z in range(4)]
    for name, lines in {
        "hole": rows[:-1],
        "twice": [*rows, "1,2,0.5"],
        "word": [*rows[:3], "1,high,0"],
        "short": [*rows[:3], "1,2"],
        "nan": [*rows, "nan,2,0"],
        "uneven": [row.replace("3,", "7,", 1) if row.startswith("3,") else row for row in rows],
        "none": [],
    }.items():
        (folder / f"{name}.csv").write_text("\n".join(["x_mm,z_mm,height_mm", *lines]), encoding="utf-8")
    (folder / "rows.csv").write_text("0,0,0,0\n0,0,0\n", encoding="utf-8")
    (folder / "latin.csv").write_bytes(b"x_mm,z_mm,height_mm\n\xff\xfe")


REFUSED = {
    "good.npy": "option_missing",
    "good.npy,spacing_mm=wide": "option_out_of_range",
    "good.npy,spacing_mm=nan": "option_out_of_range",
    "good.npy,spacing_mm=2.1": "option_out_of_range",
    "good.npy,spacing_mm=0.1,spacing_mm=0.1": "unknown_option",
    "good.npy,spacing_mm=0.1,width_mm=3": "option_of_no_use",
    "good.npy,spacing_mm=0.1,edge_mm=0.05,raised=low": "edge_too_small",
    "words.npy,spacing_mm=0.1": "no_heights",
    "pickled.npy,spacing_mm=0.1": "no_array",
    "large.npy,spacing_mm=0.1": "too_many_heights",
    "nowhere.npy,spacing_mm=0.1": "no_array",
    "folder.png,width_mm=3,height_mm=1": "no_picture",
    "nowhere.txt": "unknown_suffix",
    "good.png": "option_missing",
    "good.png,width_mm=3,height_mm=1,raised=up": "unknown_raised",
    "cut.png,width_mm=3,height_mm=1": "no_picture",
    **{f"{colors}.png,width_mm=3,height_mm=1": "colored" for colors in COLOR_MAPS},
    "red.png,width_mm=3,height_mm=1": "colored",
    "large.png,width_mm=3,height_mm=1": "too_many_pixels",
    "hole.csv": "hole",
    "twice.csv": "overhang",
    "word.csv": "no_number",
    "short.csv": "map_row_length",
    "nan.csv": "no_place",
    "uneven.csv": "uneven_spacing",
    "none.csv": "too_small",
    "twice.csv,spacing_mm=1": "option_of_no_use",
    "rows.csv": "no_columns",
    "rows.csv,spacing_mm=1": "map_row_length",
    "latin.csv": "no_text",
}


@pytest.mark.parametrize("name", REFUSED)
def test_files_that_make_no_height_map_are_refused(tmp_path: Path, name: str) -> None:
    files(tmp_path)
    with raises(ShapeError, REFUSED[name], name=f"heightmap {tmp_path / name.partition(',')[0]}") as caught:
        parse_shape(f"heightmap:{tmp_path / name}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("height_mm", [0.1, 0.2, 0.3])
def test_a_flat_map_of_any_height_is_read(height_mm: float, tmp_path: Path) -> None:
    np.save(tmp_path / "flat.npy", np.full((21, 21), height_mm))
    parse_shape(f"heightmap:{tmp_path / 'flat.npy'},spacing_mm=0.15,raised=high")
