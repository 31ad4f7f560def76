"""Start next to other programs: the start lock, incomplete files of killed programs, the lock of a topic's writer.

The same rules as of the programs `softtwin` and `softtwind`; docs/iceoryx2.md says why.
"""

import ctypes
import fcntl
import os
import re
import signal
import stat
import threading
import time
import weakref
from contextlib import contextmanager
from typing import Any, Iterator, Optional

from .errors import AlreadyPublished, SofttwinError


def own_root() -> str:
    """Folder of the user's own domains. `/tmp` is open to all: another user must not have made it before."""
    folder = f"/tmp/softtwin-{os.geteuid()}"
    try:
        os.mkdir(folder, 0o700)
    except FileExistsError:
        pass
    found = os.lstat(folder)
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
        raise SofttwinError(
            f"`{folder}` belongs to user {found.st_uid}: it must be a folder of the user who runs this program; remove it, or name "
            "another with SOFTTWIN_ROOT"
        )
    return folder


def check_member(root: str) -> int:
    """Owner of a shared-memory domain's folder. The domain of another user is private to that user unless a group shares it."""
    user = os.geteuid()
    try:
        found = os.stat(root)
    except FileNotFoundError:
        return user
    if found.st_uid != user and not found.st_mode & stat.S_ISGID:
        raise SofttwinError(
            f"the shared-memory domain of `{root}` is private to user {found.st_uid}, this program runs as user {user}: run it as that "
            "user, or share the folder with a group (OPERATIONS.md, Other users)"
        )
    return found.st_uid


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
_SHM = "/dev/shm"
_DRIVING = ("setpoint", "override", "target", "command")
_PATIENCE_S = 2.0
_GRANT_EVERY_S = 0.01
# Complete when their owner can no longer write them; everything else when its owner can read it.
_DESCRIPTIONS = (".service", "_tag", ".details", "_context")
_LONGEST = 107 - 1 - 39 - len(".event")  # a socket's path in the folder has at most 107 bytes
_F_SETSIG, _F_SETLEASE = 10, 1024


