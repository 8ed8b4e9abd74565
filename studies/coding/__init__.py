"""Chapter 6 of the source as one page: `make study-coding`."""
