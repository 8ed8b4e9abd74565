"""The project's own measurements: what the source's facts come out as, how right, how fast, how sound it is.

`python -m studies list` prints all of them (`registry.toml`), `run NAME` runs one, `check` compares the pages of
`docs/` with `results/`. `make bench` runs most, `make study` compares the model with Raju (1998).
"""
