"""Whole profiles of pressure read back from noisy SED of a finer mesh: rows and one draw of each scene."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from rig.report.coding_figures import DrawnDecoding, decoded_figure
from rig.report.page import PageFigure, Section
from sim.coding.encoding import Readings, noise_sd
from sim.coding.operators import centred
from sim.coding.pressure import Frictionless, frictionless
from sim.coding.section import SPACING_MM, SampledSection
from studies.coding.profiles_read_back import (
    SAMPLES,
    SCENES,
    SEED,
    SNR_DB,
    ProfilePress,
    ProfileRow,
    decoders,
    default_section,
    finer_section,
    pressed,
    read_back,
)


class ReadBackScene(NamedTuple):
    """One press, read back many times by each decoder, and once to be drawn."""

    rows: dict[str, ProfileRow]
    drawn: DrawnDecoding
    receptors: int


@cache
def default_operator() -> Frictionless:
    """By which the default mesh decodes whole profiles."""
    return frictionless(default_section(), centred(SAMPLES + 1, SPACING_MM), "finite")


@cache
def pressed_finger() -> SampledSection:
    """The finer mesh that is pressed."""
    return finer_section()


def profile(scene: ProfilePress, draws: int) -> ReadBackScene:
    """A second for some ten draws, once the sections are there (some seconds)."""
    operator = default_operator()
    true, sed = pressed(pressed_finger(), scene)
    by = decoders(operator)
    rows = {
        name: ProfileRow.of([read_back(decode, true, sed, SNR_DB, SEED + k) for k in range(draws)])
        for name, decode in by.items()
    }
    sd = noise_sd(sed, SNR_DB)
    said = sed + sd * np.random.default_rng(SEED).normal(size=len(sed))
    ours = next(iter(by.values()))(Readings.of_sed(said, sd))
    drawn = DrawnDecoding(
        operator.place_mm, ours.pressure, ours.band(), true, operator.receptor_mm, said, operator.sed(ours.pressure)
    )
    return ReadBackScene(rows, drawn, len(sed))


def profile_sections(found: Mapping[ProfilePress, ReadBackScene], draws: int) -> list[Section]:
    """One."""
    rows = [_row(scene, name, row) for scene, one in found.items() for name, row in one.rows.items()]
    samples = next(iter(found.values())).receptors
    return [
        Section(
            "Decoding: whole profiles under shapes",
            f"Past the source: {SAMPLES} pressures, 170 µm apart, from noisy SED at M = {samples} receptors, "
            f"{SNR_DB:g} dB, "
            f"{draws} draws a row, by finite-element influence; presses are of a finer mesh than the one that "
            "decodes. "
            "Relative L2, mean ± sd; coverage of the 90 % band inside the contact; its median width over the peak.",
            ("press", "decoder", "relative L2", "coverage", "width over peak", "ms"),
            tuple(rows),
            tuple(
                PageFigure(
                    f"One draw of {_name(scene)}", decoded_figure(one.drawn), "The first decoder of the table."
                )
                for scene, one in found.items()
            ),
        )
    ]


def _name(scene: ProfilePress) -> str:
    return f"{scene.shape} at {scene.x_mm:g}, {scene.doi_mm:g} mm deep"


def _row(scene: ProfilePress, name: str, row: ProfileRow) -> tuple[str, ...]:
    mean, sd = row.mean, row.sd
    return (
        _name(scene),
        name,
        f"{mean.relative_l2:.1%} ± {sd.relative_l2:.1%}",
        f"{mean.held:.0%}",
        f"{mean.width:.2f}",
        f"{mean.spent_ms:.0f}",
    )


def jobs(draws: int) -> Sequence[tuple[ProfilePress, int]]:
    """Arguments of every `profile`."""
    return [(scene, draws) for scene in SCENES]
