"""A program's place in a shared-memory domain."""

import os
import time
from typing import Any, Optional

import iceoryx2 as iox2

from . import layout
from .errors import SofttwinError, TwinAbsent, VersionMismatch
from .qos import QOS
from .start import Holder, Places, check_folder, check_process, hold, own_root

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
}
_WITH_PART = ("field", "setpoint", "override", "valve")
_FLUX_S = 2.0  # time to wait for other programs that create or remove the same topic


def now_ns() -> int:
    """The wire's clock: ns of the machine's monotonic clock, the same in every process."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


def wait(listener: Any, limit: Any) -> None:
    """Waits for an event at most `limit`; a signal ends the wait early, and its handler runs before this returns."""
    try:
        listener.timed_wait(limit)
    except Exception as error:
        if "InterruptSignal" not in str(error):
            raise


class Bus(Holder):
    """Membership in a shared-memory domain. The functions of this package create one on demand; create another to name the domain.

    The default domain is `$SOFTTWIN_DOMAIN` (with its folder `$SOFTTWIN_ROOT`), or the user's own: the same rule as of the
    programs `softtwin` and `softtwind`.
    """

    def __init__(self, domain: Optional[str] = None, root: Optional[str] = None) -> None:
        domain = domain or os.environ.get("SOFTTWIN_DOMAIN") or None
        root = root or os.environ.get("SOFTTWIN_ROOT") or None
        iox2.set_log_level(iox2.LogLevel.Fatal)  # errors are exceptions
        root = root or own_root()
        check_folder(root)
        end = time.monotonic() + _FLUX_S
        refusal: Optional[SofttwinError]
        while True:
            self.places = Places(domain or "", root)
            try:
                self._node, refusal = self._join(root), None
            except SofttwinError as error:
                refusal = error
            # A stranger may take a name in /dev/shm after it was found free. The next one counts then.
            if time.monotonic() > end or not self.places.are_taken():
                break
        if refusal is not None:
            raise refusal
        hold(self)

    def _join(self, root: str) -> Any:
        self.places.remove_files_of_others()
        # The host's configuration file is not read, so that all programs of a shared-memory domain agree.
        config = iox2.config.default()
        config.global_cfg.prefix = iox2.FileName.new(self.places.prefix)
        config.global_cfg.root_path = iox2.Path.new(root)
        try:
            with self.places.starting():
                node = (
                    iox2.NodeBuilder.new()
                    .config(config)
                    .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
                    .create(iox2.ServiceType.Ipc)
                )
            self.places.restrict_counter()
            return node
        except SofttwinError:
            raise
        except Exception as error:
            raise SofttwinError(
                f"cannot join the shared-memory domain: {error}; check that its folder and /dev/shm are writable"
            ) from error

    def open_topic(self, topic: str, create: bool = False) -> Any:
        """The publish-subscribe service of a topic."""
        kind = kind_of(topic)
        builder = self._node.service_builder(iox2.ServiceName.new(topic))
        if kind == "field":
            builder = builder.publish_subscribe(iox2.Slice[layout.f32]).user_header(layout.FieldHeader)
        else:
            builder = builder.publish_subscribe(_KINDS[kind])
        if not create:
            return self._retry(topic, builder.open)
        qos = QOS[kind]
        builder = (
            builder.max_publishers(1)
            .max_subscribers(qos.max_readers)
            .max_nodes(qos.max_nodes)
            .subscriber_max_buffer_size(qos.buffer)
            .subscriber_max_borrowed_samples(qos.max_borrowed)
            .history_size(qos.history)
            .enable_safe_overflow(True)
        )
        return self._retry(topic, builder.open_or_create)

    def open_events(self, name: str, listeners: int, notifiers: int, nodes: int) -> Any:
        """The event service that wakes the readers of a topic."""
        builder = (
            self._node.service_builder(iox2.ServiceName.new(name))
            .event()
            .max_listeners(listeners)
            .max_notifiers(notifiers)
            .max_nodes(nodes)
            .event_id_max_value(1)
        )
        return self._retry(name, builder.open_or_create)

    def open_topic_events(self, topic: str) -> Any:
        """As `open_events`, with the settings of the topic's kind."""
        qos = QOS[kind_of(topic)]
        return self.open_events(topic, qos.max_readers, 1, qos.max_nodes)

    def open_questions(self, name: str) -> Any:
        """The request-response service of a twin."""
        builder = (
            self._node.service_builder(iox2.ServiceName.new(name))
            .request_response(layout.Query, iox2.Slice[layout.f32])
            .response_header(layout.Answer)
        )
        return self._retry(name, builder.open)

    def _retry(self, name: str, attempt: Any) -> Any:
        """Retries while other programs start or stop; raises exceptions with the remedy."""
        check_process(self)
        end = time.monotonic() + _FLUX_S
        while True:
            try:
                with self.places.starting():
                    return attempt()
            except SofttwinError:
                raise
            except Exception as error:  # the binding raises one type for each of its enums
                cause = str(error)
                if "DoesNotExist" in cause:
                    raise TwinAbsent(
                        f"{name}: not found; does the twin run in this shared-memory domain? `softtwin list` shows what is"
                    ) from error
                if "Incompatible" in cause or "DoesNotSupport" in cause or "VersionMismatch" in cause:
                    raise VersionMismatch(
                        f"{name}: made by a program of another version ({cause}); this client speaks layout version "
                        f"{layout.LAYOUT_VERSION} over iceoryx2 0.10. Use the client of the twin's release"
                    ) from error
                if time.monotonic() > end:
                    raise SofttwinError(f"{name}: cannot be opened: {cause}") from error
                time.sleep(0.002)


def kind_of(topic: str) -> str:
    """The kind of a topic: the third chunk of its name. Fields and valves may have a fourth: node set, cavity."""
    chunks = topic.split("/")
    kind = chunks[2] if len(chunks) > 2 else ""
    ours = chunks[0] == "softtwin" and kind in QOS and (len(chunks) == 3 or (len(chunks) == 4 and kind in _WITH_PART))
    if not ours or "*" in topic:
        raise ValueError(
            f"`{topic}`: expected softtwin/<actuator>/sensor, /state, /health, /command, /field or /field/<set>, or "
            "softtwin/<scene>/grasp, without wildcards"
        )
    return kind


def payload_type(topic: str) -> Any:
    """The ctypes structure of a topic of fixed size."""
    return _KINDS[kind_of(topic)]


_default: Optional[Bus] = None


def default_bus() -> Bus:
    """Default bus of the functions."""
    global _default
    if _default is None or _default._process != os.getpid():  # after a fork: the parent's
        _default = Bus()
    return _default
