"""Types of ROS 2 as `rosbags` has them, services added from their definitions (our own from the package that robots build), and keys by them."""

import pathlib

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
# Definitions of the .srv files: request, response.
SERVICES = {
    "example_interfaces/srv/AddTwoInts": ("int64 a\nint64 b", "int64 sum"),
    "std_srvs/srv/Trigger": ("", "bool success\nstring message"),
}
PACKAGE = pathlib.Path(__file__).resolve().parents[3] / "clients/ros2/softtwin_interfaces"
OWN = {f"softtwin_interfaces/srv/{path.stem}": path.read_text().split("\n---\n") for path in sorted(PACKAGE.glob("srv/*.srv"))}
# As the interface generator of ROS has it: `char` of a .msg is a byte without sign.
EVENT_INFO = "uint8 event_type\nbuiltin_interfaces/Time stamp\nuint8[16] client_gid\nint64 sequence_number"


def in_services(of):
    """`rosbags` takes every name for a message's."""
    if isinstance(of, str):
        return of.replace("/srv/msg/", "/srv/")
    return type(of)(map(in_services, of)) if isinstance(of, (tuple, list)) else of


def register(name, text):
    STORE.register({in_services(kind): in_services(fields) for kind, fields in get_types_from_msg(text, name).items()})


STORE.fielddefs.update(get_types_from_msg(EVENT_INFO, "service_msgs/msg/ServiceEventInfo"))
for path in PACKAGE.glob("msg/*.msg"):
    register(f"softtwin_interfaces/msg/{path.stem}", path.read_text())
for name, (request, response) in {**SERVICES, **OWN}.items():
    register(f"{name}_Request", request)
    register(f"{name}_Response", response)
    lists = f"{name}_Request[<=1] request\n{name}_Response[<=1] response"
    register(f"{name}_Event", f"service_msgs/ServiceEventInfo info\n{lists}")
    # REP 2016: a service is described as these three.
    parts = f"{name}_Request request_message\n{name}_Response response_message\n{name}_Event event_message"
    register(name, parts)


def make(kind, **values):
    return STORE.types[kind](**values)


def key(name, kind, domain=7):
    """The key of a topic or a service of this type."""
    package, group, what = kind.split("/")
    return f"{domain}/{name}/{package}::{group}::dds_::{what}_/{STORE.hash_rihs01(kind)}"
