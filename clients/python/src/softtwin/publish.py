"""Sending: sensor readings to a twin, setpoints to a valve, targets to its controller, pressure commands to a plant."""

import math
from typing import Mapping, Optional, Sequence

from .bus import Bus, default_bus


class SensorPublisher:
    """Feeds readings to the twin of an actuator, in place of a bridge.

    >>> sensor = SensorPublisher("example")
    >>> first = sensor.send(pressure_mpa=0.03, gap_mm=30.0)
    >>> sensor.send(pressure_mpa=0.031, gap_mm=30.0) - first
    1
    """

    def __init__(self, actuator: str, bus: Optional[Bus] = None) -> None:
        self._writer = (bus or default_bus())._native.writer(f"softtwin/{actuator}/sensor", "")

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
        values = [pressure_mpa, gap_mm, measured_force_n]
        return int(self._writer.send_reading(values, list((inputs or {}).items()), status, t_sensor_ns))


class CommandPublisher:
    """Commands a pressure source.

    >>> command = CommandPublisher("example")
    >>> command.send(0.03) < command.send(0.031)
    True
    """

    def __init__(self, actuator: str, bus: Optional[Bus] = None) -> None:
        self._writer = (bus or default_bus())._native.writer(f"softtwin/{actuator}/command", "")

    def send(self, pressure_mpa: float, t_sensor_ns: int = 0) -> int:
        """Sends one command; `t_sensor_ns` is the stamp of the reading that it answers. Returns its sequence number."""
        return int(self._writer.send_command(pressure_mpa, t_sensor_ns))


class SetpointPublisher:
    """The owner of an actuator's valve, which a bridge drives: that of `pressure_mpa`, or of `pressure_mpa.<cavity>`. A second owner gets
    `AlreadyPublished` with the first one's name.

    >>> valve = SetpointPublisher("example", owner="my-controller")
    >>> valve.send(0.02, valid_for_s=0.1) < valve.send(math.nan)
    True
    """

    def __init__(self, actuator: str, owner: str, bus: Optional[Bus] = None, cavity: Optional[str] = None) -> None:
        topic = f"softtwin/{actuator}/setpoint" + (f"/{cavity}" if cavity else "")
        self._writer = (bus or default_bus())._native.writer(topic, owner)

    def send(self, pressure_mpa: float, valid_for_s: float = 0.1, t_sensor_ns: int = 0) -> int:
        """Sends one setpoint and returns its sequence number. It is valid for `valid_for_s`; then the valve takes its safe value unless
        another setpoint follows. NaN: the valve takes its safe value at once. `t_sensor_ns`: the stamp of the reading that it answers.
        """
        return int(self._writer.send_setpoint(pressure_mpa, valid_for_s, t_sensor_ns))


class TargetPublisher:
    """The owner of the target of a quantity that `softtwin hold` holds. A second owner gets `AlreadyPublished` with the first one's name.

    >>> target = TargetPublisher("example", owner="my-planner")
    >>> target.step(0.3) < target.ramp(0.4, rate=0.05) < target.series([0.1, 0.2], interval_s=0.1)
    True
    """

    def __init__(self, actuator: str, owner: str, bus: Optional[Bus] = None) -> None:
        self._writer = (bus or default_bus())._native.writer(f"softtwin/{actuator}/target", owner)

    def step(self, value: float) -> int:
        """Sends a target that counts at once, in the unit of the held quantity. Returns its sequence number."""
        return int(self._writer.send_target([value], None, None))

    def ramp(self, value: float, rate: float) -> int:
        """Sends a target that is reached from the one before with `rate` units per second. Returns its sequence number."""
        return int(self._writer.send_target([value], rate, None))

    def series(self, values: Sequence[float], interval_s: float) -> int:
        """Sends up to 64 targets at equal intervals, beginning now, with straight lines between them; the last one stays. Returns its
        sequence number.
        """
        return int(self._writer.send_target(list(values), None, interval_s))
