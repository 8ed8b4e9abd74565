"""An output does not take the name of another kind of file, which may be the user's script, data or configuration."""

from pathlib import Path

import pytest

from tests.program import Program

WRITES: dict[str, tuple[str, ...]] = {
    "a design's page": ("design", "--out", "mine.py"),
    "a design's script": ("design", "--to", "mine.html"),
    "a comparison's page": ("compare", "none", "--out", "mine.csv"),
    "the example's page": ("compare", "--example", "bar3", "--out", "mine.py"),
    "a benchmark's page": ("bench", "--out", "mine.toml"),
    "a configuration": ("init", "--to", "mine.py"),
    "a table of runs": ("runs", "--table", "mine.py"),
    "a study's table": ("study", "study.toml", "--out", "mine.toml"),
}


@pytest.mark.parametrize("what", WRITES)
def test_a_file_of_another_kind_is_not_overwritten(
    what: str, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name = next(word for word in WRITES[what] if word.startswith("mine."))
    Path(name).write_text("mine", encoding="utf-8")
    Path("study.toml").write_text('[[press]]\nshape = "bar:3"\ndoi_mm = [0.3]\n', encoding="utf-8")
    ended = program(*WRITES[what])
    assert ended.code == 2
    assert f"{name}: must end in ." in ended.err
    assert Path(name).read_text("utf-8") == "mine"
