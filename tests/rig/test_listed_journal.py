"""A journal as a list of many runs reads it: the same is said of a run, and few of its lines are taken apart."""

import json
from pathlib import Path
from typing import Any

import pytest

import rig.data.journal as listed_journal
from rig.data.run import RunError, read_run
from rig.data.tables import LISTED, _holds, summarised, summary_of
from tests.error_codes import raises

OLD = Path(__file__).parents[1] / "data" / "runs"
START = {"doc": "start", "t_s": 0.0}
RESUME, STOP = {"doc": "resume", "t_s": 5.0}, {"doc": "stop", "t_s": 9.0, "status": "done"}


def event(stream: str, t_s: float, **data: Any) -> dict[str, Any]:
    return {"doc": "event", "t_s": t_s, "stream": stream, "data": {"index": 0, **data}}


def lines(*documents: dict[str, Any]) -> str:
    return "".join(json.dumps(one) + "\n" for one in documents)


@pytest.mark.parametrize("block", [1, 1000])
@pytest.mark.parametrize("name", [path.name for path in OLD.iterdir() if (path / "events.jsonl").is_file()])
def test_the_list_reader_reports_the_same_of_a_stored_run_as_the_full_reader(
    name: str, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listed_journal, "_BLOCK", block)
    whole = read_run(OLD / name)
    assert summarised(OLD / name) == (summary_of(whole), _holds(whole))
    few = read_run(OLD / name, only=LISTED)
    assert (few.units, few.duration_s, few.end_s, few.stop) == (
        whole.units,
        whole.duration_s,
        whole.end_s,
        whole.stop,
    )
    for stream in LISTED:
        assert few.stream(stream) == whole.stream(stream)
    assert sum(map(len, few.events.values())) < 0.5 * sum(map(len, whole.events.values()))


@pytest.mark.parametrize(
    "written",
    [
        "",
        lines(START),
        lines(START)[:-1],
        lines(START, event("touch", 1.0), event("sample", 2.0)),
        lines(START, event("touch", 1.0), STOP).replace("\n", "\n\n"),
        lines(START, event("touch", 1.0), STOP).replace(": ", ":"),
        lines(START, event("touch", 1.0), STOP)[:-9],
        lines(START, event("touch", 1.0, text="süß"), STOP).replace("\\u00fc", "ü"),
    ],
    ids=["empty", "begun", "no line's end", "killed", "blank lines", "written otherwise", "torn", "no ASCII"],
)
def test_the_list_reader_agrees_with_the_full_reader_on_any_journal(written: str, tmp_path: Path) -> None:
    (tmp_path / "events.jsonl").write_text(written, encoding="utf-8")
    if not written:
        for only in (None, ("touch",)):
            with raises(RunError, "no_start", run=str(tmp_path)):
                read_run(tmp_path, only=only)
        return
    whole, few = read_run(tmp_path), read_run(tmp_path, only=("touch",))
    assert few.stream("touch") == whole.stream("touch")
    assert (few.start, few.stop, few.parts, few.end_s) == (whole.start, whole.stop, whole.parts, whole.end_s)


@pytest.mark.parametrize("number", [3, 6])
@pytest.mark.parametrize(
    "spoil",
    [lambda line: line[:-1], lambda line: line[1:], lambda line: line[:20], lambda line: "x", lambda line: "{}"],
    ids=["its end", "its begin", "half of it", "noise", "no document"],
)
def test_the_list_reader_names_a_damaged_line_even_of_a_reading(spoil: Any, number: int, tmp_path: Path) -> None:
    """Also where it is a reading, which nobody takes apart."""
    path = tmp_path / "events.jsonl"
    readings = (event("sample", t_s) for t_s in (1.0, 2.0, 3.0))
    found = lines(START, *readings, event("touch", 4.0), RESUME, STOP).split("\n")
    found[number - 1] = spoil(found[number - 1])
    path.write_text("\n".join(found), encoding="utf-8")
    for only in (None, ("touch",)):
        assert [damage.line for damage in read_run(tmp_path, only=only).damage] == [number]
