"""Start next to other programs: the start lock, incomplete files of killed programs, the lock of a topic's writer.

The same rules as of the programs `softtwin` and `softtwind`; docs/iceoryx2.md says why.
"""

import ctypes
import fcntl
import itertools
import os
import re
import signal
import stat
import time
import weakref
from contextlib import contextmanager, suppress
from typing import Callable, Iterator, Optional, Set

from .errors import AlreadyPublished, SofttwinError


def own_root() -> str:
    """Folder of the user's own domains. `/tmp` is open to all: where another user has taken the name, a number follows it."""
    first = f"{_TMP}/softtwin-{os.geteuid()}"
    if _is_own(first, stat.S_ISDIR):
        return first
    for _ in range(1000):
        path = first + _ending(_claimed(_TMP, re.compile(re.escape(os.path.basename(first)) + _NUMBER), stat.S_ISDIR))
        try:
            os.mkdir(path, mode=0o700)
            return path
        except FileExistsError:  # own, or taken since the look
            if _is_own(path, stat.S_ISDIR):
                return path
    raise SofttwinError(f"{first}: other users take all names")


def check_folder(root: str) -> None:
    """Makes the folder of a shared-memory domain if it is missing; raises where it does not belong to this user alone."""
    user = os.geteuid()
    try:
        os.makedirs(root, mode=0o700, exist_ok=True)
        found = os.stat(root)
    except OSError:
        return  # the first file that cannot be made there gives the reason
    mode = stat.S_IMODE(found.st_mode)
    if found.st_uid != user:
        raise SofttwinError(
            f"the shared-memory domain of `{root}` belongs to user {found.st_uid}, this program runs as user {user}: run it as that user "
            f"(`sudo -u '#{found.st_uid}' SOFTTWIN_ROOT={root} ...`); other users see and drive a twin through `softtwin view` and the "
            "gateway (OPERATIONS.md, Other users)"
        )
    if mode & 0o022:
        raise SofttwinError(
            f"other users can write in the shared-memory domain's folder `{root}` (mode {mode:o}), and a domain belongs to one user: "
            f"`chmod 700 {root}`, or name another folder with SOFTTWIN_ROOT"
        )


class Holder:
    """An object whose attributes hold parts of the shared memory."""

    _process: int


_held: "weakref.WeakSet[Holder]" = weakref.WeakSet()


def hold(holder: Holder) -> None:
    """Notes the process that opened what `holder` holds."""
    holder._process = os.getpid()
    _held.add(holder)


def check_process(holder: Holder) -> None:
    """Raises where `holder` was opened before a fork: its memory, events and locks are the parent's."""
    if holder._process != os.getpid():
        raise SofttwinError(
            f"{getattr(holder, 'topic', 'this object')}: opened by process {holder._process}, before a fork; open it in this process"
        )


def _leave_to_parent() -> None:
    """In a forked process: what is held is never released, since releasing removes the parent's files."""
    for holder in list(_held):
        for value in vars(holder).values():
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(value))


os.register_at_fork(after_in_child=_leave_to_parent)
_SHM, _TMP = "/dev/shm", "/tmp"
_NUMBER = "(?:-([1-9][0-9]*))?"  # behind a name that another user took first
_PATIENCE_S = 2.0
_LONGEST = 107 - 1 - 39 - len(".event")  # a socket's path in the folder has at most 107 bytes
_F_SETSIG, _F_SETLEASE = 10, 1024


