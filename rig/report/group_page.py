"""Page of several afferents: the verdict on the group, and one on each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from rig.compare.comparison_rows import measure_unit
from rig.compare.group import GroupRow, GroupVerdict
from rig.compare.group_text import METHOD, in_short, is_synthetic, sentence_of_group, sentences_of_group
from rig.compare.recordings.reading import sha256
from rig.compare.recordings.recording import Recording
from rig.compare.spike_clock import ClockShift
from rig.compare.verdict import AfferentVerdict
from rig.compare.verdict_text import percent, positions
from rig.data import Run
from rig.data.folder import replace_text
from rig.report.page_parts import Section, render
from rig.report.page_source import source_line
from rig.report.plot import Plot, Series, Subplot, rows_of
from rig.report.spikes_section import spikes_sections
from rig.report.style import as_limits, as_number
from rig_shared.plural import number_of

_WIDE_IN, _ROW_IN, _AROUND_IN = 9.0, 0.24, 1.9
_LEAST, _MOST = 0.5, 100.0  # differences of log-likelihoods between which colors are told apart
_MEASURES = (
    "candidate", "probability", "log-likelihood below the best", "wins", "in the set of", "gain [95 %]",
    "factor between afferents (1 sd)", "threshold [95 %]", "sd between afferents",
)  # fmt: skip


@dataclass(frozen=True)
class GroupPage:
    """Content of the page: verdicts, recordings by afferent, afferents left out with reasons, and provenance."""

    verdict: GroupVerdict | None
    verdicts: Mapping[str, AfferentVerdict]
    recordings: Mapping[str, Mapping[str, Recording]]
    left_out: Mapping[str, str]
    runs: Sequence[Run]
    command: str
    small_strain: str
    shift: ClockShift | None = None

    @property
    def title(self) -> str:
        """Title, which marks synthetic recordings."""
        names = [one.name for some in self.recordings.values() for one in some.values()]
        made = " (synthetic recordings)" if is_synthetic(names) else ""
        return f"Which measure explains {number_of(len(self.verdicts), 'afferents')}?{made}"


def write_group_page(path: Path, page: GroupPage) -> None:
    """Write the page."""
    html = render(
        "identification.html.j2",
        title=page.title,
        about=source_line(page.runs),
        runs=page.runs,
        sections=group_sections(page),
    )
    replace_text(path, html)


def group_sections(page: GroupPage) -> list[Section]:
    """Return the sections in page order."""
    verdict = page.verdict
    figures = () if verdict is None else (log_likelihoods(verdict),)
    found = [Section("Verdict on the group", sentence_of_group(verdict), figures=figures)]
    if verdict is not None:
        found.append(Section("Details", "", points=(*sentences_of_group(verdict), *_left_out(page))))
    found.append(_afferents(page))
    if verdict is not None:
        found.append(
            Section(
                "Candidates in common",
                METHOD + " Gain and threshold have the sign in which the rate rises, in the unit of the measure.",
                _MEASURES,
                tuple(map(_row, verdict.rows)),
            )
        )
    return [*found, *spikes_sections(page.recordings, page.shift), _recordings(page), _provenance(page)]


def _left_out(page: GroupPage) -> list[str]:
    if not page.left_out:
        return []
    return [f"Left out of {number_of(len(page.recordings), 'afferents')}: {', '.join(page.left_out)}."]


def _row(row: GroupRow) -> tuple[str, ...]:
    of = row.population
    return (
        f"{row.name}{' (control)' if row.control else ''}",
        f"{100 * row.probability:.1f} %",
        f"{row.worse_by:.1f}",
        str(row.wins),
        str(row.kept),
        f"{as_number(of.gain)} {as_limits(of.gain_limits)} {_gain_unit(row.name)}",
        as_number(of.gain_factor),
        f"{as_number(of.threshold)} {as_limits(of.threshold_limits)} {_unit(row.name)}".strip(),
        f"{as_number(of.threshold_sd)} {_unit(row.name)}".strip(),
    )


def _unit(name: str) -> str:
    """Return the unit of a measure or control, "" for a strain."""
    unit = measure_unit(name)
    return "" if unit == "1" else unit


def _gain_unit(name: str) -> str:
    unit = _unit(name)
    return f"1/s per {unit}" if unit else "1/s"


def _afferents(page: GroupPage) -> Section:
    rows = [
        (
            name,
            in_short(one),
            f"{len(one.places.rate)} of {one.recorded}",
            f"at most {percent(one.ceiling)}" if one.ceiling_from == "monotone" else percent(one.ceiling),
        )
        for name, one in page.verdicts.items()
    ]
    rows += [(name, f"Left out: {why}", "–", "–") for name, why in page.left_out.items()]
    return Section(
        "Verdict on each afferent",
        "Each row is the verdict of its recordings alone. `rig compare` with `--recorded SHAPE=FILE` writes its "
        "whole page.",
        ("afferent", "verdict", "positions used", "explainable share"),
        tuple(rows),
        points=tuple(f"{name}: {positions(one)}" for name, one in page.verdicts.items() if one.left_out),
    )


def _recordings(page: GroupPage) -> Section:
    rows = [
        (afferent, shape, one.name, ", ".join(one.changes) or "–", one.sha256)
        for afferent, some in page.recordings.items()
        for shape, one in some.items()
    ]
    return Section("Recordings", "", ("afferent", "shape", "file", "changes", "SHA-256"), tuple(rows))


def _provenance(page: GroupPage) -> Section:
    versions = ", ".join(f"{name} {version(name)}" for name in ("indentation-rig", "numpy", "scipy", "matplotlib"))
    rows = [
        (run.folder.path.name, sha256(run.folder.events), sha256(run.folder.path / "config.toml"))
        for run in page.runs
    ]
    text = f"This command reproduces the page and its figure: `{page.command}`. {versions}. {page.small_strain}."
    return Section("Provenance", text, ("run", "SHA-256 of events.jsonl", "of config.toml"), tuple(rows))


def log_likelihoods(verdict: GroupVerdict) -> Plot:
    """Plot how far the log-likelihood of each afferent under each measure is below the best one."""
    rows = verdict.rows
    below = np.array([row.by_afferent for row in rows])
    below = below - below.min(axis=0)
    image = Series("imshow", np.clip(below.T, _LEAST, _MOST), norm=LogNorm(_LEAST, _MOST), cmap="cividis_r",
                   aspect="auto", rows=rows_of("group", "below the best"))  # fmt: skip
    panel = Subplot(
        "", "", [image], printed="", x_names=[row.name for row in rows], y_names=list(verdict.afferents),
        color="log-likelihood\nbelow the best (1)",
    )  # fmt: skip

    def finish(figure: Figure, panels: list[Axes]) -> None:
        (axes,) = panels
        axes.set_xticks(range(len(rows)), panel.x_names, rotation=60, ha="right")
        axes.set_yticks(range(len(panel.y_names)), panel.y_names)
        for n, row in enumerate(rows):
            if row.in_set:
                axes.text(n, -0.65, f"{100 * row.probability:.0f} %", ha="center", va="bottom", fontsize=8)
        axes.spines[:].set_visible(False)
        scale = figure.colorbar(axes.images[0], ax=axes, label=panel.color, extend="both")
        ticks = (_LEAST, 1.0, 10.0, _MOST)
        scale.set_ticks(list(ticks), labels=[f"{value:g}" for value in ticks])

    return Plot(
        (_WIDE_IN, _AROUND_IN + _ROW_IN * (len(verdict.afferents) + 1)), [panel],
        "Log-likelihood of each afferent under each measure in common",
        "Difference from the highest log-likelihood of the afferent; darker is worse, and differences above "
        f"{_MOST:g} look alike. Numbers at the top: probabilities in the group.",
        sentence_of_group(verdict), finish=finish,
    )  # fmt: skip
