"""The documentation builds as a site without a warning, holds every page, and links where pages name one another."""

import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from rig.cli.program import COMMANDS
from tests.waiting import DEADLINE_S

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
GENERATED = (
    *("columns.md", "commands.md", "device_interface.md", "json_output.md"),
    *("python_names.md", "settings.md", "studies.md"),
)

LISTED_ONCE = """
import furo
for_page = furo._compute_navigation_tree
furo._compute_navigation_tree = lambda context: for_page(context) if context["pagename"] == "index" else ""
"""
"""The list of all pages beside the first page only: beside each of them, it is a third of the build."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("sphinx", reason="needs Sphinx: pip install -e '.[dev]'")
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(
        DOCS, folder / "docs", ignore=shutil.ignore_patterns(*GENERATED, "__pycache__", "gallery", "json_schemas")
    )
    with (folder / "docs" / "conf.py").open("a", encoding="utf-8") as conf:
        conf.write(LISTED_ONCE)
    for name in ("examples/gallery", "studies/results"):
        shutil.copytree(ROOT / name, folder / name)
    # tests/test_gallery.py runs the scripts of the gallery
    options = ("-W", "--keep-going", "-q", "-D", "plot_gallery=0", "-b", "html")
    words = [sys.executable, "-m", "sphinx", *options, "docs", "html"]
    built = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=10 * DEADLINE_S)
    assert built.returncode == 0, built.stderr
    return folder / "html"


def test_the_site_holds_every_page_and_links_it_from_the_first(site: Path) -> None:
    index = (site / "index.html").read_text(encoding="utf-8")
    for page in [*DOCS.glob("*.md"), *(DOCS / name for name in GENERATED)]:
        assert (site / page.with_suffix(".html").name).exists(), page.name
        assert page.stem == "index" or f'href="{page.stem}.html"' in index, page.name


def test_the_site_links_pages_that_name_one_another(site: Path) -> None:
    assert 'href="first_light.html"' in (site / "tutorial.html").read_text(encoding="utf-8").split("From here")[1]
    for page in sorted((DOCS / "decisions").glob("0*.md")):
        named = set(re.findall(r"`docs/([\w/]+)\.md`", page.read_text(encoding="utf-8")))
        shown = (site / "decisions" / f"{page.stem}.html").read_text(encoding="utf-8")
        assert all(f'href="../{name}.html"' in shown or name.startswith("decisions/") for name in named), page.name


def test_the_site_documents_every_command_with_its_options(site: Path) -> None:
    page = (site / "commands.html").read_text(encoding="utf-8")
    for name in COMMANDS:
        assert f">rig {name}<" in page.replace('<span class="pre">', "").replace("</span>", ""), name
    for option in ("--doi-mm", "--recorded", "--subject"):
        assert option in page


@pytest.mark.parametrize("door", ["sim", "rig.protocol"])
def test_the_site_documents_every_public_name(site: Path, door: str) -> None:
    page = (
        (site / "python_names.html")
        .read_text(encoding="utf-8")
        .replace('<span class="pre">', "")
        .replace("</span>", "")
    )
    for name in import_module(door).__all__:
        assert f'id="{door}.{name}"' in page or f">{name}<" in page, name


def test_the_site_loads_nothing_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r'(?:<script[^>]* src|<link[^>]*stylesheet[^>]* href)="https?:', text), page.name
