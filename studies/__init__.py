"""The project's own measurements: what the source's facts come out as, how right, how fast, how sound it is.

`python -m studies.ROOM.MODULE` from the repository's root; `make bench` runs most, `make study` writes the pages.
"""
