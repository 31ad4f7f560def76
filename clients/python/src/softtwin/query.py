"""Questions to a twin: what if, which pressure, which gap."""

import math
import time
from typing import Any, Mapping, Optional, Union, overload

import iceoryx2 as iox2

from . import layout
from .bus import Bus, default_bus, wait
from .errors import Refused, SofttwinError, TwinAbsent, TwinSilent
from .field import Field, copy_of
from .qos import MAX_CLIENTS, MAX_QUERY_NODES
from .start import Holder, check_process, hold

#: Values of a model's parameters by name.
Inputs = Optional[Mapping[str, float]]


class Client(Holder):
    """Asks the twin of one actuator. Answers come as `Answer`; with a field, as `Field` whose header is the answer."""

    def __init__(self, actuator: str, *, timeout_s: float = 1.0, bus: Optional[Bus] = None) -> None:
        bus = bus or default_bus()
        #: Longest wait for an answer, s.
        self.timeout_s = timeout_s
        self._name = f"softtwin/{actuator}/query"
        answers = f"softtwin/{actuator}/answer"
        service = bus.open_questions(self._name)
        asked = bus.open_events(self._name, 1, MAX_CLIENTS, MAX_QUERY_NODES)
        answered = bus.open_events(answers, MAX_CLIENTS, 1, MAX_QUERY_NODES)
        with bus.places.starting():
            self._notifier = asked.notifier_builder().create()
            self._listener = answered.listener_builder().create()
            self._client = (
                service.client_builder().backpressure_strategy(iox2.BackpressureStrategy.DiscardData).create()
            )
        hold(self)

    @overload
    def whatif(self, pressure_mpa: float = ..., gap_mm: float = ..., *, field: None = None, inputs: Inputs = ...) -> layout.Answer: ...

    @overload
    def whatif(self, pressure_mpa: float = ..., gap_mm: float = ..., *, field: str, inputs: Inputs = ...) -> Field: ...

    def whatif(
        self, pressure_mpa: float = math.nan, gap_mm: float = math.nan, *, field: Optional[str] = None, inputs: Inputs = None
    ) -> Union[layout.Answer, Field]:
        """State and force at a pressure (MPa) and a gap (mm; NaN: the scene's); with `field`, the node set's field too.

        `inputs`: values of the model's parameters by name, such as {"elastomer.law.mu_mpa": 0.7}; the others are the scene's.
        Of a model that does not depend on the pressure they are enough: `whatif(inputs={"load_n": 2.6})`.
        """
        return self._ask("whatif", field, inputs, pressure_mpa=pressure_mpa, gap_mm=gap_mm)

    @overload
    def pressure(self, force_n: float, gap_mm: float = ..., *, field: None = None, inputs: Inputs = ...) -> layout.Answer: ...

    @overload
    def pressure(self, force_n: float, gap_mm: float = ..., *, field: str, inputs: Inputs = ...) -> Field: ...

    def pressure(
        self, force_n: float, gap_mm: float = math.nan, *, field: Optional[str] = None, inputs: Inputs = None
    ) -> Union[layout.Answer, Field]:
        """The lowest pressure with this contact force (N) at this gap (mm): `pressure_mpa` +- `uncertainty`."""
        return self._ask("pressure", field, inputs, force_n=force_n, gap_mm=gap_mm)

    @overload
    def gap(
        self, pressure_mpa: float, force_n: float, force_halfwidth_n: float = ..., *, field: None = None, inputs: Inputs = ...
    ) -> layout.Answer: ...

    @overload
    def gap(
        self, pressure_mpa: float, force_n: float, force_halfwidth_n: float = ..., *, field: str, inputs: Inputs = ...
    ) -> Field: ...

    def gap(
        self, pressure_mpa: float, force_n: float, force_halfwidth_n: float = 0.0, *, field: Optional[str] = None, inputs: Inputs = None
    ) -> Union[layout.Answer, Field]:
        """The gap that explains a force (N, known to `force_halfwidth_n`) at a pressure (MPa): `gap_mm` +- `uncertainty`."""
        return self._ask("gap", field, inputs, pressure_mpa=pressure_mpa, force_n=force_n, force_halfwidth_n=force_halfwidth_n)

    def _ask(self, kind: str, field: Optional[str], inputs: Inputs, **given: float) -> Union[layout.Answer, Field]:
        query = layout.Query(layout_version=layout.LAYOUT_VERSION, kind=layout.QUERY_KINDS[kind])
        for name in ("pressure_mpa", "gap_mm", "force_n", "force_halfwidth_n"):
            setattr(query, name, given.get(name, math.nan))
        if field is not None:
            query.want_field, query.node_set = 1, layout.pack(field)
        for name, value in (inputs or {}).items():
            at, packed = query.parameter_count, name.encode()[-31:]
            if at == len(query.parameters):
                raise SofttwinError(f"{self._name}: expected at most {at} parameters in a question")
            query.parameters[at], query.parameter_count = value, at + 1
            query.parameter_names[32 * at : 32 * at + len(packed)] = packed
        response = self._exchange(query)
        answer = copy_of(layout.Answer, response.user_header_ptr)
        if answer.status != 0:
            reason = layout.QUERY_STATUSES.get(answer.status, f"a reason of another version ({answer.status})")
            raise Refused(f"{self._name}: no answer: {reason.format(limit=answer.limit, inputs=', '.join(answer.text_list('input_names')))}", answer)
        return answer if field is None else Field(response, answer, response.payload_ptr)

    def _exchange(self, query: layout.Query) -> Any:
        check_process(self)
        end = time.monotonic() + self.timeout_s
        try:
            pending = self._client.send_copy(query)
        except Exception as error:
            raise SofttwinError(f"{self._name}: the question cannot be sent: {error}") from error
        if pending.number_of_server_connections == 0:
            raise TwinAbsent(f"{self._name}: no twin answers questions there any more")
        self._notifier.notify()
        while True:
            response = pending.receive()
            if response is not None:
                return response
            left = end - time.monotonic()
            if left <= 0:
                raise TwinSilent(f"{self._name}: no answer within {self.timeout_s} s")
            # Every answer to any client wakes all clients: check for our own.
            wait(self._listener, iox2.Duration.from_secs_f64(min(left, 0.2)))
