"""Every column of a run's files as a page, read off the program."""

from rig.data.dictionary import as_markdown

_HEAD = """\
# Every column of a run's files

What `rig show --columns` prints. [Data of a run](data.md) says which file has which table.

"""


def columns_page() -> str:
    """Return the page: every table, column and attribute, with unit, type and meaning."""
    return f"{_HEAD}{as_markdown()}"
