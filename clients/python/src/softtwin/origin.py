"""Check of who published a sample, in a shared-memory domain of a group: the same rule as of the programs (docs/iceoryx2.md)."""

import os
import warnings
from typing import NamedTuple, Optional

from .start import Places


class _Memory(NamedTuple):
    """Mapped memory of a publisher's samples."""

    begin: int
    end: int
    file: int
    identity: tuple
    allowed: bool


class Origins:
    """Publishers whose samples a reader takes: those of root, of the folder's owner, and of the user who holds the topic's lock."""

    def __init__(self, places: Places, topic: str) -> None:
        self._topic = topic
        self._root = places.root
        self._folder = places.right_to_write(topic)
        self._lock = places.writer_lock(topic)
        self._known: Optional[_Memory] = None
        self._reported: Optional[int] = None

    def allow(self, address: int) -> bool:
        """Whether the sample at `address` is taken."""
        if self._folder is None:
            return True
        known = self._known
        if known is None or not known.begin <= address < known.end or _identity(known.file) != known.identity:
            self._known = known = self._find(address)
        return known is not None and known.allowed

    def may_publish(self, user: int) -> bool:
        """Whether the samples of `user` are taken. The owner of a file is who made it: only root can give a file away."""
        domain, right, lock = (_owner(path) for path in (self._root, self._folder or "", self._lock))
        return user == 0 or user == domain or (right in (0, domain) and user == lock)

    def _find(self, address: int) -> Optional[_Memory]:
        with open("/proc/self/maps") as maps:
            for line in maps:
                begin, end = (int(number, 16) for number in line.split(" ", 1)[0].split("-"))
                if begin <= address < end:
                    return self._of_file(begin, end, int(line.split()[4]))
        return None

    def _of_file(self, begin: int, end: int, inode: int) -> Optional[_Memory]:
        for name in os.listdir("/proc/self/fd"):
            identity = _identity(int(name))
            if identity is not None and identity[1] == inode and os.readlink(f"/proc/self/fd/{name}").startswith("/dev/shm/"):
                user = os.fstat(int(name)).st_uid
                allowed = self.may_publish(user)
                if not allowed and user != self._reported:
                    self._reported = user
                    warnings.warn(
                        f"{self._topic}: samples of user {user} are ignored: only users who may write in {self._folder} publish this"
                    )
                return _Memory(begin, end, int(name), identity, allowed)
        return None


def _identity(file: int) -> Optional[tuple]:
    """Device and number of an open file; None when it is closed."""
    try:
        found = os.fstat(file)
    except OSError:
        return None
    return (found.st_dev, found.st_ino)


def _owner(path: str) -> Optional[int]:
    try:
        return os.lstat(path).st_uid
    except OSError:
        return None
