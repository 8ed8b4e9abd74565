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
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from studies.faults.campaign.cases import FaultCase, cases
from studies.faults.campaign.runner import CampaignProgress, carry_out, commit
from studies.faults.campaign.scenarios import SCENARIOS, Scenario
from studies.faults.campaign.tables import CampaignSummary, Record, names_in, records_of, told
from studies.faults.campaign.world import BENCHES


def main() -> None:
    """The whole, or a sample."""
    options = _options()
    if options.table:
        print(CampaignSummary(records_of(options.out)).table())
        return
    picked: set[str] | None = None
    if options.sample is not None:
        picked = {case.name for case in sample(list(_cases(options)), options.sample, options.seed)}
    shard = list(_cases(options)) if options.shard else None
    every = _cases(options) if shard is None else shard
    counts = _counted(case for case in every if picked is None or case.name in picked)
    if not counts:
        sys.exit("no case is asked for: --count prints the phases of every bench")
    if options.count:
        return
    going = CampaignProgress(counts, lambda line: print(line, flush=True))
    for bench, scenario in _units(options):  # one at a time: what lies in memory makes every fork slower
        done = names_in(options.out, commit(), f"{bench}/")
        of_unit = _cases(options, bench, scenario) if shard is None else _of_unit(shard, bench, scenario)
        some = [case for case in of_unit if picked is None or case.name in picked]
        left = [case for case in some if case.name not in done]
        going.skip(len(some) - len(left))
        del done, some
        carry_out(left, options.out, options.processes, going)
    summary = CampaignSummary(r for r in _found(options) if picked is None or r["case"] in picked)
    print(summary)
    for record in _found(options):
        if options.case or (record["violations"] and record["exempt"] is None):
            print(told(record))
    sys.exit(bool(summary.bad))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bench", choices=[*BENCHES], action="append", help="these benches only")
    parser.add_argument("--phase", action="append", help="these phases only")
    parser.add_argument("--kind", help="faults whose class holds these words, such as 'flip to stage' or pair")
    parser.add_argument("--sample", type=int, help="so many cases, as many of each bench, phase and class of fault")
    parser.add_argument(
        "--shard", type=_shard, metavar="K/N", help="the cases of shard K of N, chosen by their names"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--case", action="append", help="the case of this name")
    parser.add_argument("--processes", type=int, default=2)
    out = "results, added to; those of this commit are not redone"
    parser.add_argument("--out", type=Path, default=Path("campaign.jsonl"), help=out)
    parser.add_argument("--count", action="store_true", help="count the cases and end")
    parser.add_argument(
        "--table", action="store_true", help="the tables of studies/results/faults/, of the results in --out"
    )
    return parser.parse_args()


def _units(options: argparse.Namespace) -> Iterator[tuple[str, Scenario]]:
    return itertools.product(options.bench or BENCHES, SCENARIOS)


def _cases(options: argparse.Namespace, bench: str = "", scenario: Scenario | None = None) -> Iterator[FaultCase]:
    """Those that are asked for, of one scenario on one bench or of all."""
    units = [(bench, scenario)] if scenario is not None else _units(options)
    for on, one in units:
        with tempfile.TemporaryDirectory() as folder:
            for case in cases(on, Path(folder), [one]):
                if options.phase and case.phase not in options.phase:
                    continue
                if options.kind and options.kind not in case.kind:
                    continue
                if options.shard and not in_shard(case.name, *options.shard):
                    continue
                if not options.case or case.name in options.case:
                    yield case


def _of_unit(shard: Sequence[FaultCase], bench: str, scenario: Scenario) -> Iterator[FaultCase]:
    return (case for case in shard if (case.bench, case.scenario) == (bench, scenario.name))


def _found(options: argparse.Namespace) -> Iterator[Record]:
    """What is known of the cases that were asked for, at this commit."""
    for record in records_of(options.out):
        asked = (
            (not options.bench or record["bench"] in options.bench)
            and (not options.phase or record["phase"] in options.phase)
            and (not options.kind or options.kind in record["kind"])
            and (not options.case or record["case"] in options.case)
        )
        if asked and record["commit"] == commit():
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


def _counted(chosen: Iterable[FaultCase]) -> int:
    """Print how many there are, and return it."""
    counts = Counter((case.bench, case.phase) for case in chosen)
    benches = list(dict.fromkeys(bench for bench, _ in counts))
    print(f"| cases | {' | '.join(benches)} |\n|---|{'---|' * len(benches)}")
    for phase in dict.fromkeys(phase for _, phase in counts):
        print(f"| {phase} | {' | '.join(str(counts[bench, phase]) for bench in benches)} |")
    print(f"{counts.total()} cases", flush=True)
    return counts.total()


if __name__ == "__main__":
    main()
