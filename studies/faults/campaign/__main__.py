"""`python -m studies.faults.campaign`: count the cases, carry them out, and print what came of them."""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # a fork takes no threads along

import argparse
import itertools
import random
import sys
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from studies.faults.campaign.cases import FaultCase, cases
from studies.faults.campaign.runner import CampaignProgress, carry_out, commit
from studies.faults.campaign.scenarios import SCENARIOS, Scenario
from studies.faults.campaign.tables import CampaignSummary, Record, names_in, records_of, told
from studies.faults.campaign.world import BENCHES


def main() -> None:
    """Carry out the cases that are asked for and are not in the results, then print what broke."""
    options = _options()
    if options.table:
        print(CampaignSummary(records_of(options.out)).table())
        return
    units = list(itertools.product(options.bench or BENCHES, SCENARIOS))
    counts = Counter((case.bench, case.phase) for unit in units for case in _cases(options, *unit))
    _print_counts(counts)
    if not counts:
        sys.exit("there is no such case")
    going = CampaignProgress(counts.total(), lambda line: print(line, flush=True))
    for unit in units:  # one at a time: what lies in memory makes every fork slower
        done = names_in(options.out, commit(), f"{unit[0]}/")
        whole = list(_cases(options, *unit))
        left = [case for case in whole if case.name not in done]
        going.skip(len(whole) - len(left))
        del done, whole
        carry_out(left, options.out, options.processes, going)
    summary = CampaignSummary(_found(options))
    print(summary)
    for record in _found(options):
        if options.case or (record["violations"] and record["exempt"] is None):
            print(told(record))
    sys.exit(bool(summary.bad))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bench", choices=[*BENCHES], action="append", help="these benches only")
    parser.add_argument("--case", action="append", help="the case of this name")
    parser.add_argument(
        "--shard", type=_shard, metavar="K/N", help="the cases of shard K of N, chosen by their names"
    )
    parser.add_argument("--processes", type=int, default=2)
    out = "results, added to; those of this commit are not redone"
    parser.add_argument("--out", type=Path, default=Path("campaign.jsonl"), help=out)
    parser.add_argument(
        "--table", action="store_true", help="the tables of studies/results/faults/, of the results in --out"
    )
    return parser.parse_args()


def _cases(options: argparse.Namespace, bench: str, scenario: Scenario) -> Iterator[FaultCase]:
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(bench, Path(folder), [scenario]):
            if (not options.shard or in_shard(case.name, *options.shard)) and (
                not options.case or case.name in options.case
            ):
                yield case


def _found(options: argparse.Namespace) -> Iterator[Record]:
    """Yield what is known of the cases that were asked for, at this commit."""
    for record in records_of(options.out):
        of_bench = not options.bench or record["bench"] in options.bench
        if record["commit"] == commit() and of_bench and (not options.case or record["case"] in options.case):
            yield record


def in_shard(name: str, one: int, of: int) -> bool:
    """Whether a case is in one of so many shards, which together are the whole."""
    return zlib.crc32(name.encode()) % of == one - 1


def _shard(text: str) -> tuple[int, int]:
    one, _, of = text.partition("/")
    if not 1 <= int(one) <= int(of):
        raise argparse.ArgumentTypeError(f"{text}: must be K/N with K from 1 to N")
    return int(one), int(of)


def sample(of: Sequence[FaultCase], number: int, seed: int) -> list[FaultCase]:
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


def _print_counts(counts: Counter[tuple[str, str]]) -> None:
    benches = list(dict.fromkeys(bench for bench, _ in counts))
    print(f"| cases | {' | '.join(benches)} |\n|---|{'---|' * len(benches)}")
    for phase in dict.fromkeys(phase for _, phase in counts):
        print(f"| {phase} | {' | '.join(str(counts[bench, phase]) for bench in benches)} |")
    print(f"{counts.total()} cases", flush=True)


if __name__ == "__main__":
    main()
