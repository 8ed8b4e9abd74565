"""Parameter studies: what is combined, and the same answers however the work is given out."""

import os
import signal
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info

from rig.study.exceptions import StudyError, WorkersError
from rig.study.parallel import spread
from rig.study.parameter_study import Case, columns, read_study, solve
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.program import Program

PRESSES = """\
[[press]]
shape = "cylinder:9"
x_mm = [0.0, 0.5]
force_gwt = [1.0]

[[press]]
shape = "bar:3.0"
doi_mm = [0.2, 0.4]
"""


@pytest.fixture
def coarse(tmp_path: Path, coarse_fingers: str) -> Path:
    """Two fingers of some thousand nodes, two depths of receptors, two indentors: 12 cases."""
    path = tmp_path / "coarse.toml"
    path.write_text(f"receptor_depth_mm = [0.7, 0.9]\n{coarse_fingers}{PRESSES}", encoding="utf-8")
    return path


def test_every_combination_is_a_case(coarse: Path) -> None:
    cases = read_study(coarse)
    assert len(cases) == 2 * 2 * (1 + 2)
    assert cases[0].varied == (("tissue.epidermis_mm", 0.3),)
    assert [case.varied[0][1] for case in cases] == [0.3] * 6 + [0.5] * 6  # one finger's are together
    assert (cases[0].shape, cases[0].kind, cases[0].value, cases[0].x_mm) == (
        "cylinder:9",
        "force_gwt",
        1.0,
        (0, 0.5),
    )
    assert [case.value for case in cases[1:3]] == [0.2, 0.4]
    assert columns(cases)[:3] == ["tissue.epidermis_mm", "receptor_depth_mm", "shape"]


@pytest.mark.parametrize(
    ("old", "new", "code", "fields"),
    [
        (
            "epidermis_mm",
            "epidermis",
            "unknown_key",
            {"key": "tissue.epidermis", "near": ["epidermis_mm", "e_dermis"]},
        ),
        ("[0.3, 0.5]", "[0.3, 9]", "invalid_value", {"key": "tissue.epidermis_mm", "rule": "must be less than 1"}),
        ("force_gwt = [1.0]", "", "invalid_table", {"key": "press.0", "rule": "exactly one of"}),
    ],
)
def test_a_file_that_is_not_understood(coarse: Path, old: str, new: str, code: str, fields: dict[str, str]) -> None:
    coarse.write_text(coarse.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with raises(StudyError, code, **fields) as caught:
        read_study(coarse)
    assert str(caught.value).startswith(f"study {coarse}")
    assert "\n" not in str(caught.value)


def test_what_has_no_answer_says_why_in_its_row(coarse: Path) -> None:
    deep = coarse.read_text(encoding="utf-8").replace("doi_mm = [0.2, 0.4]", "doi_mm = [5.0]")
    coarse.write_text(deep, encoding="utf-8")
    (row,) = solve(read_study(coarse)[1])
    assert "DOI 5 mm: must be more than 0" in row["problem"]
    assert row["shape"] == "bar:3.0"


def test_a_row_is_the_models_answer_at_its_receptor(coarse: Path) -> None:
    case = read_study(coarse)[1]
    rows = solve(case)
    config = FingertipConfig.model_validate_json(case.config_json)
    finger = Fingertip.load(config, receptor_x_mm=(-1.0, 0.0), receptor_depth_mm=0.7)
    sed = finger.indent("bar:3.0", 0.0, doi_mm=0.2).receptor_measures["sed"]
    assert [(row["receptor_x_mm"], row["sed"]) for row in rows] == [(-1.0, sed[0]), (0.0, sed[1])]
    assert sed[1] != pytest.approx(sed[0], rel=0.1)


def test_processes_give_what_one_gives(program: Program, coarse: Path) -> None:
    alone = [row for case in read_study(coarse) for row in solve(case)]
    ended = program("study", coarse, "--processes", 2, "--json")
    assert (ended.code, ended.err) == (0, "")
    answer = ended.json
    assert (answer["cases"], answer["rows"], answer["problems"]) == (12, 4 * (2 * 2 + 2 * 2), 0)
    lines = coarse.with_suffix(".csv").read_text(encoding="utf-8").splitlines()
    names = lines[0].split(",")
    assert len(lines) == 1 + len(alone)
    for line, row in zip(lines[1:], alone, strict=True):
        assert line.split(",") == [str(row[name]) for name in names]  # the very same digits


def _killed(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_killed_process_is_told_of() -> None:
    with raises(WorkersError, "process_killed"):
        list(spread(_killed, [0, 1], processes=1))


def _threads_of_its_libraries(case: Case) -> set[int]:
    solve(case)
    return {library["num_threads"] for library in threadpool_info()}


def test_a_process_has_one_thread(coarse: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    assert list(spread(_threads_of_its_libraries, read_study(coarse)[:1], processes=1)) == [{1}]
