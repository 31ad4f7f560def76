"""Questions to a twin: what if, which pressure, which gap."""

import math
from typing import Mapping, Optional, Union, overload

from . import layout
from .bus import Bus, default_bus
from .errors import Refused
from .field import Field

#: Values of a model's parameters by name.
Inputs = Optional[Mapping[str, float]]


class Client:
    """Asks the twin of one actuator. Answers come as `Answer`; with a field, as `Field` whose header is the answer.

    >>> twin = Client("finger", timeout_s=10.0)
    >>> found = twin.pressure(0.3, 30.0)
    >>> abs(twin.whatif(found.pressure_mpa, 30.0).contact_force_n - 0.3) < 1e-6
    True
    """

    def __init__(self, actuator: str, *, timeout_s: float = 1.0, bus: Optional[Bus] = None) -> None:
        #: Longest wait for an answer, s.
        self.timeout_s = timeout_s
        self._name = f"softtwin/{actuator}/query"
        self._client = (bus or default_bus())._native.client(actuator)

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
        numbers = [given.get(name, math.nan) for name in ("pressure_mpa", "gap_mm", "force_n", "force_halfwidth_n")]
        further = list((inputs or {}).items())
        payload, sample, refusal = self._client.ask(layout.QUERY_KINDS[kind], numbers, further, field, self.timeout_s)
        answer = layout.Answer.from_buffer_copy(payload)
        if refusal is not None:
            raise Refused(f"{self._name}: no answer: {refusal}", answer)
        return answer if field is None else Field(sample, answer)