class Places:
    """Places of the files of a shared-memory domain."""

    def __init__(self, domain: str, root: str) -> None:
        self._stem = f"iox2_{domain + '_' if domain else ''}u{os.geteuid()}"
        self.prefix = prefix = self._claimed_prefix()
        self.root = root.rstrip("/")
        found = len(self.prefix.encode()) + len(self.root.encode())
        if found > _LONGEST:
            raise SofttwinError(
                f"the shared-memory domain's folder `{self.root}` and its prefix `{prefix}` have {found} bytes together, at most {_LONGEST} "
                "are allowed; choose a shorter SOFTTWIN_ROOT or SOFTTWIN_DOMAIN"
            )

    def _claimed_prefix(self) -> str:
        """With the number with which this user has the counter of nodes, or can make it; nobody can guess the other names."""
        counter = re.compile(re.escape(self._stem) + _NUMBER + r"_[0-9a-f]{40}_.*\.global_mgmt")
        return f"{self._stem}{_ending(_claimed(_SHM, counter))}_"

    def are_taken(self) -> bool:
        """Whether a stranger has taken a name in /dev/shm since it was found free."""
        return self._claimed_prefix() != self.prefix

    @contextmanager
    def starting(self) -> Iterator[None]:
        """Holds the start lock during a creation, so that no other program removes the new files. Removes incomplete files first."""
        path = f"{self.root}/softtwin.lock"
        os.makedirs(self.root, mode=0o700, exist_ok=True)
        lock = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            end = time.monotonic() + _PATIENCE_S
            while True:
                self.remove_incomplete()
                empty = self._empty_segment()
                try:
                    fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
                    if empty is None:
                        break
                    fcntl.flock(lock, fcntl.LOCK_UN)
                    reason = f"{empty} has no size: it is being made, or was truncated"
                except BlockingIOError:
                    reason = f"{path}: another program removes leftovers and does not finish"
                if time.monotonic() > end:
                    raise SofttwinError(f"cannot start within {_PATIENCE_S} s: {reason}")
                time.sleep(0.001)
            yield
        finally:
            os.close(lock)

    def remove_incomplete(self) -> None:
        """Removes incomplete files that no process has open."""
        for path in self._segments():
            _remove_if_unused(path, lambda found: found.st_size == 0 or not found.st_mode & 0o400)
        pattern = re.compile(re.escape(self.prefix) + r"[0-9a-f]{40}\.service")
        for path in _files(f"{self.root}/services", pattern):
            _remove_if_unused(path, lambda found: bool(found.st_mode & 0o200))

    def remove_files_of_others(self) -> None:
        """Removes what another user, usually root by hand, has made in the folder: this user cannot open it."""
        ours = re.compile(rf"(softtwin\.lock|nodes|services|{re.escape(self.prefix)}.*)")
        for folder, pattern in ((self.root, ours), (f"{self.root}/nodes", None), (f"{self.root}/services", None)):
            for path in _files(folder, pattern or re.compile(r"(?!aside-).*")):
                try:
                    if os.lstat(path).st_uid == os.geteuid():
                        continue
                    os.rmdir(path) if stat.S_ISDIR(os.lstat(path).st_mode) else os.unlink(path)
                except FileNotFoundError:
                    pass
                except OSError:  # a folder that is not empty; what cannot be moved is named by the program that cannot open it
                    with suppress(OSError):
                        os.rename(path, f"{folder}/aside-{os.path.basename(path)}-{time.monotonic_ns()}")

    def writer_lock(self, topic: str) -> str:
        """Path of the lock file of a topic's writer."""
        name = f"{self.prefix}softtwin_{_number(self.root):016x}_{_number(topic):016x}"
        number = _claimed(_SHM, re.compile(re.escape(name) + _NUMBER + r"\.writer"))
        return f"{_SHM}/{name}{_ending(number)}.writer"

    def restrict_counter(self) -> None:
        """Takes the counter of nodes, which iceoryx2 makes open to all users, back to this one."""
        counters = [path for path in self._segments() if path.endswith(".global_mgmt")]
        for path in counters:
            os.chmod(path, 0o600)
        if not counters:
            raise SofttwinError(f"cannot join the shared-memory domain: another user takes the names in {_SHM}")

    def _segments(self) -> list:
        """Shared memory of this user; files of others with such names have no meaning."""
        return [path for path in _files(_SHM, re.compile(re.escape(self.prefix) + r"[0-9a-f]{40}_.*")) if _is_own(path)]

    def _empty_segment(self) -> Optional[str]:
        for path in self._segments():
            try:
                if os.stat(path).st_size == 0:
                    return path
            except FileNotFoundError:
                pass
        return None


