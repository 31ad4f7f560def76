"""Types of ROS 2 as `rosbags` has them, and keys by them."""

from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)


def make(kind, **values):
    return STORE.types[kind](**values)


def key(name, kind, domain=7):
    """The key of a topic of this type."""
    package, group, what = kind.split("/")
    return f"{domain}/{name}/{package}::{group}::dds_::{what}_/{STORE.hash_rihs01(kind)}"
