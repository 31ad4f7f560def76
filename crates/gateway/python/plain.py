"""States, a field and an answer from a twin on the network, with nothing but eclipse-zenoh and numpy."""

import json
import sys

import numpy as np
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"]))
with zenoh.open(config) as session:
    print("twins:", [str(reply.ok.key_expr) for reply in session.liveliness().get("**/softtwin/*/alive")])

    # A field: little-endian float32, fields x nodes; the attachment describes them.
    for reply in session.get("softtwin/finger/field"):
        about = json.loads(bytes(reply.ok.attachment))
        field = np.frombuffer(bytes(reply.ok.payload), "<f4").reshape(len(about["fields"]), about["node_count"])
        x, y, z, displacement, von_mises = field  # mm, mm, mm, mm, MPa
        print(f"{about['node_count']} nodes at {about['pressure_mpa']:.4f} MPa, largest stress {von_mises.max():.4f} MPa")

    # What if, which pressure, which gap: as `softtwin get`.
    for reply in session.get("softtwin/finger/pressure?force_n=0.3;gap_mm=30"):
        answer = json.loads(bytes(reply.ok.payload))
        print(f"0.3 N at 30 mm: {answer['pressure_mpa']:.5f} +- {answer['uncertainty']:.5f} MPa")

    # Every state, as JSON.
    states = session.declare_subscriber("softtwin/finger/state")
    for sample, _ in zip(states, range(5)):
        state = json.loads(bytes(sample.payload))
        print(f"#{state['seq']}  {state['pressure_mpa']:.4f} MPa  {state['regime']}  {state['contact_force_n']:.4f} N")
