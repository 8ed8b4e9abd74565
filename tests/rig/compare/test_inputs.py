"""Recordings as they are named on the command line."""

import hashlib
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig.compare.comparison import compare
from rig.compare.exceptions import ComparisonError, RecordingError
from rig.compare.recordings.afferents_table import read_afferents
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.reading import Reading, read_recordings
from rig.data import Run
from tests.error_codes import raises
from tests.program import Program

THROUGHOUT = column_map(["observed=throughout"])


@pytest.fixture
def srp(tmp_path: Path) -> Path:
    path = tmp_path / "srp.csv"
    path.write_text("position_mm,rate\n-0.5,1\n-0.2,9\n0.1,3\n0.4,7\n", encoding="utf-8")
    return path


NAMED: dict[str, tuple[list[str], list[str], dict[str, tuple[str, ...]]]] = {
    "a shape by another of its names": (["bar:3.0={srp}"], [], {"bar:3": ()}),
    "a shape with an equals sign": (["bar:3.0,turn_deg=30={srp}"], [], {"bar:3,turn_deg=30": ()}),
    "a file with an equals sign": (["bar:3.0={equals}"], [], {"bar:3": ()}),
    "a depth": (["bar:3@0.50mm={srp}"], [], {"bar:3@0.5 mm": ()}),
    "one mirrored": (["bar:3.0={srp}"], ["bar:3"], {"bar:3": ("mirrored",)}),
    "one mirrored, named twice": (["bar:3.0={srp}"], ["bar:3", "bar:3"], {"bar:3": ("mirrored",)}),
    "one of two forces mirrored": (
        ["step:1@2.33gwt={srp}", "step:1@8 gwt={other}"], ["step:1@8gwt"],
        {"step:1@2.33 gwt": (), "step:1@8 gwt": ("mirrored",)},
    ),
    "both forces mirrored": (
        ["step:1@2.33gwt={srp}", "step:1@8 gwt={other}"], ["step:1"],
        {"step:1@2.33 gwt": ("mirrored",), "step:1@8 gwt": ("mirrored",)},
    ),
}  # fmt: skip
"""What is recorded and mirrored, and the recordings with what was done to them."""


@pytest.mark.parametrize("name", NAMED)
def test_recordings_are_known_by_shape_and_condition_and_mirrored_where_named(name: str, srp: Path) -> None:
    recorded, mirror, right = NAMED[name]
    equals, other = srp.with_name("depth=1.csv"), srp.with_name("other.csv")
    equals.write_bytes(srp.read_bytes())
    other.write_text(srp.read_text(encoding="utf-8") + "9,1\n", encoding="utf-8")
    texts = [text.format(srp=srp, equals=equals, other=other) for text in recorded]
    found = read_recordings(texts, mirror, [], Reading())
    assert {key: one.changes for key, one in found.items()} == right
    if list(right) == ["bar:3"]:
        turned = bool(mirror)
        assert found["bar:3"].sha256 == hashlib.sha256(srp.read_bytes()).hexdigest()
        assert found["bar:3"].position_mm.tolist() == ([-0.4, -0.1, 0.2, 0.5] if turned else [-0.5, -0.2, 0.1, 0.4])
        assert found["bar:3"].rate.tolist() == ([7, 3, 9, 1] if turned else [1, 9, 3, 7])


def test_spike_times_are_read_against_their_run(bar_run: Run, tmp_path: Path) -> None:
    starts = [e["t_s"] for e in bar_run.stream("hold_start") if e["hold"] == 2]
    spikes = [t + 0.01 * n for k, t in enumerate(starts) for n in range(5 * k)]
    path = tmp_path / "unit.csv"
    path.write_text("time_s\n" + "\n".join(f"{t:.6f}" for t in spikes), encoding="utf-8")
    found = read_recordings([f"bar:3.0={path}"], [], [bar_run], Reading((0.0, 0.4), 0.0, THROUGHOUT))["bar:3"]
    # Presses 0 … 5 at 0.8, 0.4, 0.1, −0.2, −0.6, 0.1 have 0, 5, … 25 spikes in 0.4 s.
    np.testing.assert_allclose(found.rate, [20 / 0.4, 15 / 0.4, 17.5 / 0.4, 5 / 0.4, 0])


def test_spike_times_belong_to_one_run(bar_run: Run, tmp_path: Path) -> None:
    path = tmp_path / "unit.csv"
    path.write_text("time_s\n1.0\n", encoding="utf-8")
    for runs, n in (([], 0), ([bar_run, bar_run], 2)):
        with raises(RecordingError, "not_one_run", path=str(path), shape="bar:3.0", runs=n):
            read_recordings([f"bar:3.0={path}"], [], runs, Reading())


