"""Measurements that a release repeats: oracles, accuracy against cost, faults, coverage, speed, the source's facts.

`python -m studies list` prints all of them (`registry.toml`), `run NAME` runs one, `check` compares the pages of
`docs/` with `results/`. `make bench` runs the short ones.
"""
