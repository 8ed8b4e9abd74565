"""Pages that a reader follows: every file written, every command run, in the order of the page."""

import re
import runpy
import shlex
import shutil
from pathlib import Path

import pytest

from tests.program import Program

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "tutorial"
NOT_RUN = {
    "tutorial": ["make setup", ". .venv/bin/activate", "cp examples/tutorial/synthetic_afferent.csv ."]
}  # what every test run begins with
PAGES = ("tutorial", "your_own_protocol", "coding")
SECTIONS = {"nerve": "## From a protocol to a verdict"}
"""Headings of the sections that are followed, of pages that are not followed as a whole."""


def blocks(page: str) -> list[tuple[str, str]]:
    """What its fences say they hold, and what they hold."""
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    if page in SECTIONS:
        text = text.partition(f"\n{SECTIONS[page]}\n")[2].partition("\n## ")[0]
        assert text
    return re.findall(r"^```([^\n]*)\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.quick(rows=lambda page: page != "your_own_protocol")
@pytest.mark.parametrize("page", [*PAGES, *SECTIONS])
def test_every_how_to_page_can_be_followed_literally(
    page: str, program: Program, empty_figures: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(EXAMPLES / "synthetic_afferent.csv", tmp_path)
    not_run, run_folder = [], ""
    for kind, text in blocks(page):
        language, _, file = kind.partition(" ")
        if file:
            Path(file).write_text(text, encoding="utf-8")
            continue
        for line in text.splitlines():
            if line.startswith("python "):
                runpy.run_path(line.removeprefix("python "), run_name="__main__")
            elif line.startswith("RUN=$(ls -d "):
                (run_folder,) = expanded(line.removeprefix("RUN=$(ls -d ").removesuffix(")"))
            elif line.startswith("rig "):
                line = line.replace("$RUN", run_folder)
                ended = program(*(found for word in shlex.split(line)[1:] for found in expanded(word)))
                assert ended.code == (2 if language == "fails" else 0), f"{line}: {ended.err}"
                assert language != "fails" or "30" in ended.complaint
            else:
                not_run.append(line)
    assert not_run == NOT_RUN.get(page, [])
    if page == "tutorial":
        (run,) = Path("runs").glob("*-first-*")
        assert "Complete:" in (run / "report.html").read_text(encoding="utf-8")
        assert "</html>" in Path("compared.html").read_text(encoding="utf-8")
        assert "<svg" in Path("press.svg").read_text(encoding="utf-8")


def test_the_script_on_the_tutorial_page_is_the_shipped_file() -> None:
    (text,) = [text for kind, text in blocks("tutorial") if kind == "python first.py"]
    assert text == (EXAMPLES / "first.py").read_text(encoding="utf-8")


def expanded(word: str) -> list[str]:
    """As a shell does it."""
    return sorted(map(str, Path().glob(word))) if "*" in word else [word]