def test_a_shape_at_another_depth_says_at_which_it_is(bar_run: Run, make_stimulus: Any, srp: Path) -> None:
    spikes = srp.with_name("u.csv")
    spikes.write_text("time_s\n1.0\n", encoding="utf-8")
    with raises(RecordingError, "never_pressed", shape="bar:3@8gwt", held="bar:3@0.4 mm"):
        read_recordings([f"bar:3@8gwt={spikes}"], [], [bar_run], Reading((0.0, 0.4)))
    x = np.linspace(-2, 2, 9)
    stimulus = make_stimulus("bar:3.0", x, np.array([0.0]), {}, kind="doi_mm", commanded=0.4)
    found = read_recordings([f"bar:3@8gwt={srp}"], [], [], Reading())
    with raises(ComparisonError, "never_pressed", shape="bar:3@8 gwt", names="bar:3.0 at 0.4 mm"):
        compare([stimulus], found)


@pytest.mark.parametrize(("sd", "other", "used"), [("1", None, True), ("0", None, False), ("1", "srp.csv", False)])
def test_an_sd_that_does_not_count_says_so(srp: Path, sd: str, other: str | None, used: bool) -> None:
    """The likelihood uses it only if every recording has one."""
    path = srp.with_name("sd.csv")
    path.write_text(f"position_mm,rate,sd\n0,4,{sd}\n1,8,{sd}\n2,3,{sd}\n", encoding="utf-8")
    recorded = [f"step:1={path}", *([] if other is None else [f"bar:3={srp.with_name(other)}"])]
    found = read_recordings(recorded, [], [], Reading())
    assert ("sd is not used" in found["step:1"].read_as) != used
    assert all("not used" not in found[key].read_as for key in found if key != "step:1")
    table = srp.with_name("afferents.csv")
    rows = "".join(f"a1,{one.replace('=', ',')}\n" for one in recorded)
    table.write_text(f"afferent,shape,file\n{rows}", encoding="utf-8")
    held: Any = [SimpleNamespace(shape=shape, condition="1 mm") for shape in ("step:1", "bar:3")]
    assert ("sd is not used" in read_afferents(table, [], [], held, Reading())["a1"]["step:1"].read_as) != used


@pytest.mark.parametrize(
    ("recorded", "mirror", "code", "fields"),
    [
        (["bar:3"], [], "no_shape_and_file", {"given": "bar:3"}),
        (["=a.csv"], [], "no_shape_and_file", {"given": "=a.csv"}),
        (["bar:3="], [], "no_shape_and_file", {"given": "bar:3="}),
        (["bar:3@8={srp}"], [], "no_condition", {"given": "bar:3@8", "condition": "8"}),
        (["bar:3@={srp}"], [], "no_condition", {"given": "bar:3@", "condition": ""}),
        (["bar:3={srp}", "bar:3.0={srp}"], [], "recorded_twice", {"shape": "bar:3.0"}),
        (["bar:3@8gwt={srp}", "bar:3@8.0gwt={srp}"], [], "recorded_twice", {"shape": "bar:3@8.0gwt"}),
        (["bar:3={srp}", "step:1={srp}"], [], "file_twice", {"shape": "step:1", "other": "bar:3"}),
        (["bar:3@8gwt={srp}", "bar:3@4gwt={srp}"], [], "file_twice", {"shape": "bar:3@4 gwt"}),
        (["bar:3={srp}", "step:1={again}"], [], "file_twice", {"shape": "step:1", "other": "bar:3"}),
        (["bar:3={srp}", "step:1={other}"], [], "several_units", {"first": "1/s", "second": "a.u."}),
        (["bar:3={srp}"], ["step:1"], "nothing_to_mirror", {"shape": "step:1"}),
        (["bar:3@8gwt={srp}"], ["bar:3@2gwt"], "nothing_to_mirror", {"shape": "bar:3@2gwt"}),
    ],
)
def test_what_is_named_wrongly(
    srp: Path, recorded: list[str], mirror: list[str], code: str, fields: dict[str, Any]
) -> None:
    again, other = srp.with_name("written_otherwise.csv"), srp.with_name("arbitrary_units.csv")
    other.write_text("position_mm,rate (a.u.)\n-1,0.2\n0,1\n1,0.3\n", encoding="utf-8")
    again.write_text(srp.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    with raises(RecordingError, code, **fields):
        read_recordings([text.format(srp=srp, again=again, other=other) for text in recorded], mirror, [], Reading())


def test_columns_without_a_recording() -> None:
    with raises(RecordingError, "unused_column", role="rate", column="FR", roles=""):
        read_recordings([], [], [], Reading(columns=column_map(["rate=FR"])))


@pytest.mark.parametrize("option", [("--window-s", "0,0.5"), ("--field-centre-mm", "0.5")])
@pytest.mark.parametrize("several", [False, True])
def test_options_of_spike_times_do_not_apply_to_a_table(
    program: Program, bar_run: Run, srp: Path, option: tuple[str, str], several: bool
) -> None:
    table = srp.with_name("afferents.csv")
    table.write_text(f"afferent,shape,file\na1,bar:3,{srp}\n", encoding="utf-8")
    recorded = table if several else f"bar:3.0={srp}"
    line = (
        "compare",
        bar_run.folder.path,
        "--recorded",
        recorded,
        *option,
        "--json",
        "--out",
        srp.with_name("a.html"),
    )
    told = json.loads(program(*line).out)
    assert (told["exit_code"], told["code"]) == (2, "unused_option")
    assert option[0] in told["error_text"]
