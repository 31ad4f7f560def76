"""Sending: sensor readings to a twin, setpoints to a valve, targets to its controller, pressure commands to a plant."""

import math
import os
from typing import Any, Mapping, Optional, Sequence

import iceoryx2 as iox2

from .bus import Bus, default_bus, now_ns, payload_type
from .errors import AlreadyPublished, SofttwinError
from .layout import Command, SensorSample, Setpoint, Target
from .payload import pack
from .qos import MAX_LOANS
from .start import Holder, WriterLock, check_process, hold


def _boot_id() -> int:
    """Number that differs between runs of programs on this machine; never zero."""
    mixed = (now_ns() << 20 | now_ns() >> 44) & 0xFFFF_FFFF_FFFF_FFFF
    return (mixed ^ os.getpid() << 1) | 1


class _Writer(Holder):
    """The one writer of a topic."""

    def __init__(self, topic: str, bus: Optional[Bus], owner: str = "") -> None:
        bus = bus or default_bus()
        #: The topic's name.
        self.topic = topic
        self._kind = payload_type(topic)
        self._right = WriterLock(bus.places, topic, owner)
        service = bus.open_topic(topic, create=True)
        try:
            with bus.places.starting():
                self._publisher = (
                    service.publisher_builder()
                    .max_loaned_samples(MAX_LOANS)
                    .backpressure_strategy(iox2.BackpressureStrategy.DiscardData)
                    .create()
                )
        except Exception as error:
            if "ExceedsMaxSupportedPublishers" in str(error):
                raise AlreadyPublished(f"{topic}: another process publishes here already; stop it first") from error
            raise SofttwinError(f"{topic}: cannot be written: {error}") from error
        events = bus.open_topic_events(topic)
        with bus.places.starting():
            self._notifier = events.notifier_builder().create()
        hold(self)
        self._boot_id = _boot_id()
        self._seq = 0

    def _send(self, payload: Any) -> None:
        check_process(self)
        self._publisher.send_copy(payload)
        self._notifier.notify()


class SensorPublisher(_Writer):
    """Feeds readings to the twin of an actuator, in place of a bridge."""

    def __init__(self, actuator: str, bus: Optional[Bus] = None) -> None:
        super().__init__(f"softtwin/{actuator}/sensor", bus)

    def send(
        self,
        pressure_mpa: float = math.nan,
        gap_mm: float = math.nan,
        measured_force_n: float = math.nan,
        *,
        inputs: Optional[Mapping[str, float]] = None,
        status: int = 0,
        t_sensor_ns: Optional[int] = None,
    ) -> int:
        """Sends one reading (stamped now by default) and returns its sequence number. `inputs`: measured model inputs
        other than pressure and gap by name, at most six.
        """
        self._seq += 1
        reading = SensorSample(
            boot_id=self._boot_id,
            seq=self._seq,
            t_sensor_ns=now_ns() if t_sensor_ns is None else t_sensor_ns,
            pressure_mpa=pressure_mpa,
            gap_mm=gap_mm,
            measured_force_n=measured_force_n,
            t_trace_s=math.nan,
            status=status,
        )
        for name, value in (inputs or {}).items():
            at, packed = reading.input_count, name.encode()[-31:]
            if at == len(reading.inputs):
                raise ValueError(f"inputs: expected at most {at}, found {len(inputs or {})}")
            reading.inputs[at], reading.input_count = value, at + 1
            reading.input_names[32 * at : 32 * at + len(packed)] = packed
        self._send(reading)
        return self._seq


class CommandPublisher(_Writer):
    """Commands a pressure source."""

    def __init__(self, actuator: str, bus: Optional[Bus] = None) -> None:
        super().__init__(f"softtwin/{actuator}/command", bus)

    def send(self, pressure_mpa: float, t_sensor_ns: int = 0) -> int:
        """Sends one command; `t_sensor_ns` is the stamp of the reading that it answers. Returns its sequence number."""
        self._seq += 1
        self._send(
            Command(
                boot_id=self._boot_id,
                seq=self._seq,
                t_sensor_ns=t_sensor_ns,
                t_publish_ns=now_ns(),
                pressure_mpa=pressure_mpa,
            )
        )
        return self._seq


