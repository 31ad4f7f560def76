"""Reading topics: one sample after the other, woken by event."""

import asyncio
import time
from typing import Any, Iterator, Optional

from . import layout
from .bus import Bus, default_bus, kind_of
from .errors import TwinRestarted, TwinSilent
from .field import Field

_KINDS = {
    "sensor": layout.SensorSample,
    "state": layout.State,
    "estimate": layout.Estimate,
    "health": layout.Health,
    "grasp": layout.Grasp,
    "command": layout.Command,
    "setpoint": layout.Setpoint,
    "override": layout.Setpoint,
    "target": layout.Target,
    "valve": layout.Valve,
    "field": layout.FieldHeader,
}


class Subscription:
    """A reader of one topic; iterate over it (`for` or `async for`), or take samples with `next`, `newest`, `try_next`.

    Fields come as `Field` (views of shared memory), everything else as its structure, copied (at most 768 bytes).

    >>> states = Subscription("softtwin/finger/state", timeout_s=10.0)
    >>> first, second = states.next(), states.next()
    >>> second.seq > first.seq, states.restarts
    (True, 0)
    """

    def __init__(
        self,
        topic: str,
        *,
        timeout_s: Optional[float] = None,
        wait_for_twin: bool = False,
        on_restart: str = "raise",
        bus: Optional[Bus] = None,
    ) -> None:
        if on_restart not in ("raise", "continue"):
            raise ValueError(f"on_restart={on_restart!r}: expected 'raise' or 'continue'")
        #: The topic's name.
        self.topic = topic
        self._timeout_s = timeout_s
        self._on_restart = on_restart
        self._kind: Any = _KINDS[kind_of(topic)]
        self._reader = (bus or default_bus())._native.reader(topic, wait_for_twin)

    @property
    def lost(self) -> int:
        """Missing samples (jumps in the sequence numbers); one that comes late is not missing."""
        return int(self._reader.lost)

    @property
    def restarts(self) -> int:
        """Restarts of the sender seen."""
        return int(self._reader.restarts)

    def try_next(self) -> Optional[Any]:
        """The oldest waiting sample, or None. Never waits."""
        received = self._reader.try_next()
        if received is None:
            return None
        payload, sample, restarted = received
        value = self._kind.from_buffer_copy(payload)
        run = value.boot_id
        if sample is not None:
            value = Field(sample, value)
        if restarted and self._on_restart == "raise":
            raise TwinRestarted(
                f"{self.topic}: the sender restarted (run {run:016x}); subscribe with on_restart='continue' to "
                "go on, the sample is in `.sample`",
                value,
            )
        return value

    def next(self, timeout_s: Optional[float] = None) -> Any:
        """The oldest waiting sample; waits for one by event, at most `timeout_s` (the subscription's when None).

        Raises `TwinSilent` when the time is over and `TwinRestarted` when the sender restarted.
        """
        waits = self._waits(timeout_s)
        while True:
            value = self.try_next()
            if value is not None:
                return value
            self._reader.wait(next(waits))

    def _waits(self, timeout_s: Optional[float]) -> Iterator[float]:
        """Times left to wait, s; raises `TwinSilent` when there is none."""
        limit = self._timeout_s if timeout_s is None else timeout_s
        end = None if limit is None else time.monotonic() + limit
        while True:
            left = 1.0 if end is None else end - time.monotonic()
            if left <= 0:
                raise TwinSilent(
                    f"{self.topic}: nothing came within {limit} s; is the bridge running? `softtwin list --rate '{self.topic}'`"
                )
            yield left

    def newest(self, timeout_s: Optional[float] = None) -> Any:
        """The newest waiting sample (older ones are given back); waits as `next` when there is none."""
        value = self.next(timeout_s)
        while True:
            newer = self.try_next()
            if newer is None:
                return value
            value = newer

    def __iter__(self) -> Iterator[Any]:
        while True:
            yield self.next()

    def __aiter__(self) -> "Subscription":
        return self

    async def __anext__(self) -> Any:
        """As `next`, for `async for`: a thread of asyncio's waits for the event, so that other tasks continue."""
        waits = self._waits(None)
        while True:
            value = self.try_next()
            if value is not None:
                return value
            await asyncio.to_thread(self._reader.wait, next(waits))


def subscribe(
    topic: str,
    *,
    timeout_s: Optional[float] = None,
    wait_for_twin: bool = False,
    on_restart: str = "raise",
    bus: Optional[Bus] = None,
) -> Subscription:
    """Reads a topic: `for field in softtwin.subscribe("softtwin/finger/field"): ...`.

    Options: `timeout_s` (None: no timeout), `wait_for_twin` (True: the topic may come into being later),
    `on_restart` ("raise" or "continue"), `bus`. Raises `TwinAbsent` and `VersionMismatch`.

    >>> for field in subscribe("softtwin/finger/field", timeout_s=10.0):
    ...     print(field.names, field.von_mises.shape)
    ...     break
    ['x', 'y', 'z', 'displacement', 'von_mises'] (25022,)
    """
    return Subscription(topic, timeout_s=timeout_s, wait_for_twin=wait_for_twin, on_restart=on_restart, bus=bus)


def newest(topic: str, timeout_s: float = 5.0, bus: Optional[Bus] = None) -> Any:
    """One sample of a topic: the last one that was sent, or the next.

    >>> newest("softtwin/finger/state").regime_name in ("free", "contact")
    True
    """
    return Subscription(topic, timeout_s=timeout_s, bus=bus).newest()