class WriterLock:
    """The right to write a topic; released by `close`, or by the operating system when the program ends."""

    def __init__(self, places: Places, topic: str, owner: str = "") -> None:
        self._file: Optional[int] = None
        end = time.monotonic() + _PATIENCE_S
        while True:
            self._path = places.writer_lock(topic)
            try:
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            except PermissionError:  # another user took the name at this moment
                if time.monotonic() > end:
                    raise
                continue
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                process, _, name = os.read(self._file, 256).decode("utf-8", "replace").strip().partition(" ")
                os.close(self._file)
                self._file = None
                holder = f"`{name}`, process {process}" if name else f"process {process}"
                raise AlreadyPublished(f"{topic}: another process publishes here already ({holder}); stop it first") from error
            if self._is_named() and os.fstat(self._file).st_uid == os.geteuid():
                break
            os.close(self._file)
            self._file = None
            if time.monotonic() > end:
                raise SofttwinError(f"{self._path}: another user takes this name")
        os.ftruncate(self._file, 0)
        os.write(self._file, f"{os.getpid()} {owner}\n".encode())

    def _is_named(self) -> bool:
        try:
            return self._file is not None and os.path.samestat(os.fstat(self._file), os.stat(self._path))
        except FileNotFoundError:
            return False

    def close(self) -> None:
        """Releases the right."""
        if self._file is not None:
            if self._is_named():
                os.unlink(self._path)
            os.close(self._file)
            self._file = None

    def __del__(self) -> None:
        self.close()


def _claimed(folder: str, pattern: "re.Pattern[str]", is_kind: Callable[[int], bool] = stat.S_ISREG) -> int:
    """Number of this user's file among those that match; the lowest that nobody has taken if there is none.

    A file of another kind counts as taken, because a stranger can give a file of this user a second name by a hard link.
    """
    own: Set[int] = set()
    taken: Set[int] = set()
    for path in _files(folder, pattern):
        found = pattern.fullmatch(os.path.basename(path))
        (own if _is_own(path, is_kind) else taken).add(int(found.group(1) or 0) if found else 0)
    return min(own, default=next(number for number in itertools.count() if number not in taken))


def _ending(number: int) -> str:
    return f"-{number}" if number else ""


def _is_own(path: str, is_kind: Callable[[int], bool] = stat.S_ISREG) -> bool:
    try:
        found = os.lstat(path)
        return found.st_uid == os.geteuid() and is_kind(found.st_mode)
    except FileNotFoundError:
        return False


def _files(folder: str, pattern: "re.Pattern[str]") -> list:
    try:
        return [f"{folder}/{name}" for name in os.listdir(folder) if pattern.fullmatch(name)]
    except FileNotFoundError:
        return []


def _remove_if_unused(path: str, is_incomplete) -> None:  # type: ignore[no-untyped-def]
    """The operating system grants a write lease only for a file that is open nowhere else."""
    try:
        found = os.lstat(path)
        if not is_incomplete(found):
            return
        mode = os.O_RDONLY if found.st_mode & 0o400 else os.O_WRONLY
        file = os.open(path, mode | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return  # gone, or another user's
    try:
        fcntl.fcntl(file, _F_SETSIG, signal.SIGURG)
        fcntl.fcntl(file, _F_SETLEASE, fcntl.F_WRLCK)
        if os.path.samestat(os.fstat(file), os.lstat(path)):
            os.unlink(path)
    except OSError:
        pass  # in use
    finally:
        os.close(file)


def _number(text: str) -> int:
    """FNV-1a, 64 bits."""
    value = 0xCBF29CE484222325
    for byte in text.encode():
        value = (value ^ byte) * 0x100000001B3 & 0xFFFF_FFFF_FFFF_FFFF
    return value