class SetpointPublisher(_Writer):
    """The owner of an actuator's valve, which a bridge drives: that of `pressure_mpa`, or of `pressure_mpa.<cavity>`. A second owner gets
    `AlreadyPublished` with the first one's name.
    """

    def __init__(self, actuator: str, owner: str, bus: Optional[Bus] = None, cavity: Optional[str] = None) -> None:
        if not owner or not owner.isprintable():
            raise ValueError(f"expected a name of the owner, such as `my-controller`, found {owner!r}")
        self._owner = pack(owner)
        super().__init__(f"softtwin/{actuator}/setpoint" + (f"/{cavity}" if cavity else ""), bus, owner)

    def send(self, pressure_mpa: float, valid_for_s: float = 0.1, t_sensor_ns: int = 0) -> int:
        """Sends one setpoint and returns its sequence number. It is valid for `valid_for_s`; then the valve takes its safe value unless
        another setpoint follows. NaN: the valve takes its safe value at once. `t_sensor_ns`: the stamp of the reading that it answers.
        """
        if not 0.0 < valid_for_s < math.inf:
            raise ValueError(f"valid_for_s: expected more than 0 seconds, found {valid_for_s}")
        self._seq += 1
        self._send(
            Setpoint(
                boot_id=self._boot_id,
                seq=self._seq,
                t_sensor_ns=t_sensor_ns,
                t_publish_ns=now_ns(),
                valid_for_ns=int(valid_for_s * 1e9),
                pressure_mpa=pressure_mpa,
                owner=self._owner,
            )
        )
        return self._seq


class TargetPublisher(_Writer):
    """The owner of the target of a quantity that `softtwin hold` holds. A second owner gets `AlreadyPublished` with the first one's name."""

    def __init__(self, actuator: str, owner: str, bus: Optional[Bus] = None) -> None:
        if not owner or not owner.isprintable():
            raise ValueError(f"expected a name of the owner, such as `my-planner`, found {owner!r}")
        self._owner = pack(owner)
        super().__init__(f"softtwin/{actuator}/target", bus, owner)

    def step(self, value: float) -> int:
        """Sends a target that counts at once, in the unit of the held quantity. Returns its sequence number."""
        return self._target(0, [value], math.nan, math.nan)

    def ramp(self, value: float, rate: float) -> int:
        """Sends a target that is reached from the one before with `rate` units per second. Returns its sequence number."""
        if not 0.0 < rate < math.inf:
            raise ValueError(f"rate: expected more than 0 per second, found {rate}")
        return self._target(1, [value], rate, math.nan)

    def series(self, values: Sequence[float], interval_s: float) -> int:
        """Sends up to 64 targets at equal intervals, beginning now, with straight lines between them; the last one stays. Returns its
        sequence number.
        """
        if not 0.0 < interval_s < math.inf:
            raise ValueError(f"interval_s: expected more than 0 seconds, found {interval_s}")
        return self._target(2, values, math.nan, interval_s)

    def _target(self, kind: int, values: Sequence[float], rate: float, interval_s: float) -> int:
        if not 1 <= len(values) <= 64 or not all(math.isfinite(value) for value in values):
            raise ValueError(f"expected 1 to 64 finite values, found {list(values)}")
        self._seq += 1
        target = Target(
            boot_id=self._boot_id,
            seq=self._seq,
            t_publish_ns=now_ns(),
            target_kind=kind,
            value_count=len(values),
            rate_per_s=rate,
            interval_s=interval_s,
            owner=self._owner,
        )
        for at, value in enumerate(values):
            target.values[at] = value
        self._send(target)
        return self._seq
