"""Quality of service, the same as in every other program (docs/wire.md): whoever comes first makes the topic with it."""

from dataclasses import dataclass
from typing import Dict


@dataclass(frozen=True)
class Qos:
    """Settings of one kind of topic."""

    max_readers: int
    buffer: int
    max_borrowed: int
    history: int
    max_nodes: int


QOS: Dict[str, Qos] = {
    "sensor": Qos(max_readers=16, buffer=2048, max_borrowed=4, history=0, max_nodes=64),
    "field": Qos(max_readers=24, buffer=16, max_borrowed=4, history=1, max_nodes=64),
    "state": Qos(max_readers=64, buffer=2048, max_borrowed=4, history=1, max_nodes=128),
    "health": Qos(max_readers=32, buffer=8, max_borrowed=4, history=1, max_nodes=128),
    "grasp": Qos(max_readers=32, buffer=64, max_borrowed=4, history=1, max_nodes=64),
    "command": Qos(max_readers=8, buffer=16, max_borrowed=4, history=0, max_nodes=32),
}
"""By kind of topic."""

MAX_CLIENTS = 32
"""Programs that may ask one twin at the same time."""
MAX_QUERY_NODES = 64
"""Programs around one twin's questions at the same time."""
MAX_LOANS = 2
"""Samples that a writer may have on loan."""
