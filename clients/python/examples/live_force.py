# %% [markdown]
# # Contact force, live
# Runs as a program, or cell by cell in any editor that knows `# %%` (VS Code, Spyder, Jupyter with jupytext).
#
#     python live_force.py                              a window that moves along
#     python live_force.py --seconds 5 --save force.png    without a window

# %%
import argparse
import collections

import matplotlib

import softtwin

parser = argparse.ArgumentParser()
parser.add_argument("--actuator", default="finger")
parser.add_argument("--seconds", type=float, default=10.0, help="length of the window, and of the run with --save")
parser.add_argument("--save", metavar="PNG", help="no window: draw once at the end")
args, _ = parser.parse_known_args()
if args.save:
    matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (after the choice of the backend)

# %% A window of the last seconds, filled by event
history: "collections.deque" = collections.deque()
states = softtwin.subscribe(f"softtwin/{args.actuator}/state", timeout_s=5.0, on_restart="continue")


def take_all():
    """All waiting states; at least one."""
    state = states.next()
    while state is not None:
        history.append((state.t_publish_ns * 1e-9, state.contact_force_n, state.force_halfwidth_n, state.pressure_mpa))
        state = states.try_next()
    while history[-1][0] - history[0][0] > args.seconds:
        history.popleft()


# %% The picture
figure, (force_axes, pressure_axes) = plt.subplots(2, 1, sharex=True)
(force_line,) = force_axes.plot([], [], color="tab:red")
(pressure_line,) = pressure_axes.plot([], [], color="tab:blue")
force_axes.set_ylabel("contact force, N")
pressure_axes.set_ylabel("pressure, MPa")
pressure_axes.set_xlabel("time, s")


def draw():
    """The window, with the force's half-width as a band."""
    now = history[-1][0]
    times = [time - now for time, *_ in history]
    force_line.set_data(times, [force for _, force, _, _ in history])
    pressure_line.set_data(times, [pressure for *_, pressure in history])
    for band in list(force_axes.collections):
        band.remove()
    low = [force - bar for _, force, bar, _ in history]
    high = [force + bar for _, force, bar, _ in history]
    force_axes.fill_between(times, low, high, color="tab:red", alpha=0.2)
    for axes in (force_axes, pressure_axes):
        axes.relim()
        axes.autoscale_view()


# %% Run
if args.save:
    take_all()
    begin = history[0][0]
    while history[-1][0] - begin < args.seconds * 0.95:
        take_all()
    draw()
    figure.savefig(args.save)
else:
    while plt.fignum_exists(figure.number):
        take_all()
        draw()
        plt.pause(0.03)
