"""Whether `auto` keeps its word, in scenes that its table has not seen, and what it saves.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.choice.verified [N] [KEPT]    # docs/validation/performance.md

Each scene is asked twice: for force alone, and for strain, each within a tolerance drawn from 0.5 to 20 %. What is
done is a line of KEPT (default: choice_verified.jsonl), and is not done again until that is deleted.
"""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.benchmark import SHARES
from sim.cheapest_model import Aim, Choice, NoModelError, Rung, Situation, bundled, cheapest
from studies.choice.answers import Row, Solver, answers, error, numbered
from studies.choice.drawn import DrawnScene, natural
from studies.choice.table import truth

SEED, N = 2026, 230
_STRAIN = (("force", "sed"), ("sed", "ep1"), ("ep1",))
_TOLERANCES = (0.005, 0.2)


@dataclass(frozen=True)
class VerifiedChoice:
    """A choice, and how it came out."""

    choice: Choice
    situation: Situation
    error: float
    seconds: float

    @property
    def within(self) -> bool:
        """Whether it held."""
        return self.error <= self.choice.aim.tolerance


def aims(n: int) -> list[tuple[Aim, Aim]]:
    """Two for each scene: force alone, and strain."""
    rng = np.random.default_rng(SEED + 1)

    def tolerance() -> float:
        return float(np.exp(rng.uniform(*np.log(_TOLERANCES))))

    return [
        (Aim(("force",), tolerance()), Aim(_STRAIN[int(rng.integers(len(_STRAIN)))], tolerance())) for _ in range(n)
    ]


def chosen(scenes: Sequence[DrawnScene]) -> tuple[dict[int, list[Choice]], Counter[str]]:
    """By the scene's number; and why there is none."""
    found: dict[int, list[Choice]] = {}
    refused = Counter[str]()
    for n, (scene, both) in enumerate(zip(scenes, aims(len(scenes)), strict=True)):
        situation = scene.situation
        for aim in both:
            try:
                choice = cheapest(situation, aim, bundled())
                found.setdefault(n, []).append(choice)
            except NoModelError as error:
                refused["beyond the table" if "no model's error" in str(error) else "no model holds"] += 1
    return found, refused


def outcomes(scenes: Sequence[DrawnScene], choices: dict[int, list[Choice]], kept: Path) -> Iterator[VerifiedChoice]:
    """Of every scene that the whole patch holds."""
    situations = {n: scenes[n].situation for n in choices}
    right = answers(numbered(scenes, {n: [truth(s.axes)] for n, s in situations.items()}, 0), kept)
    held = {n: some for n, some in choices.items() if "refused" not in right[truth(situations[n].axes).name, n]}
    asked = {n: {_solver(choice, situations[n]) for choice in some} for n, some in held.items()}
    known = answers(numbered(scenes, asked, 0), kept)
    for n, choice in ((n, choice) for n, some in held.items() for choice in some):
        true = right[truth(situations[n].axes).name, n]
        row = known[_solver(choice, situations[n]).name, n]
        if "refused" in row:  # its patch grows, and the model is another
            continue
        off = max(_error(row, true, quantity, scenes[n]) for quantity in choice.aim.quantities)
        seconds = choice.seconds - choice.cost.press_s + row["press_s"]
        yield VerifiedChoice(choice, situations[n], off, seconds)


def _solver(choice: Choice, situation: Situation) -> Solver:
    rung = Rung(choice.model, choice.level)
    return Solver(*rung, choice.axes, bundled().share(rung, situation))


def _error(row: Row, true: Row, quantity: str, scene: DrawnScene) -> float:
    return error(row, true, quantity, by_force=scene.force_gwt is not None)


def table(found: Sequence[VerifiedChoice]) -> Iterator[str]:
    """What was asked for, whether it held, and against always pressing the whole default or fine finger."""
    columns = ("tolerance", "asked for", "scenes", "held (%)", "error over tolerance, median / p95", "chosen",
               "from nothing, median (s): auto / default / fine", "memory, median (GB)")  # fmt: skip
    yield f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}"
    for low, high in ((0.005, 0.02), (0.02, 0.06), (0.06, 0.2)):
        for receptors in (False, True):
            some = [o for o in found if low < o.choice.aim.tolerance <= high and o.choice.aim.receptors == receptors]
            if some:
                yield _line(f"{100 * low:g}–{100 * high:g} %", "strain" if receptors else "force", some)
    yield _line("all", "", found)


def _line(tolerance: str, asked: str, some: Sequence[VerifiedChoice]) -> str:
    over = [o.error / o.choice.aim.tolerance for o in some]
    picked = Counter(f"{o.choice.model} {o.choice.level}".removesuffix(" default") for o in some)
    whole = {level: [_always(o.situation, level) for o in some] for level in ("default", "fine")}
    seconds = [[o.seconds for o in some], *([s for s, _ in of] for of in whole.values())]
    memory = [[o.choice.cost.memory_mb for o in some], *([m for _, m in of] for of in whole.values())]
    cells = (
        tolerance, asked, str(len(some)), f"{100 * np.mean([o.within for o in some]):.1f}",
        f"{np.median(over):.2f} / {np.percentile(over, 95):.2f}",
        ", ".join(f"{name} {n}" for name, n in picked.most_common()),
        " / ".join(f"{np.median(s):.1f}" for s in seconds), " / ".join(f"{np.median(m) / 1e3:.2f}" for m in memory),
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _always(situation: Situation, level: str) -> tuple[float, float]:
    """Seconds and MB of the whole finger, with its ten receptors."""
    cost = bundled().costs[Rung("finger", level), situation.axes, SHARES[-1], situation.sharp]
    return cost.build_s + cost.receptors_s + cost.press_s, cost.memory_mb


def main() -> None:
    """Choose, press, and print."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else N
    kept = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("choice_verified.jsonl")
    scenes = list(natural(n, SEED))
    choices, refused = chosen(scenes)
    found = list(outcomes(scenes, choices, kept))
    for line in table(found):
        print(line)
    sums = [sum(_always(o.situation, level)[0] for o in found) for level in ("default", "fine")]
    print(f"\n{n} scenes, asked twice: {dict(refused)}; {len(found)} answered, {sum(o.within for o in found)} held")
    print(f"{sum(map(len, choices.values())) - len(found)} leave a patch, which grows: not judged")
    print(f"all from nothing: {sum(o.seconds for o in found):.0f} s, default {sums[0]:.0f} s, fine {sums[1]:.0f} s")
    for o in found:
        if not o.within:
            print(f"missed: {o.situation} {o.choice.why}: {100 * o.error:.2g} %")


if __name__ == "__main__":
    main()
