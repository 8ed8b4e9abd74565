"""Shapes, curvature and edges read back, and whole profiles against noise: the tables of past the source."""

from collections.abc import Mapping, Sequence
from typing import Literal, get_args

from rig.report.page import Section
from sim.coding.shape_class import CLASSES
from studies.coding import curvature_read_back, edge_place, shapes_read_back
from studies.coding.bands.drawn_presses import NEAR, cell, drawn, held, with_noise
from studies.coding.profiles_part import default_operator, pressed_finger
from studies.coding.profiles_read_back import (
    OURS,
    SCENES,
    SEED,
    SNR_DB,
    SNRS_DB,
    ProfilePress,
    ProfileRow,
    decoders,
    pressed,
)

Presses = Literal["fixed", "drawn"]
Cells = tuple[str, ...]


def shapes(scenes: int) -> list[Cells]:
    """A minute or so of one core for twenty scenes a class."""
    return list(shapes_read_back.rows(scenes))


def curvatures(draws: int) -> list[Cells]:
    """Some seconds."""
    return list(curvature_read_back.rows(draws))


def edges(draws: int) -> list[Cells]:
    """Half a minute for four draws a place."""
    return list(edge_place.rows(draws))


def against_noise(scene: ProfilePress, draws: int, presses: Presses) -> list[ProfileRow]:
    """Of our decoder, at each SNR: of one press, or of as many drawn about it as there are draws."""
    scenes, seed = [scene] * draws, SEED
    if presses == "drawn":
        scenes, seed = drawn(NEAR, SCENES.index(scene), draws, NEAR.seed), NEAR.seed
    known = {one: pressed(pressed_finger(), one) for one in dict.fromkeys(scenes)}
    return with_noise(decoders(default_operator())[OURS], [known[one] for one in scenes], seed)


def scenes_of(draws: int) -> int:
    """Of each class."""
    return max(2, draws // 2)


def noise_draws_of(draws: int) -> int:
    """At each SNR, and of each cylinder."""
    return max(2, draws // 5)


def edge_draws_of(draws: int) -> int:
    """At each place of an edge."""
    return max(1, draws // 10)


def noise_jobs(draws: int) -> Sequence[tuple[ProfilePress, int, Presses]]:
    """Arguments of every `against_noise`."""
    return [(scene, draws, presses) for presses in get_args(Presses) for scene in SCENES]


def noise_sections(
    found: Mapping[tuple[ProfilePress, int, Presses], Sequence[ProfileRow]], draws: int
) -> list[Section]:
    """Whole profiles against noise: of presses drawn, which a band is meant for, and of the fixed ones."""
    about: dict[Presses, str] = {
        "drawn": f"Each draw is a press of its own {NEAR.ranges}, with its own noise (seeds {NEAR.seed} …).",
        "fixed": f"The presses of above, one place and one depth a shape, and only noise is drawn (seeds {SEED} …).",
    }
    sections = []
    for presses, text in about.items():
        by_scene = {job[0]: rows for job, rows in found.items() if job[2] == presses}
        rows = [(scene.shape, *map(cell, by_snr)) for scene, by_snr in by_scene.items()]
        sections.append(
            Section(
                f"Decoding: whole profiles against noise, {presses} presses",
                f"{text} {draws} draws a cell: relative L2, coverage of the 90 % band inside the contact, its median "
                f"width over the peak, milliseconds of processor time. {held(list(by_scene.values()))}",
                ("shape", *(f"{snr:g} dB" for snr in SNRS_DB)),
                tuple(rows),
            )
        )
    return sections


def shape_sections(tables: Sequence[Sequence[Cells]], draws: int) -> list[Section]:
    """Three, of the rows of shapes, of curvature and of edges."""
    read, round_ones, told = tables
    return [
        Section(
            "Decoding: shapes",
            f"Class and size of what pressed, {scenes_of(draws)} bars, cylinders and steps of any size and place, "
            f"pressed on a finer mesh, {SNR_DB:g} dB; chance is {1 / len(CLASSES):.0%}. Skin: decoded pressures move "
            "the skin, and where it touches it lies on the indentor. Templates: the nearest in SED of "
            f"{len(CLASSES) * shapes_read_back.TEMPLATES} presses drawn alike.",
            shapes_read_back.HEADER,
            tuple(read),
        ),
        Section(
            "Decoding: curvature, both ways",
            f"Of cylinders, {SNR_DB:g} dB, {noise_draws_of(draws)} draws: by the circle on the skin less its "
            "displacement d, compliance × pressure, and by Eq. 4.1 inverted with that d, the finger's own curvature "
            "taken off.",
            curvature_read_back.HEADER,
            tuple(round_ones),
        ),
        Section(
            "Decoding: where an edge is",
            f"The left edge of a bar {edge_place.WIDTH_MM:g} mm wide, {edge_draws_of(draws)} draws at each of "
            f"{len(edge_place.PLACES_MM)} places within a sample; the Cramér–Rao bound is of an unbiased reader who "
            "knows the bar but not its place and depth.",
            edge_place.HEADER,
            tuple(told),
        ),
    ]
