"""Digital twins of soft pneumatic actuators, in this process or in shared memory.

    import softtwin

    model = softtwin.Model(softtwin.shared_file("models/pneunet/pneunet.twin"))
    print(model.predict(0.05, 30.0).contact_force_n, model.predict([0.03, 0.05], 30.0).von_mises.max(axis=-1))

    for field in softtwin.subscribe("softtwin/finger/field"):
        print(field.header.contact_force_n, field.x.max(), field.von_mises.max())

    twin = softtwin.Client("finger")
    print(twin.whatif(0.05, 30.0).contact_force_n, twin.pressure(0.3, 30.0).pressure_mpa)

Everything is woken by event; fields are read-only numpy views of shared memory that keep their sample alive.
"""

from .actuator import Actuator, SimulatedState
from .bus import Bus, now_ns
from .control import Control, Cycle
from .database import Database, train
from .errors import (
    AlreadyPublished,
    Refused,
    SofttwinError,
    TwinAbsent,
    TwinRestarted,
    TwinSilent,
    VersionMismatch,
)
from .field import Field
from .files import shared_file
from .layout import Answer, Command, Estimate, FieldHeader, Grasp, Health, Query, SensorSample, Setpoint, State, Target, Valve
from .material import Material, MaterialTest, fit_material
from .model import Input, Model, Session
from .prediction import Prediction
from .publish import CommandPublisher, SensorPublisher, SetpointPublisher, TargetPublisher
from .query import Client
from .recording import Comparison, Recording, compare, learn
from .subscribe import Subscription, newest, subscribe
from .twin import Twin

__version__ = "0.1.0"

__all__ = [
    "Actuator",
    "AlreadyPublished",
    "Answer",
    "Bus",
    "Client",
    "Command",
    "CommandPublisher",
    "Comparison",
    "Control",
    "Cycle",
    "Database",
    "Field",
    "FieldHeader",
    "Grasp",
    "Health",
    "Input",
    "Material",
    "MaterialTest",
    "Model",
    "Prediction",
    "Query",
    "Recording",
    "Refused",
    "Session",
    "SensorPublisher",
    "Estimate",
    "SensorSample",
    "Setpoint",
    "SetpointPublisher",
    "Target",
    "TargetPublisher",
    "SofttwinError",
    "SimulatedState",
    "State",
    "Subscription",
    "Twin",
    "TwinAbsent",
    "TwinRestarted",
    "TwinSilent",
    "Valve",
    "VersionMismatch",
    "compare",
    "fit_material",
    "learn",
    "newest",
    "shared_file",
    "now_ns",
    "subscribe",
    "train",
]
