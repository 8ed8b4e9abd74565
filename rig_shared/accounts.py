"""Whether another account could have written what is about to be run."""

import os
import stat
from pathlib import Path


def only_ours(path: Path) -> bool:
    """Return whether a file or folder is this account's, no link, and not writable by everyone. Raises OSError.

    A group may write where the user lets it: many systems give each account a group of its own. Windows gives each
    account a profile of its own, and access lists are not read.
    """
    found = path.lstat()
    if os.name != "posix":
        return True
    ours = found.st_uid == os.geteuid() and not found.st_mode & stat.S_IWOTH
    return ours and not stat.S_ISLNK(found.st_mode)
