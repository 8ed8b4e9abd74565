"""Scripts as files: where they are found, what they may hold, and what is said of parameters that cannot be."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from rig.protocol.errors import BadInputError
from rig.protocol.script import Script, load_script, script_with

RUN = "def run(rig):\n    pass\n"
HEAD = "from rig.protocol import Field, ProtocolParameters\n\n\nclass Parameters(ProtocolParameters):\n"


def _file(folder: Path, text: str) -> Path:
    path = folder / "mine.py"
    path.write_text(text, encoding="utf-8")
    return path


def _with(folder: Path, fields: str, **given: Any) -> Script:
    return script_with(_file(folder, f"{HEAD}    {fields}\n\n\n{RUN}"), "mine", given)


def _said(folder: Path, fields: str, **given: Any) -> str:
    with pytest.raises(BadInputError) as caught:
        _with(folder, fields, **given)
    return str(caught.value)


# --- found and loaded ---


def test_a_script_knows_its_whole_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _file(tmp_path, RUN)
    monkeypatch.chdir(tmp_path)
    assert load_script("mine.py").path == path.resolve()


def test_a_file_comes_before_a_shipped_script_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "steps.py").write_text(RUN, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert load_script("steps.py").source == ""
    assert load_script("steps").source != ""


def test_a_shipped_script_is_named_without_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("elsewhere/steps", "elsewhere/steps.py"):
        with pytest.raises(BadInputError, match=f"protocol '{name}': no such file, and not a shipped one"):
            load_script(name)


@pytest.mark.parametrize(
    ("metadata", "title", "source"),
    [
        ("{'title': 'Two presses', 'source': 'p. 12'}", "Two presses", "p. 12"),
        ("{'title': 3}", "3", ""),
        ("{}", "mine", ""),
        ("'Two presses'", "mine", ""),
        ("None", "mine", ""),
    ],
)
def test_metadata_is_a_table_or_ignored(tmp_path: Path, metadata: str, title: str, source: str) -> None:
    script = load_script(str(_file(tmp_path, f"METADATA = {metadata}\n{RUN}")))
    assert (script.title, script.source) == (title, source)


def test_annotations_may_be_postponed(tmp_path: Path) -> None:
    text = (
        f"from __future__ import annotations\nfrom typing import Literal\n{HEAD}    step: Literal['1', '3'] = '1'\n"
    )
    assert load_script(str(_file(tmp_path, text + RUN)), ["step=3"]).parameters.model_dump() == {"step": "3"}


def test_an_exit_at_import_is_named(tmp_path: Path) -> None:
    path = _file(tmp_path, "import sys\nsys.exit(3)\n")
    with pytest.raises(BadInputError) as caught:
        load_script(str(path))
    assert str(caught.value) == f"protocol {path}, line 2: SystemExit: 3"


# --- parameters ---


def test_parameters_stay_as_they_were_checked(tmp_path: Path) -> None:
    parameters = _with(tmp_path, "force_gwt: float = Field(2.0, le=3)").parameters
    with pytest.raises(ValidationError, match="frozen"):
        parameters.force_gwt = 4.0  # type: ignore[attr-defined]


def test_a_default_beyond_its_own_bound_is_refused(tmp_path: Path) -> None:
    said = _said(tmp_path, "force_gwt: float = Field(4.0, le=3)")
    assert said.startswith("--set: force_gwt = 4.0: input should be less than or equal to 3 ")


def test_what_is_not_finite_is_refused(tmp_path: Path) -> None:
    for given in (float("inf"), float("nan")):
        assert "input should be a finite number" in _said(tmp_path, "force_gwt: float = 2.0", force_gwt=given)


def test_a_script_without_parameters_says_so(tmp_path: Path) -> None:
    with pytest.raises(BadInputError) as caught:
        load_script(str(_file(tmp_path, RUN)), ["force_gwt=1"])
    assert str(caught.value) == "--set: force_gwt: there is no such key (parameters of mine.py: none)"


def test_a_parameter_that_must_be_given_is_named(tmp_path: Path) -> None:
    said = _said(tmp_path, "force_gwt: float\n    hold_s: float = 1.0")
    assert said == "--set: force_gwt: field required (parameters of mine.py: force_gwt, hold_s)"


def test_the_first_of_several_problems_is_told(tmp_path: Path) -> None:
    said = _said(tmp_path, "first: int = 1\n    second: int = 2", first="a", second="b")
    assert said.startswith("--set: first = 'a': input should be a valid integer")


def test_what_the_script_itself_demands_is_told_in_its_words(tmp_path: Path) -> None:
    fields = "\n    ".join(
        (
            "low: int = 1",
            "",
            "def model_post_init(self, context):",
            "    if self.low > 1:",
            "        raise ValueError('low: expected at most 1')",
        )
    )
    assert _said(tmp_path, fields, low=2) == ("--set: low: expected at most 1 (parameters of mine.py: low)")


def test_long_values_are_told_in_short(tmp_path: Path) -> None:
    """Of a list or a table the first three, of a text 200 characters."""
    assert "--set: places = [1, 2, 3, ...]: " in _said(tmp_path, "places: int = 1", places=[1, 2, 3, 4, 5])
    said = _said(tmp_path, "table: int = 1\n    n: int = 2", table=[{"a": 1, "b": 2, "c": 3, "d": 4}])
    assert "--set: table = [{'a': 1, 'b': 2, 'c': 3, ...}]: " in said
    said = _said(tmp_path, "count: int = 1", count="9" * 150 + "x" * 150)
    told = said.removeprefix("--set: count = ").split(":")[0]
    assert len(told) == 200
    assert told.startswith("'999")
    assert told.endswith("xxx'")
