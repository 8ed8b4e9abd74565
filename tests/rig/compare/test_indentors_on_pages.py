"""What was read of an indentor from a file: on pages and in JSON, as on the terminal."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rig.data import Run
from rig.plan.finger_model import copy_name
from rig.report.page_source import indentors_in_words, source_line
from sim.contact.shapes import shape_size


def _picture(path: Path) -> None:
    gray = np.full((20, 40), 255, dtype=np.uint8)
    gray[5:15, 10:30] = 0
    Image.fromarray(gray).save(path)


def _profile(path: Path) -> None:
    x = np.linspace(-1, 1, 21)
    path.write_text("x_mm,height_mm\n" + "".join(f"{a:.2f},{0.3 * a * a:.4f}\n" for a in x), encoding="utf-8")


def _heights(path: Path) -> None:
    x = np.linspace(-1, 1, 21)
    np.save(path, 0.2 * np.exp(-(x**2 + x[:, None] ** 2) / 0.3))


SHAPES: dict[str, tuple[str, Callable[[Path], None], tuple[str, ...]]] = {
    "a picture": ("heightmap:{}/a.png,width_mm=4,height_mm=0.5", _picture, (
        "dark is raised", "40 × 20 points over 3.9 × 1.9 mm", "of height_mm = 0.5 mm",
        "gray levels 0 to 255 of 255")),
    "heights": ("heightmap:{}/a.npy,spacing_mm=0.1,raised=high", _heights, (
        "the highest touches first", "21 × 21 points over 2 × 2 mm")),
    "a profile": ("profile:{}/a.csv", _profile, (
        "the lowest touches first", "21 points, x -1 to 1 mm", "relief 0.3")),
    "a bar": ("bar:3", lambda _: None, ("3 mm wide",)),
}  # fmt: skip


@pytest.mark.parametrize("name", SHAPES)
def test_a_page_states_what_was_read_of_an_indentor(name: str, bar_run: Run, tmp_path: Path) -> None:
    text, write, said = SHAPES[name]
    shape = text.format(tmp_path)
    write(tmp_path / shape.partition(":")[2].partition(",")[0].rpartition("/")[2])
    run = replace(bar_run, events={**bar_run.events, "mount": [{"indentor": shape}]})
    assert indentors_in_words([run]) == f"{shape} ({shape_size(shape)})"
    assert not [words for words in said if words not in source_line([run])]


def test_the_copy_of_a_run_is_what_was_read(bar_run: Run, tmp_path: Path) -> None:
    """The file of the name may be another one by now, or gone."""
    shape = f"profile:{tmp_path / 'gone.csv'}"
    folder = replace(bar_run.folder, path=tmp_path / "run")
    folder.path.mkdir()
    _profile(folder.path / copy_name(str(tmp_path / "gone.csv")))
    run = replace(bar_run, folder=folder, events={**bar_run.events, "mount": [{"indentor": shape}]})
    assert "21 points, x -1 to 1 mm" in indentors_in_words([run])
