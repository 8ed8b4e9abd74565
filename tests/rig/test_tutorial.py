"""docs/tutorial.md, followed literally: every file written, every command run, in the order of the page."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from tests.program import Program

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "examples" / "tutorial"
BLOCKS = re.findall(r"^```([^\n]*)\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
NOT_RUN = ["make setup", ". .venv/bin/activate"]  # what every test run begins with


def test_a_reader_who_follows_the_page_ends_with_both_reports(
    program: Program, empty_figures: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(EXAMPLES / "synthetic_afferent.csv", tmp_path)
    not_run = []
    for kind, text in BLOCKS:
        language, _, file = kind.partition(" ")
        if file:
            Path(file).write_text(text, encoding="utf-8")
            continue
        for line in text.splitlines():
            if not line.startswith("rig "):
                not_run.append(line)
                continue
            ended = program(*(found for word in shlex.split(line)[1:] for found in _expanded(word)))
            if language == "fails":
                assert (ended.code, "30" in ended.complaint) == (2, True), ended.err
            else:
                assert ended.code == 0, f"{line}: {ended.err}"
    assert not_run == NOT_RUN
    (run,) = Path("runs").glob("*-first-*")
    assert "Complete:" in (run / "report.html").read_text(encoding="utf-8")
    assert "</html>" in Path("compared.html").read_text(encoding="utf-8")
    assert "<svg" in Path("press.svg").read_text(encoding="utf-8")


def test_the_script_on_the_page_is_the_one_that_is_shipped() -> None:
    (text,) = [text for kind, text in BLOCKS if kind == "python first.py"]
    assert text == (EXAMPLES / "first.py").read_text(encoding="utf-8")


def _expanded(word: str) -> list[str]:
    """As a shell does it."""
    return sorted(map(str, Path().glob(word))) if "*" in word else [word]
