"""Every option and argument of the program that is a number: anything else ends in one line with code 2."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_type_hints

import h5py
import numpy as np
import pytest
import typer

from rig.cli import calibrate
from rig.cli import program as commands
from rig.compare.recordings.columns import ColumnMap
from rig.compare.recordings.nwb_file import read_nwb
from rig.compare.recordings.presses_table import read_srp
from rig.design.counts_from import source
from rig.errors import BadInputError
from sim.contact.shapes import parse_shape
from sim.models.cache import CacheError, most_bytes
from sim.tables import read_columns
from tests.program import Program, functions

WRONG = ["9" * 5000, "1e400", "1.5", "nan", "", "1_0", "١"]
"""What no command means by a whole number."""
NEEDED = {"--axis": "x", "--indentor": "bar:3.0"}
"""Values of required options; all others may be anything."""


WHOLE, REAL = (int, int | None), (float, float | None)


def _options(kinds: tuple[Any, ...] = WHOLE) -> Iterator[tuple[list[str], str, bool, list[str]]]:
    """Words of a command, its number, whether that is an option, and what else the command requires."""
    for words, function in functions():
        found: Any = typer.main.get_command(commands._app(words[:1])).commands[words[0]]
        found = found.commands[words[1]] if len(words) > 1 else found
        whole = [key for key, kind in get_type_hints(function).items() if kind in kinds]
        for one in (param for param in found.params if param.name in whole):
            needed = [other for other in found.params if other.required and other is not one]
            values = [NEEDED.get(other.opts[0], "1") for other in needed]
            more = [
                f"{other.opts[0]}={value}" if other.param_type_name == "option" else value
                for other, value in zip(needed, values, strict=True)
            ]
            yield words, one.opts[0], one.param_type_name == "option", more


def test_every_whole_number_option_refuses_another_value_in_one_line(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    walked = set()
    for words, option, is_option, more in _options():
        walked.add((" ".join(words), option))
        for value in WRONG:
            given = [f"{option}={value}"] if is_option else ["--", value]
            ended = program(*words, *more, *given)
            assert ended.code == 2, (words, option, value[:8])
            assert len(ended.complaint) < 200, (words, option)
            assert option in ended.complaint, (words, option)
    assert {("decode", "--half-length"), ("calibrate steps", "--valid-days")} <= walked
    assert len(walked) >= 18


PYTHONS = ["nan", "-inf", "Infinity", "1_0", "١٢", "１２"]
"""What Python's float() reads, and a person or another program would not, or otherwise: 1_0 is 10 or a slip."""


@pytest.mark.parametrize("value", PYTHONS)
def test_every_numeric_option_refuses_nan_infinity_and_odd_spellings_in_one_line(
    value: str, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No length, force, gain or time is infinite, or no number; without effect is not an exception."""
    monkeypatch.chdir(tmp_path)
    walked = set()
    for words, option, is_option, more in _options(REAL):
        walked.add((" ".join(words), option))
        ended = program(*words, *more, *([f"{option}={value}"] if is_option else ["--", value]))
        assert ended.code == 2, (words, option)
        assert len(ended.complaint) < 200, (words, option)
        assert option in ended.complaint, (words, option)
    assert {("encode", "--gain"), ("nerve", "--path-m"), ("indent", "--doi-mm")} <= walked
    assert len(walked) >= 40


LISTS = {
    ("indent", "--doi-mm", "0.5", "--shape", "bar:3.0", "--receptor-x-mm"): "1,{}",
    ("encode", "--pressure"): "20,{}",
    ("decode", "--pressure"): "20,{}",
    ("design", "--minutes", "10", "--to", "a.py", "--depths-mm"): "0.3,{}",
    ("dry-run", "bars", "--set"): "doi_mm={}",
    ("dry-run", "bars", "--speed"): "{}",
    ("nerve", ".", "--afferents"): "SA1@{}",
    ("indent", "--doi-mm", "0.5", "--shape"): "bar:{}",
    ("indent", "--x-mm=0", "--doi-mm=0.5", "--shape"): "bar:3.0,turn_deg={}",
    ("decode", "--pressure", "20", "--threshold"): "1±{}",
    ("decode", "--pressure", "20", "--range"): "0,{}",
    ("indent", "--shape", "bar:3.0", "--doi-mm", "0.5", "--model", "auto", "--tol"): "{}",
}


@pytest.mark.parametrize("value", PYTHONS)
@pytest.mark.parametrize("words", LISTS, ids=" ".join)
def test_every_option_with_a_list_refuses_nan_infinity_and_odd_spellings_in_one_line(
    words: tuple[str, ...], value: str, program: Program
) -> None:
    *before, option = words
    ended = program(*before, f"{option}={LISTS[words].format(value)}" if option != "--set" else option,
                    *([LISTS[words].format(value)] if option == "--set" else []))  # fmt: skip
    assert ended.code == 2, ended
    assert len(ended.complaint.splitlines()) == 1


def _of_columns(path: Path) -> object:
    path.write_text(path.read_text("utf-8").replace("HEADER", "a,b"), encoding="utf-8")
    return read_columns(path, ("a", "b"))


def _of_shape(kind: str) -> Callable[[Path], object]:
    return lambda path: parse_shape(f"{kind}:{path}")


def _nwb(path: Path) -> object:
    value = path.read_text("utf-8")
    file = path.with_suffix(".nwb")
    with h5py.File(file, "w") as made:
        made["units/id"], made["units/spike_times_index"] = [0], [1]
        made["units/spike_times"] = np.array([value.encode()])
    return read_nwb(file, "", ColumnMap())


FILES: dict[str, tuple[str, Callable[[Path], object]]] = {
    "a table": ("HEADER\n1,{}\n2,3\n", _of_columns),
    "a recording": ("position_mm,rate\n-1,1\n0,{}\n1,2\n", lambda path: read_srp(path)),
    "the positions of a recording": ("position_mm,rate\n-1,1\n{},3\n14,2\n", lambda path: read_srp(path)),
    "spike times as text in NWB": ("{}", _nwb),
    "a profile": ("x_mm,height_mm\n-1,0.5\n0,{}\n1,0.5\n", _of_shape("profile")),
    "a height map": ("0,0,0,0\n0,{},1,0\n0,1,1,0\n0,0,0,0\n", lambda path: parse_shape(
        f"heightmap:{path},spacing_mm=0.5,raised=high")),
}  # fmt: skip
"""Files of a user with a number, and what reads them."""


@pytest.mark.parametrize("value", PYTHONS)
@pytest.mark.parametrize("file", FILES)
def test_every_data_file_refuses_nan_infinity_and_odd_spellings(file: str, value: str, tmp_path: Path) -> None:
    text, read = FILES[file]
    path = tmp_path / "mine.csv"
    path.write_text(text.format(value), encoding="utf-8")
    with pytest.raises(ValueError, match=r"number|NWB"):
        read(path)


@pytest.mark.parametrize("value", PYTHONS)
def test_typed_answers_and_environment_variables_refuse_nan_infinity_and_odd_spellings(
    value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibrate, "_wait_for_enter", lambda _: value)
    with pytest.raises(BadInputError):
        calibrate._typed_number("How many mm?")
    assert source._whole(value) is None
    monkeypatch.setenv("RIG_CACHE_GB", value)
    with pytest.raises(CacheError):
        most_bytes()
