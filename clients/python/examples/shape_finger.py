"""Designs a finger by gradient descent: length and width of its chambers, for a wanted tip and a wanted force.

    python clients/python/examples/shape_finger.py --tip-mm -56.5 --force-n 0.39

The tip is that of the free finger at 0.04 MPa, y in mm; the force is that on a plate 30 mm below at 0.06 MPa. The model has both
sizes as inputs, so that jax differentiates through it; no finite differences are taken.
"""

import argparse
import json

import jax
import jax.numpy as jnp
import numpy as np
import softtwin

jax.config.update("jax_enable_x64", True)
DESIGN = ("chambers.length_mm", "chambers.width_mm")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tip-mm", type=float, default=-56.5)
    parser.add_argument("--force-n", type=float, default=0.39)
    parser.add_argument("--steps", type=int, default=300)
    args = parser.parse_args()
    whole = softtwin.Model(softtwin.shared_file("models/pneunet-design/pneunet-design.twin"))
    tip = int(np.argmax(whole.undeformed_mm[:, 0]))
    model = whole.select(["y"], [tip])
    finger, low, width = model.jax(), *(np.array([[i.min, i.max - i.min] for i in map(model.inputs.get, DESIGN)]).T)

    def answers(design):
        found = finger({"pressure_mpa": jnp.array([0.04, 0.06]), "gap_mm": jnp.array([jnp.inf, 30.0]), **dict(zip(DESIGN, design))})
        return jnp.stack([found["y"][0, 0], found["contact_force_n"][1]])

    wanted, units = jnp.array([args.tip_mm, args.force_n]), jnp.array([10.0, 0.1])

    def loss(share):
        return jnp.sum(((answers(low + width * share) - wanted) / units) ** 2)

    # Descent with momentum inside the range of the training; a step is at most a twentieth of it.
    slope = jax.jit(jax.grad(loss))
    share, speed = jnp.full(2, 0.5), jnp.zeros(2)
    for _ in range(args.steps):
        speed = 0.9 * speed - jnp.clip(0.1 * slope(share), -0.05, 0.05)
        share = jnp.clip(share + speed, 0.0, 1.0)
    design = {name: float(value) for name, value in zip(DESIGN, low + width * share)}
    free = model.predict(0.04, **{name.replace(".", "_"): value for name, value in design.items()})
    pressed = model.predict(0.06, 30.0, **{name.replace(".", "_"): value for name, value in design.items()}, fields=False)
    found = {"tip_mm": float(free.y[0]), "tip_halfwidth_mm": free.displacement_halfwidth_mm, "force_n": pressed.contact_force_n}
    start = answers(low + 0.5 * width)
    print(json.dumps({"design": design, **found, "force_halfwidth_n": pressed.force_halfwidth_n, "started_at": [round(float(v), 4) for v in start]}))


if __name__ == "__main__":
    main()
