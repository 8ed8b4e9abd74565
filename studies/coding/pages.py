"""Chapter 6 of the source: shift invariance, impulse responses, encoding and decoding on one page.

    .venv/bin/python -m studies.coding.pages [FOLDER] [--draws N]    # default: study, 40 draws; minutes on two cores

Writes FOLDER/coding.html and .pdf, and their tables with what made them: coding_tables.md and .json. Independent
pieces of work go over this machine's processes; each says when it is done.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rig.compare.workers import spread
from rig.data.folder import replace_bytes, replace_text
from rig.report.page import Section, as_png, render
from rig.report.pdf import as_pdf
from rig.session.resume import commit
from sim.config import E_EPIDERMIS_MPA
from sim.models.small_strain import small_strain
from studies.coding import (
    curvature_read_back,
    decoding_part,
    edge_place,
    profiles_part,
    profiles_read_back,
    section_part,
    shapes_part,
    shapes_read_back,
    spread_part,
    two_samples,
)
from studies.coding.bands import drawn_presses
from studies.source.matrix_page import markdown

Work = tuple[str, tuple[Any, ...]]

DEEPEST_MM = max(*(scene.doi_mm for scene in profiles_read_back.SCENES), edge_place.DOI_MM)
"""Of all presses on the page."""

SEEDS = {
    "two samples": two_samples.SEED,
    "whole profiles": profiles_read_back.SEED,
    "drawn presses": drawn_presses.SEED,
    "shapes": shapes_read_back.SEED,
    "templates": shapes_read_back.TEMPLATE_SEED,
    "curvature": curvature_read_back.SEED,
    "edges": edge_place.SEED,
}
"""Of the first draw of each study."""

_WORKS: dict[str, Callable[..., Any]] = {
    "shift invariance of the finger": spread_part.spreads_of_the_finger,
    "responses and encoding of the section": section_part.section_coded,
    "the worked example": decoding_part.searched,
    "decoding under noise": decoding_part.noisy,
    "a whole profile": profiles_part.profile,
    "whole profiles against noise": shapes_part.against_noise,
    "shapes": shapes_part.shapes,
    "curvature both ways": shapes_part.curvatures,
    "where an edge is": shapes_part.edges,
}
SHIFT, SECTION, SEARCH, NOISE, PROFILE, AGAINST_NOISE, SHAPES, CURVATURE, EDGES = _WORKS


def main(arguments: Sequence[str] | None = None) -> None:
    """Do all the work and write the page."""
    parser = argparse.ArgumentParser(description="Chapter 6 on one page.")
    parser.add_argument("folder", nargs="?", default="study", type=Path)
    parser.add_argument(
        "--draws", default=decoding_part.DRAWS, type=int, help="of the noise, for each cell of a table"
    )
    told = parser.parse_args(arguments)
    if told.draws < 2:
        parser.error(f"--draws {told.draws}: expected 2 or more")
    began = time.perf_counter()
    told.folder.mkdir(parents=True, exist_ok=True)
    asked = works(told.draws)
    print(f"{len(asked)} pieces of work over this machine's processes …", flush=True)
    done = carry_out(asked, partial(_say, began))
    write(told.folder, sections(done, told.draws), provenance(done, told.draws))
    print(f"everything {time.perf_counter() - began:.0f} s; {told.folder / 'coding.html'}")


def works(draws: int) -> list[Work]:
    """Quick ones first, so that something is said soon, then the longest."""
    noise: list[Work] = [(NOISE, job) for job in decoding_part.jobs(draws)]
    profiles: list[Work] = [(PROFILE, job) for job in profiles_part.jobs(draws)]
    against: list[Work] = [(AGAINST_NOISE, job) for job in shapes_part.noise_jobs(draws)]
    return [(SEARCH, ()), (SECTION, ()), *shape_works(draws), (SHIFT, ()), *profiles, *against, *noise]


def shape_works(draws: int) -> list[Work]:
    """Shapes, curvature and edges."""
    return [
        (SHAPES, (shapes_part.scenes_of(draws),)),
        (CURVATURE, (shapes_part.noise_draws_of(draws),)),
        (EDGES, (shapes_part.edge_draws_of(draws),)),
    ]


def carried_out(work: Work) -> Any:
    """One of them."""
    name, arguments = work
    return _WORKS[name](*arguments)


def carry_out(asked: Sequence[Work], say: Callable[[int, int, Work], object]) -> dict[Work, Any]:
    """All of them, over processes; `say(done, of, work)` as each has ended."""
    done: dict[Work, Any] = {}
    for work, answer in zip(asked, spread(carried_out, asked), strict=True):
        done[work] = answer
        say(len(done), len(asked), work)
    return done


def sections(done: dict[Work, Any], draws: int) -> list[Section]:
    """The page, in the order of the chapter."""
    searched: decoding_part.Searched = done[SEARCH, ()]
    noisy = {job: done[NOISE, job] for job in decoding_part.jobs(draws)}
    by_truths: dict[str, dict[int, decoding_part.NoisyDecoding]] = {}
    for (truths, snr_db, _), one in noisy.items():
        by_truths.setdefault(truths, {})[snr_db] = one
    clouds = by_truths.pop("")
    against = {job: done[AGAINST_NOISE, job] for job in shapes_part.noise_jobs(draws)}
    return [
        *spread_part.spread_sections(done[SHIFT, ()]),
        *section_part.section_sections(done[SECTION, ()]),
        *decoding_part.search_sections(searched),
        *decoding_part.noise_sections(by_truths, clouds, searched.samples),
        *profiles_part.profile_sections({job[0]: done[PROFILE, job] for job in profiles_part.jobs(draws)}, draws),
        *shapes_part.noise_sections(against, draws),
        *shapes_part.shape_sections([done[work] for work in shape_works(draws)], draws),
    ]


def provenance(done: dict[Work, Any], draws: int) -> dict[str, Any]:
    """What made the page."""
    return {
        "command": f"python -m studies.coding.pages --draws {draws}",
        "commit": commit(Path(__file__)),
        "draws": draws,
        "seeds": SEEDS,
        "nodes": done[SHIFT, ()].nodes,
        "e_epidermis_mpa": E_EPIDERMIS_MPA,
        "small_strain": small_strain("section", DEEPEST_MM).note,
        "versions": {name: version(name) for name in ("indentation-rig", "numpy", "scipy", "matplotlib")},
    }


def write(folder: Path, page: Sequence[Section], made_by: dict[str, Any]) -> None:
    """Page, PDF and tables."""
    title, about = "Encoding and decoding", "Chapter 6 of B. I. Raju, S.M. thesis, MIT, 1998, on the default finger."
    small = small_strain("section", DEEPEST_MM).note
    draw = partial(
        render, "sections.html.j2", title=title, about=about, sections=page, provenance=made_by, small_strain=small
    )
    replace_text(folder / "coding.html", draw())
    replace_bytes(folder / "coding.pdf", as_pdf(draw(picture=as_png), datetime.now(UTC)))
    tables = [section for section in page if section.rows]
    made = ", ".join(f"{key} {value}" for key, value in made_by.items())
    replace_text(folder / "coding_tables.md", f"{made}\n\n" + "\n".join(markdown(section) for section in tables))
    as_json = [{"title": s.title, "text": s.text, "header": s.header, "rows": s.rows} for s in tables]
    replace_text(
        folder / "coding_tables.json", json.dumps({**made_by, "tables": as_json}, ensure_ascii=False, indent=1)
    )


def _say(began: float, done: int, of: int, work: Work) -> None:
    name, arguments = work
    told = " ".join(getattr(argument, "shape", str(argument)) for argument in arguments if argument != "")
    print(f"{time.perf_counter() - began:5.0f} s  {done} of {of}  {name} {told}".rstrip(), flush=True)


if __name__ == "__main__":
    main()
