"""Folders and files that no account but trusted ones can change."""

import errno
import os
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, NamedTuple


class Accounts(NamedTuple):
    """Trusted accounts, and groups whose members are all trusted; unused on Windows."""

    users: frozenset[int]
    groups: frozenset[int] = frozenset()


class ChangeableError(PermissionError):
    """Error of a path that another account can change; `strerror` is the reason."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(errno.EPERM, reason, str(path))


def own_folder(folder: Path) -> Path:
    """Create a folder if it is missing, and return its real path, which only this account and root can change.

    The check goes from the root down: nobody can exchange a folder after its check, since nobody can write to the one
    above it. So the real path stays safe as long as this process runs.

    Raises
    ------
    ChangeableError
        If another account can change the folder, a folder above it, or something in it.
    OSError
        If it cannot be created or read.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    real = Path(os.path.realpath(folder))
    us = this_account()
    refuse_if_changeable(real, us)
    for parent, folders, files in os.walk(real):
        for name in (*folders, *files):
            _refuse_foreign(Path(parent, name), us)
    return real


def open_trusted(path: Path, accounts: Accounts) -> BinaryIO:
    """Open a regular file to read, without following a link.

    The opened file is checked, not its name.

    Raises
    ------
    ChangeableError
        If it is no regular file, or if other accounts own it or can write to it.
    FileNotFoundError
        If there is none.
    """
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0)
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"):  # a pipe without a writer would block
        flags |= getattr(os, name, 0)
    try:
        descriptor = os.open(path, flags)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EMLINK):
            raise ChangeableError(path, "is a link") from None
        raise
    stream = os.fdopen(descriptor, "rb")
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise ChangeableError(path, "is no regular file")
        if (reason := _changeable(found, accounts, descriptor)) is not None:
            raise ChangeableError(path, reason)
    except BaseException:
        stream.close()
        raise
    return stream


def trusted_in(folder: Path) -> Accounts:
    """Return the accounts whose files in a folder count: ours, root, the folder's owner, and a group that may write.

    Where others could exchange files or the folder itself, only ours and root.
    """
    us = this_account()
    try:
        real = Path(os.path.realpath(folder))
        found = real.stat()
        groups = frozenset({found.st_gid}) if found.st_mode & stat.S_IWGRP else frozenset[int]()
        theirs = Accounts(us.users | {found.st_uid}, groups)
        refuse_if_changeable(real, theirs)
    except OSError:
        return us
    return theirs


def open_new(path: Path) -> BinaryIO:
    """Open a new file to write, in place of one that has this name; a link is not followed."""
    path.unlink(missing_ok=True)
    return open(path, "xb", opener=lambda name, flags: os.open(name, flags, 0o644))


if sys.platform == "win32":

    def this_account() -> Accounts:
        """Return no account: Windows has no numbers of accounts."""
        return Accounts(frozenset())

    def refuse_if_changeable(real: Path, accounts: Accounts) -> None:
        """Raise ChangeableError for a folder outside the user's profile; access lists are not read."""
        profile = Path(os.path.realpath(Path.home()))
        if not real.is_relative_to(profile):
            raise ChangeableError(real, f"is outside your profile folder {profile}")

    def _changeable(found: os.stat_result, accounts: Accounts, where: Path | int) -> str | None:
        return None

    def _refuse_foreign(path: Path, accounts: Accounts) -> None:
        if getattr(path.lstat(), "st_file_attributes", 0) & stat.FILE_ATTRIBUTE_REPARSE_POINT:
            raise ChangeableError(path, "is a link")

else:
    import grp
    import pwd

    def this_account() -> Accounts:
        """Return this process's account and root."""
        return Accounts(frozenset({0, os.geteuid()}))

    def refuse_if_changeable(real: Path, accounts: Accounts) -> None:
        """Raise ChangeableError if other accounts could change a folder's entries, or exchange it or one above it.

        Folders above the home folder are not checked: whoever can exchange the home folder can run code anyway.
        """
        for folder in reversed(_up_to_home(real)):
            found = folder.lstat()
            if not stat.S_ISDIR(found.st_mode):
                raise ChangeableError(folder, "is no folder")
            sticky = folder != real and found.st_mode & stat.S_ISVTX  # others cannot exchange what is not theirs
            reason = _foreign(found, accounts) if sticky else _changeable(found, accounts, folder)
            if reason is not None:
                raise ChangeableError(folder, reason)

    def _up_to_home(real: Path) -> list[Path]:
        folders = [real, *real.parents]
        try:
            home = Path(os.path.realpath(pwd.getpwuid(os.geteuid()).pw_dir))
        except KeyError:  # an account without an entry, as in containers
            return folders
        return folders[: folders.index(home) + 1] if home in folders else folders

    def _changeable(found: os.stat_result, accounts: Accounts, where: Path | int) -> str | None:
        """Return why others can change what was found, or None."""
        if (reason := _foreign(found, accounts)) is not None:
            return reason
        if found.st_mode & stat.S_IWOTH:
            return "is writable by every account"
        if found.st_mode & stat.S_IWGRP and found.st_gid not in accounts.groups and not _private(found, where):
            return f"is writable by the group {_group_name(found.st_gid)}"
        return None

    def _foreign(found: os.stat_result, accounts: Accounts) -> str | None:
        if found.st_uid in accounts.users or any(_is_member(found.st_uid, group) for group in accounts.groups):
            return None
        return f"belongs to the account {_user_name(found.st_uid)}"

    def _refuse_foreign(path: Path, accounts: Accounts) -> None:
        """Raise ChangeableError for a link, and for what others own or can write to.

        A group's permission to write is without effect in a folder of mode 700, in which this program creates files.
        """
        found = path.lstat()
        if stat.S_ISLNK(found.st_mode):
            raise ChangeableError(path, "is a link")
        if (reason := _foreign(found, accounts)) is not None:
            raise ChangeableError(path, reason)
        if found.st_mode & stat.S_IWOTH:
            raise ChangeableError(path, "is writable by every account")

    def _private(found: os.stat_result, where: Path | int) -> bool:
        """Return whether a group has the name of its only member, the owner, as many systems create it.

        An access list shows as permission of the group, and may name others.
        """
        attributes: Callable[[Path | int], list[str]] = getattr(os, "listxattr", lambda _: [])  # only Linux has it
        with suppress(OSError):  # not every file system has any
            if "system.posix_acl_access" in attributes(where):
                return False
        name = _user_name(found.st_uid)
        try:
            group = grp.getgrgid(found.st_gid)
        except KeyError:
            return False
        return group.gr_name == name and set(group.gr_mem) <= {name}

    def _is_member(user: int, group: int) -> bool:
        try:
            entry = pwd.getpwuid(user)
        except KeyError:
            return False
        return group in os.getgrouplist(entry.pw_name, entry.pw_gid)

    def _user_name(user: int) -> str:
        try:
            return pwd.getpwuid(user).pw_name
        except KeyError:
            return str(user)

    def _group_name(group: int) -> str:
        try:
            return grp.getgrgid(group).gr_name
        except KeyError:
            return str(group)
