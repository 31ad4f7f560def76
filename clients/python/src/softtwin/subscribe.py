"""Reading topics: one sample after the other, woken by event."""

import asyncio
import time
from typing import Any, Iterator, Optional

import iceoryx2 as iox2

from .bus import Bus, default_bus, kind_of, payload_type, wait
from .errors import SofttwinError, TwinRestarted, TwinSilent
from .field import Field, copy_of
from .layout import LAYOUT_VERSION, FieldHeader
from .qos import QOS
from .start import Holder, check_process, hold

_SLICE_S = 0.2  # longest single wait, so that Ctrl-C interrupts
_WINDOW = 1024  # a number as far below the newest begins the count again
_MOST_LOST = 1 << 32  # a larger jump is another beginning of the count: nothing that can be counted was lost


class Subscription(Holder):
    """A reader of one topic; iterate over it (`for` or `async for`), or take samples with `next`, `newest`, `try_next`.

    Fields come as `Field` (views of shared memory), everything else as its structure, copied (at most 768 bytes).
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
        bus = bus or default_bus()
        qos = QOS[kind_of(topic)]
        #: The topic's name.
        self.topic = topic
        #: Missing samples (jumps in the sequence numbers); one that comes late is not missing.
        self.lost = 0
        #: Restarts of the sender seen.
        self.restarts = 0
        self._timeout_s = timeout_s
        self._on_restart = on_restart
        self._last: Optional[tuple] = None
        self._first = 0
        self._came = 0  # bit k: the number k below the newest came
        self._kind = None if kind_of(topic) == "field" else payload_type(topic)
        service = bus.open_topic(topic, create=wait_for_twin)
        # The listener is created first, so that a sample sent in between causes a spurious wake-up instead of none.
        events = bus.open_topic_events(topic)
        with bus.places.starting():
            self._listener = events.listener_builder().create()
        try:
            with bus.places.starting():
                self._subscriber = (
                    service.subscriber_builder().buffer_size(qos.buffer).history_request(qos.history).create()
                )
            hold(self)
        except Exception as error:
            raise SofttwinError(f"{topic}: all {qos.max_readers} reader slots are taken; stop a reader") from error

    def try_next(self) -> Optional[Any]:
        """The oldest waiting sample, or None. Never waits."""
        check_process(self)
        sample = self._receive()
        if sample is None:
            return None
        if self._kind is not None:
            value: Any = copy_of(self._kind, sample.payload_ptr)
            boot_seq = (value.boot_id, value.seq)
        else:
            header = copy_of(FieldHeader, sample.user_header_ptr)
            found = sample.header.number_of_elements
            if header.layout_version != LAYOUT_VERSION or header.node_count * header.field_count != found:
                raise SofttwinError(f"{self.topic}: {found} values do not fit their header {header!r}")
            value = Field(sample, header, sample.payload_ptr)
            boot_seq = (header.boot_id, header.seq)
        self._count(boot_seq, value)
        return value

    def _receive(self) -> Any:
        try:
            return self._subscriber.receive()
        except Exception as error:
            raise SofttwinError(
                f"{self.topic}: receiving failed: {error}; a reader may hold 4 samples at the same time, drop some views"
            ) from error

    def next(self, timeout_s: Optional[float] = None) -> Any:
        """The oldest waiting sample; waits for one by event, at most `timeout_s` (the subscription's when None).

        Raises `TwinSilent` when the time is over and `TwinRestarted` when the sender restarted.
        """
        waits = self._waits(timeout_s)
        while True:
            value = self.try_next()
            if value is not None:
                return value
            wait(self._listener, next(waits))

    def _waits(self, timeout_s: Optional[float]) -> Iterator[Any]:
        """Times to wait, never 0 (no timeout); raises `TwinSilent` when the time is over."""
        limit = self._timeout_s if timeout_s is None else timeout_s
        end = None if limit is None else time.monotonic() + limit
        while True:
            left = _SLICE_S if end is None else min(_SLICE_S, end - time.monotonic())
            if left <= 0:
                raise TwinSilent(
                    f"{self.topic}: nothing came within {limit} s; is the bridge running? `softtwin list --rate '{self.topic}'`"
                )
            yield iox2.Duration.from_secs_f64(max(left, 0.001))

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
            await asyncio.to_thread(wait, self._listener, next(waits))

    def _count(self, boot_seq: tuple, value: Any) -> None:
        last, seq = self._last, boot_seq[1]
        step = seq - last[1] if last is not None and last[0] == boot_seq[0] else None
        if step is not None and -_WINDOW < step <= 0:
            if seq >= self._first and not self._came >> -step & 1:
                self.lost -= 1
                self._came |= 1 << -step
            return
        self._last = boot_seq
        if step is not None and 0 < step <= _MOST_LOST:
            self.lost += step - 1
            self._came = (self._came << min(step, _WINDOW) | 1) & ((1 << _WINDOW) - 1)
            return
        self._first, self._came = seq, 1
        if last is None or step is not None:
            return
        self.restarts += 1
        if self._on_restart == "raise":
            raise TwinRestarted(
                f"{self.topic}: the sender restarted (run {boot_seq[0]:016x}); subscribe with on_restart='continue' to "
                "go on, the sample is in `.sample`",
                value,
            )


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
    """
    return Subscription(topic, timeout_s=timeout_s, wait_for_twin=wait_for_twin, on_restart=on_restart, bus=bus)


def newest(topic: str, timeout_s: float = 5.0, bus: Optional[Bus] = None) -> Any:
    """One sample of a topic: the last one that was sent, or the next."""
    return Subscription(topic, timeout_s=timeout_s, bus=bus).newest()