class Places:
    """Places of the files of a shared-memory domain."""

    def __init__(self, prefix: str, root: str) -> None:
        self.prefix = prefix
        self.root = root.rstrip("/")
        found = len(self.prefix.encode()) + len(self.root.encode())
        if found > _LONGEST:
            raise SofttwinError(
                f"the shared-memory domain's folder `{self.root}` and its prefix `{prefix}` have {found} bytes together, at most {_LONGEST} "
                "are allowed; choose a shorter SOFTTWIN_ROOT or SOFTTWIN_DOMAIN"
            )

    @contextmanager
    def starting(self) -> Iterator[None]:
        """Holds the start lock during a creation, so that no other program removes the new files. Removes incomplete files first."""
        path = f"{self.root}/softtwin.lock"
        os.makedirs(self.root, mode=0o755, exist_ok=True)
        lock = _open(path, os.O_WRONLY)
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

    def right_to_write(self, topic: str) -> Optional[str]:
        """Folder of a shared domain whose writers may publish `topic`; None in a private one."""
        if not os.stat(self.root).st_mode & stat.S_ISGID:
            return None
        is_driving = any(kind in _DRIVING for kind in topic.split("/")[2:3])
        return f"{self.root}/{'control' if is_driving else 'publish'}"

    def writer_lock(self, topic: str) -> str:
        """Path of the lock file of a topic's writer: in a shared domain it is in the folder of those who may publish the topic."""
        file = f"{_number(topic):016x}.writer"
        folder = self.right_to_write(topic)
        return f"{folder}/{file}" if folder else f"{_SHM}/{self.prefix}softtwin_{_number(self.root):016x}_{file}"

    def check_right(self, topic: str) -> None:
        """Checks the folder of those who may publish `topic`; its owner makes it where it is missing."""
        folder, owner = self.right_to_write(topic), os.stat(self.root).st_uid
        if folder is None:
            return
        if os.geteuid() in (0, owner) and not os.path.lexists(folder):
            os.mkdir(folder, 0o700)
            os.chown(folder, owner, -1)
        found = os.lstat(folder)
        if not stat.S_ISDIR(found.st_mode) or found.st_uid not in (0, owner):
            raise PermissionError(f"{folder} belongs to user {found.st_uid}, expected user {owner} or root: remove it")

    def restrict_counter(self) -> None:
        """Takes the counter of nodes, which iceoryx2 makes open to all users, back to the users of the shared-memory domain."""
        mode = 0o660 if os.stat(self.root).st_mode & stat.S_ISGID else 0o600
        for path in _files(_SHM, re.compile(re.escape(self.prefix) + r"[0-9a-f]{40}_.*\.global_mgmt")):
            if os.lstat(path).st_uid == os.geteuid():
                os.chmod(path, mode)

    def keep_sharing(self, user: "weakref.ref[Any]") -> None:
        """Grants this user's files to the group of a shared-memory domain that has one, every 10 ms until `user` is gone: others
        wait for a connection that they cannot open."""
        if not os.stat(self.root).st_mode & stat.S_ISGID:
            return
        self.grant()

        def run() -> None:
            while user() is not None:
                time.sleep(_GRANT_EVERY_S)
                self.grant()

        threading.Thread(target=run, name="softtwin-share", daemon=True).start()

    def grant(self) -> None:
        """Grants all files of this user to the group, once."""
        group = os.stat(self.root).st_gid
        paths = [entry.path for entry in os.scandir(_SHM) if entry.name.startswith(self.prefix)]
        paths += [entry.path for entry in os.scandir(self.root) if entry.name not in ("control", "publish")]
        for folder in (f"{self.root}/nodes", f"{self.root}/services"):
            for parent, folders, files in os.walk(folder):
                paths += [f"{parent}/{name}" for name in folders + files]
        for path in paths:
            try:
                _grant(path, group)
            except OSError:
                pass  # gone, or another user's

    def _segments(self) -> list:
        return _files(_SHM, re.compile(re.escape(self.prefix) + r"[0-9a-f]{40}_.*"))

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
        places.check_right(topic)
        self._path = places.writer_lock(topic)
        is_shared = not self._path.startswith(_SHM)
        while True:
            self._file = _open(self._path, os.O_RDWR | os.O_NOFOLLOW)
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                process, _, name = os.read(self._file, 256).decode("utf-8", "replace").strip().partition(" ")
                os.close(self._file)
                self._file = None
                holder = f"`{name}`, process {process}" if name else f"process {process}"
                raise AlreadyPublished(f"{topic}: another process publishes here already ({holder}); stop it first") from error
            is_own = os.fstat(self._file).st_uid == os.geteuid()
            if self._is_named() and (is_own or not is_shared):
                break
            if self._is_named():
                os.unlink(self._path)  # left by another user; readers take the samples of the lock's owner
            os.close(self._file)
        if is_shared:
            os.fchmod(self._file, 0o660)
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


def _grant(path: str, group: int) -> None:
    """Gives the group what the owner has, except the right to write samples. Incomplete files are skipped."""
    file = os.open(path, os.O_PATH | os.O_NOFOLLOW | os.O_CLOEXEC)  # what is checked is what is changed
    try:
        found = os.fstat(file)
        mode = stat.S_IMODE(found.st_mode)
        complete = not mode & 0o200 if path.endswith(_DESCRIPTIONS) else mode & 0o400
        if found.st_uid != os.geteuid() or stat.S_ISLNK(found.st_mode) or not complete:
            return
        own = mode & 0o400 if path.endswith(".data") else mode & 0o700
        wanted = mode | own >> 3 | (stat.S_ISGID if stat.S_ISDIR(found.st_mode) else 0)
        if (wanted, group) != (mode, found.st_gid):
            os.chown(f"/proc/self/fd/{file}", -1, group)
            os.chmod(f"/proc/self/fd/{file}", wanted)
    finally:
        os.close(file)


def _open(path: str, flags: int) -> int:
    """Opens or makes a file. The system may refuse to make one in a sticky folder where another user's is already."""
    try:
        return os.open(path, flags | os.O_CLOEXEC)
    except FileNotFoundError:
        return os.open(path, flags | os.O_CREAT | os.O_CLOEXEC, 0o600)


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
