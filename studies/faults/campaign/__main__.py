"""`python -m studies.faults.campaign`: count the cases, carry them out, and print what came of them."""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # a fork takes no threads along

import argparse
import json
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from studies.faults.campaign import real_time
from studies.faults.campaign.cases import Case, cases
from studies.faults.campaign.runner import carry_out, commit
from studies.faults.campaign.tables import records_of, summary, table, worst_as_csv
from studies.faults.campaign.world import BENCHES


def main() -> None:
    """The whole, or a sample."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bench", choices=[*BENCHES], action="append", help="these benches only")
    parser.add_argument("--phase", action="append", help="these phases only")
    parser.add_argument("--kind", help="faults whose class holds these words, such as 'flip to stage' or pair")
    parser.add_argument("--sample", type=int, help="so many cases, as many of each bench, phase and class of fault")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--case", action="append", help="the case of this name")
    parser.add_argument("--real-time", type=int, metavar="N", help="N cases of a sample, in real time over TCP")
    parser.add_argument("--load", type=int, default=0, help="with --real-time: processes that never rest beside it")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument(
        "--out", type=Path, default=Path("campaign.jsonl"), help="results; what is there is not redone"
    )
    parser.add_argument("--count", action="store_true", help="count the cases and end")
    parser.add_argument("--table", action="store_true", help="the tables of docs/faults.md, of the results in --out")
    parser.add_argument("--worst", type=Path, help="with --table: a CSV of the worst five of each bench and phase")
    options = parser.parse_args()
    if options.table:
        records = records_of(options.out)
        print(table(records))
        if options.worst is not None:
            command = "python -m studies.faults.campaign --table --worst"
            options.worst.write_text(worst_as_csv(records, command), encoding="ascii")
        return
    chosen = _chosen(options)
    _print_counts(chosen)
    if options.count:
        return
    done = {record["case"] for record in records_of(options.out) if record["commit"] == commit()}
    left = [case for case in chosen if case.name not in done]
    if done:
        print(f"{len(chosen) - len(left)} are in {options.out} already")
    if left and options.real_time is not None:
        real_time.carry_out(left, options.out, options.load, lambda line: print(line, flush=True))
    elif left:
        carry_out(left, options.out, options.processes, lambda line: print(line, flush=True))
    names = {case.name for case in chosen}
    found = [r for r in records_of(options.out) if r["case"] in names and r["commit"] == commit()]
    print(summary(found))
    if options.case:
        for record in found:
            print(json.dumps(record, indent=1))
    sys.exit(any(record["violations"] and not record["exempt"] for record in found))


def _chosen(options: argparse.Namespace) -> list[Case]:
    found: list[Case] = []
    with tempfile.TemporaryDirectory() as folder:
        for bench in options.bench or (BENCHES if options.real_time is None else real_time.BENCHES):
            found += cases(bench, Path(folder))
    if options.phase:
        found = [case for case in found if case.phase in options.phase]
    if options.kind:
        found = [case for case in found if options.kind in case.kind]
    if options.case:
        found = [case for case in found if case.name in options.case]
    number = options.sample if options.real_time is None else options.real_time
    return found if number is None else sample(found, number, options.seed)


def sample(of: Sequence[Case], number: int, seed: int) -> list[Case]:
    """So many cases, in turn from each bench, phase and class of fault; in the order of their messages."""
    chance = random.Random(seed)
    strata: dict[tuple[str, str, str], list[int]] = {}
    for n, case in enumerate(of):
        strata.setdefault((case.bench, case.phase, case.kind), []).append(n)
    for stratum in strata.values():
        chance.shuffle(stratum)
    turns, taken = list(strata.values()), list[int]()
    chance.shuffle(turns)
    while len(taken) < min(number, len(of)):
        for stratum in turns:
            if stratum and len(taken) < number:
                taken.append(stratum.pop())
    return [of[n] for n in sorted(taken)]


def _print_counts(chosen: Sequence[Case]) -> None:
    counts = Counter((case.bench, case.phase) for case in chosen)
    benches = list(dict.fromkeys(bench for bench, _ in counts))
    print(f"| cases | {' | '.join(benches)} |\n|---|{'---|' * len(benches)}")
    for phase in dict.fromkeys(phase for _, phase in counts):
        print(f"| {phase} | {' | '.join(str(counts[bench, phase]) for bench in benches)} |")
    print(f"{counts.total()} cases", flush=True)


if __name__ == "__main__":
    main()
