"""Kept tables of chapter 6: what made them, and that the docs say what they hold."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from studies.coding import decoding_part, pages
from studies.coding.bands.drawn_presses import NEAR
from studies.coding.profiles_read_back import SCENES, SNRS_DB
from studies.registry import expanded

ROOT = Path(__file__).parents[2]
KEPT = ROOT / "studies" / "coding" / "kept"
TABLES = ("against noise, drawn", "against noise, fixed", "Decoding: shapes", "curvature, both ways", "an edge is")
"""Of which the docs have every row."""


@pytest.fixture(scope="module")
def kept() -> dict[str, Any]:
    return dict(json.loads((KEPT / "coding_tables.json").read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def docs() -> str:
    return _plain(expanded((ROOT / "docs" / "validation" / "coding.md").read_text(encoding="utf-8")))


def _plain(text: str) -> str:
    """Without what prose has and a table has not: spaces before %, its own minus sign, no colons in shapes' names."""
    spaced = text.replace(" %", "%").replace("−", "-")
    return re.sub(r"\b(bar|cylinder|step):", r"\1 ", spaced)


def _table(kept: dict[str, Any], title: str) -> dict[str, Any]:
    (found,) = [dict(table) for table in kept["tables"] if title in table["title"]]
    return found


def test_kept_tables_say_what_made_them(kept: dict[str, Any]) -> None:
    assert kept["command"] == f"python -m studies.coding.pages --draws {kept['draws']}"
    assert kept["draws"] >= decoding_part.DRAWS
    assert re.fullmatch(r"[0-9a-f]{40}", kept["commit"])  # of a tree without changes
    assert kept["seeds"] == pages.SEEDS
    assert {"numpy", "scipy", "indentation-rig"} <= set(kept["versions"])
    first, _ = (KEPT / "coding_tables.md").read_text(encoding="utf-8").split("\n", 1)
    assert (
        f"command {kept['command']}, commit {kept['commit']}, draws {kept['draws']}, seeds {kept['seeds']}" in first
    )


def test_both_kept_files_have_the_same_rows(kept: dict[str, Any]) -> None:
    text = (KEPT / "coding_tables.md").read_text(encoding="utf-8")
    for table in kept["tables"]:
        assert table["title"] in text
        for row in table["rows"]:
            assert f"| {' | '.join(row)} |" in text


@pytest.mark.parametrize("title", TABLES)
def test_the_docs_have_every_kept_row(kept: dict[str, Any], docs: str, title: str) -> None:
    rows = _table(kept, title)["rows"]
    assert len(rows) >= 6
    for row in rows:
        assert _plain(f"| {' | '.join(row)} |") in docs


def test_the_docs_have_whole_profiles_at_30_db(kept: dict[str, Any], docs: str) -> None:
    rows = _table(kept, "whole profiles under shapes")["rows"]
    for scene in SCENES:
        ours, upright, smooth = [row for row in rows if row[0].startswith(f"{scene.shape} ")]
        assert _plain(f"| {scene.shape} | {' | '.join(ours[2:5])} | {upright[2]} | {smooth[2]} |") in docs


def test_bands_of_drawn_presses_hold_what_they_should(kept: dict[str, Any], docs: str) -> None:
    """85 to 95 % of all, 80 % and more of each cell of SNR × shape."""
    table = _table(kept, "against noise, drawn")
    assert NEAR.ranges in table["text"]
    assert f"{kept['draws']} draws a cell" in table["text"]
    held = [[float(cell.split(", ")[1].rstrip("%")) for cell in row[1:]] for row in table["rows"]]
    assert [len(row) for row in held] == len(SCENES) * [len(SNRS_DB)]
    assert min(map(min, held)) >= 80
    pooled = re.search(r"Coverage pooled ([\d.]+)%", table["text"])
    assert pooled is not None
    assert 85 <= float(pooled[1]) <= 95
    assert f"pooled {pooled[1]}%" in docs
