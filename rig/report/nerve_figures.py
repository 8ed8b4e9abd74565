"""Figures of simulated spikes: raster, rate over the press, rate against position."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.data import Run
from rig.data.spike_files import SPIKES, SpikeRecord, SpikeTrain
from rig.report.page_parts import figures_of
from rig.report.plot import Plot, Room, Series, Subplot, entry, guide, handles, in_grid, rows_of
from rig.report.run_figures import broken
from rig.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, YELLOW, signed
from rig.report.title_lines import title_lines
from rig_shared.natural_order import natural_order
from rig_shared.plural import number_of

Array = NDArray[np.float64]

_SPIKES = f"{SPIKES}.csv"
_COLORS = {"SA1": BLUE, "RA": ORANGE, "PC": GREEN}
_OTHER_COLORS = (PURPLE, YELLOW, GREY)
_BIN_S = 0.05
_BEFORE_S, _ROOM_S = 0.5, 3.0
_MOST_LABELS = 25
_PANELS_ACROSS, _PANELS_A_PAGE = 3, 9


@dataclass(frozen=True)
class Pressed:
    """A finished indentation: where, and when it touched, began and ended its last hold, and was lifted (s)."""

    group: str
    x_mm: float
    touch_s: float
    hold_s: float
    hold_end_s: float
    end_s: float


def pressed(run: Run) -> list[Pressed]:
    """Return the finished indentations in order."""
    touches = {event["index"]: event["t_s"] for event in run.stream("touch")}
    ends = {event["index"]: event["t_s"] for event in run.stream("indentation_end")}
    holds = {(event["index"], event["hold"]): event["t_s"] for event in run.stream("hold_start")}
    found = []
    for start in run.stream("indentation_start"):
        index = start["index"]
        if index not in run.done or index not in touches:
            continue
        last = run.done[index][-1]
        hold_s = holds[index, last["hold"]]
        unit = {"doi_mm": "mm", "force_gwt": "gwt"}[start["target"]]
        group = f"{start['indentor']} to {start['value']:g} {unit}"
        end_s = ends.get(index, last["t_s"])
        found.append(Pressed(group, last["x_mm"], touches[index], hold_s, last["t_s"], end_s))
    return found


def _fired(record: SpikeRecord) -> list[SpikeTrain]:
    return [one for one in record.trains if len(one.spike_s)]


def no_spikes_drawn(run: Run, record: SpikeRecord | None) -> str:
    """Return why the page draws no simulated spikes: they are of a part of the run, or none fired; else empty."""
    if record is None or not record.trains:
        return ""
    if record.until_s < run.end_s:
        return (
            f"The synthetic spikes beside this run end at {record.until_s:.1f} s; the run went on to {run.end_s:.1f} "
            "s. They are not drawn: repeat rig nerve."
        )
    return "" if _fired(record) else silent_sentence(run, record)


def silent_sentence(run: Run, record: SpikeRecord) -> str:
    """Return which simulated afferents never fired; empty if all did."""
    silent = [one for one in record.trains if not len(one.spike_s)]
    if not silent:
        return ""
    number = number_of(len(record.trains), "simulated afferents")
    if not _fired(record):
        return f"None of {number} fired in {number_of(len(pressed(run)), 'presses')}."
    of_model = Counter(one.model for one in record.trains)
    said = ", ".join(f"{n} of {of_model[model]} {model}" for model, n in Counter(one.model for one in silent).items())
    return f"{len(silent)} of {number} never fired and have no rows: {said}."


def nerve_figures(run: Run, record: SpikeRecord) -> list[Plot]:
    """Return the figures of simulated spikes; none without a finished indentation, or with `no_spikes_drawn`."""
    presses = pressed(run)
    if not presses or not record.trains or no_spikes_drawn(run, record):
        return []
    about = (
        f"Synthetic: spikes of simulated afferents, seed {record.seed}, at an electrode {record.electrode}. "
        "Afferents: synthetic_afferents.csv."
    )
    figures = [_run_raster(run, record, about), _over_press(run, record, presses, about)]
    if len({round(one.x_mm, 3) for one in presses}) > 1:
        panels = rate_panels(record, presses)
        quiet = "; ".join(one.title.replace("\n", ", ") for one in panels if not one.fired)
        silent = f"No spike, and no panel: {quiet}. " if quiet else ""
        firing = [one for one in panels if one.fired]
        figures += figures_of(firing, _PANELS_A_PAGE, lambda part: _rates(part, f"{silent}{about}"))
    return figures


@dataclass(frozen=True)
class RatePanel:
    """Rates (afferents, positions) of one class under one indentor in one window, against position (mm)."""

    title: str
    color: str
    x_mm: Array
    rates: Array

    @property
    def fired(self) -> bool:
        """Whether there was any spike."""
        return bool(self.rates.any())


def rate_panels(record: SpikeRecord, presses: Sequence[Pressed]) -> list[RatePanel]:
    """Return a panel for each indentor and target, window and class."""
    found = []
    for group in _groups(presses):
        mine = [one for one in presses if one.group == group]
        windows = {
            "press": [(one.touch_s, one.hold_s) for one in mine],
            "hold": [(one.hold_s, one.hold_end_s) for one in mine],
        }
        places = np.array([round(one.x_mm, 3) for one in mine])
        x = np.unique(places)
        for name, window in windows.items():
            for model in _models(record):
                each = np.array([_rate(train, window) for train in record.trains if train.model == model])
                rates = np.stack([each[:, places == one].mean(axis=1) for one in x], axis=1)
                found.append(RatePanel(f"{model}, {name}\n{group}", _color(record, model), x, rates))
    return found


def _rate(train: SpikeTrain, window: Sequence[tuple[float, float]]) -> list[float]:
    return [_count(train, begin, end) / max(end - begin, 1e-9) for begin, end in window]


def _rates(found: Sequence[RatePanel], about: str) -> Plot:
    columns = min(len(found), _PANELS_ACROSS)
    panels = [
        Subplot(
            "indentor x (mm)",
            "rate (impulses/s)",
            [
                *(
                    Series("plot", one.x_mm, rates, color=one.color, lw=0.9, alpha=0.8,
                           rows=rows_of(_SPIKES, "x_mm", "rate", of=one.title, row=number))
                    for number, rates in enumerate(one.rates) if rates.any()
                ),
                Series("plot", one.x_mm, one.rates.mean(axis=0), ls="-", marker="o", ms=2, color="black", lw=1.2,
                       rows=rows_of(_SPIKES, "x_mm", "mean rate", of=one.title)),
            ],
            title_lines(one.title, 2.6, 8), printed="x" if k % columns else "xy",
        )
        for k, one in enumerate(found)
    ]  # fmt: skip

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one in axes:
            one.set_ylim(0, None)

    return Plot(
        (9.6, 0.6 + 2.1 * -(-len(found) // _PANELS_ACROSS)), panels,
        "Simulated rate against position",
        "Mean rate of each afferent that fired, from touch to the last hold (press), and in the last hold "
        "(hold), against the position of the indentor; mean of repeats. Black: mean of the class, silent "
        f"afferents included. {about}",
        arrange=in_grid(len(panels), columns), finish=finish, titles={"fontsize": 8}, labels={"fontsize": 8},
        ticks={"labelsize": 8},
    )  # fmt: skip


def _color(record: SpikeRecord, model: str) -> str:
    others = [name for name in _models(record) if name not in _COLORS]
    return _COLORS.get(model) or _OTHER_COLORS[others.index(model) % len(_OTHER_COLORS)]


def _models(record: SpikeRecord) -> list[str]:
    return list(dict.fromkeys(one.model for one in record.trains))


def _groups(presses: Sequence[Pressed]) -> list[str]:
    return sorted({one.group for one in presses}, key=natural_order)


def _raster_in(record: SpikeRecord) -> float:
    """Return the height of a raster (in)."""
    return float(np.clip(0.17 * len(_fired(record)), 0.8, 4.2))


def _count(train: SpikeTrain, begin_s: float, end_s: float) -> int:
    return int(np.diff(np.searchsorted(train.spike_s, (begin_s, end_s)))[0])


_TIME = "time since the start of the run (s)"


def _run_raster(run: Run, record: SpikeRecord, about: str) -> Plot:
    ends_s = max(pressed(run)[0].touch_s - _ROOM_S, run.start["t_s"]), run.end_s
    room, high = Room(left=0.9, bottom=0.5, top=0.1, rows=0.08), _raster_in(record)
    silence = silent_sentence(run, record)

    def finish(figure: Figure, axes: list[Axes]) -> None:
        axes[0].set(xlim=ends_s)
        _name_rows(axes, record)

    return Plot(
        (9.6, high + 1.9), [_force(run, ends_s), _raster(record, ends_s)],
        "Simulated spikes",
        f"Each row is an afferent, each mark a spike. Above: force. {silence}{' ' * bool(silence)}{about}",
        f"{len(_fired(record))} of {number_of(len(record.trains), 'simulated afferents')} fired.",
        arrange=in_grid(2, room=room, sharex=True, height_ratios=(1.0, high)), finish=finish, legend=_classes(record),
        layout=None,
    )  # fmt: skip


def _over_press(run: Run, record: SpikeRecord, presses: Sequence[Pressed], about: str) -> Plot:
    """Plot the press with the most spikes, beside the rate of each class over all presses."""
    busiest = max(presses, key=lambda one: sum(_count(train, one.touch_s, one.end_s) for train in record.trains))
    ends_s = busiest.touch_s - _BEFORE_S, busiest.end_s + _BEFORE_S
    width, height = 9.6, max(_raster_in(record) + 1.9, 3.6)

    def arrange(figure: Figure) -> list[Axes]:
        left, wide = 0.9 / width, 4.5 / width
        above = figure.add_axes((left, (height - 0.95) / height, wide, 0.85 / height))
        below = figure.add_axes((left, 0.5 / height, wide, (height - 1.55) / height), sharex=above)
        beside = ((0.9 + 4.5 + 0.85) / width, 0.5 / height, 3.1 / width, (height - 0.6) / height)
        return [above, below, figure.add_axes(beside)]

    def finish(figure: Figure, axes: list[Axes]) -> None:
        above, _, right = axes
        above.set(xlim=ends_s)
        above.tick_params(labelbottom=False)
        _name_rows(axes, record)
        right.set_ylim(bottom=0)
        right.legend(fontsize=8, loc="upper right")

    return Plot(
        (width, height),
        [
            _force(run, ends_s), _raster(record, ends_s),
            Subplot("time since the start of the last hold (s)", "rate (impulses/s)", _class_rates(record, presses)),
        ],
        "Simulated spikes over the press",
        f"Left: the press with the most spikes, {busiest.group} at x = {signed(busiest.x_mm)} mm. Right: rate of "
        f"each class from touch to lift, in bins of {1e3 * _BIN_S:g} ms, mean over all its afferents and "
        f"{len(presses)} presses, each from the start of its last hold. {about}",
        arrange=arrange, finish=finish, legend=_classes(record), layout=None,
    )  # fmt: skip


def _class_rates(record: SpikeRecord, presses: Sequence[Pressed]) -> list[Series]:
    before = max(press.hold_s - press.touch_s for press in presses) + _BEFORE_S
    after = max(press.end_s - press.hold_s for press in presses) + _BEFORE_S
    bins = max(round((before + after) / _BIN_S), 1)
    edges = np.linspace(-before, bins * _BIN_S - before, bins + 1)
    found = []
    for model in dict.fromkeys(one.model for one in _fired(record)):
        trains = [train.spike_s for train in record.trains if train.model == model]
        counts = sum(np.histogram(spikes - press.hold_s, edges)[0] for spikes in trains for press in presses)
        rate = counts / (len(trains) * len(presses) * _BIN_S)
        found.append(Series("stairs", rate, edges, color=_color(record, model), label=model, lw=1,
                            rows=rows_of(_SPIKES, "class rate", "since hold_s", model=model)))  # fmt: skip
    return [*found, guide("axvline", 0.0, color=GREY, lw=0.6)]


def _force(run: Run, ends_s: tuple[float, float]) -> Subplot:
    read = [s for s in run.stream("sample") if ends_s[0] <= s["t_s"] <= ends_s[1]]
    rows = rows_of("sample.csv", "t_s", "force_gwt", ends_s=ends_s)
    return Subplot(
        _TIME, "force (gwt)", [Series("plot", *broken(read, run), color="black", lw=0.8, rows=rows)], printed="y"
    )


def _raster(record: SpikeRecord, ends_s: tuple[float, float]) -> Subplot:
    trains = _fired(record)
    shown = [one.spike_s[(one.spike_s >= ends_s[0]) & (one.spike_s <= ends_s[1])] for one in trains]
    colors = [_color(record, one.model) for one in trains]
    rows = rows_of(_SPIKES, "t_s", ends_s=ends_s)
    marks = Series("eventplot", shown, lineoffsets=range(len(trains)), colors=colors, linewidths=0.8, linelengths=0.8,
                   rows=rows)  # fmt: skip
    names = [one.afferent for one in trains] if len(trains) <= _MOST_LABELS else []
    return Subplot(_TIME, "", [marks], printed="x", y_names=names)


def _classes(record: SpikeRecord) -> list[Series]:
    """Return the legend of a raster with too many rows for their names."""
    models = dict.fromkeys(one.model for one in _fired(record)) if len(_fired(record)) > _MOST_LABELS else ()
    return [entry(name, color=_color(record, name)) for name in models]


def _name_rows(axes: list[Axes], record: SpikeRecord) -> None:
    above, below = axes[:2]
    trains, legend = _fired(record), _classes(record)
    above.tick_params(labelsize=8)
    below.set(ylim=(len(trains) - 0.5, -0.5))
    if legend:
        below.set_yticks(())
        below.legend(handles=handles(legend), fontsize=8, loc="upper right")
    else:
        below.set_yticks(range(len(trains)), [one.afferent for one in trains], fontsize=7)
