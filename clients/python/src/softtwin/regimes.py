"""Names of regimes that are models' own: states carry numbers, and a running twin tells the names beside them (docs/wire.md)."""

import time
from dataclasses import dataclass
from typing import Any, Dict, Optional

import iceoryx2 as iox2

_FIRST = 3  # numbers below are free and contact
_RETRY_S = 1.0  # a model without names is looked up again so much later: its twin may come
_MODELS_MAX = 64  # models that are kept; with one more, all are looked up anew


@dataclass
class _Known:
    names: Dict[int, str]
    again_at_s: float


class Regimes:
    """Names of regimes by model. Each model is looked up once; its names stay known when the twin ends."""

    def __init__(self, config: Any) -> None:
        self._config = config
        self._models: Dict[bytes, _Known] = {}

    def name(self, model_hash: bytes, number: int) -> Optional[str]:
        """The name that the model of this hash has for a number; None for free and contact, and where no twin has told it."""
        if number < _FIRST:
            return None
        known = self._models.get(model_hash)
        if known is None or (not known.names and time.monotonic() >= known.again_at_s):
            if len(self._models) >= _MODELS_MAX:
                self._models.clear()
            known = _Known(self._told(model_hash), time.monotonic() + _RETRY_S)
            self._models[model_hash] = known
        return known.names.get(number)

    def put(self, payload: Any) -> None:
        """Gives a state, a field's header or an answer the name of its regime, where that is the model's own and known."""
        number = getattr(payload, "regime", 0)
        if number >= _FIRST:
            payload.own_regime = self.name(bytes(payload.model_hash), number)

    def _told(self, model_hash: bytes) -> Dict[int, str]:
        """Reads one management file. The key of an attribute is the number of its first name, its value up to four names."""
        service = iox2.ServiceName.new(f"softtwin.regimes.{model_hash.hex()}")
        try:
            found = iox2.Service.details(service, self._config, iox2.MessagingPattern.Event, iox2.ServiceType.Ipc)
        except Exception:  # what cannot be read is not known: samples have all they need but a text
            return {}
        names: Dict[int, str] = {}
        for attribute in found.attributes().values if found else []:
            first = attribute.key.to_string()
            if not first.isdigit():
                return {}  # of another version
            names.update(enumerate(attribute.value.to_string().split(","), int(first)))
        return names
