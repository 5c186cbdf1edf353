"""Other simulators on the work of a sweep; run by tools/sweep, prints one JSON object.

Usage: sweep_peers.py mujoco|rotorpy|crazyflow RIG.toml. Times are the process's processor time and the wall clock, importing and compiling
left out. MuJoCo flies what tools/mujoco_flight.py has; RotorPy hovers by its own controller; crazyflow moves 1,024 worlds by RK4.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

FLIGHT_S = 20.0
WORLDS, STEPS = 1024, 500


def timed(work):
    """Processor and wall-clock seconds of some work."""
    processor, wall = time.process_time(), time.perf_counter()
    work()
    return {"processor_s": time.process_time() - processor, "wall_s": time.perf_counter() - wall}


def mujoco(path):
    from mujoco_flight import fly, load, model

    rig = load(path)
    airframe = load(path.parent / rig["airframe"])
    # RK4, as the bench steps; its Euler steps are a third of the work.
    models = {name: model(rig, airframe, name) for name in ("RK4", "Euler")}
    return {name: timed(lambda: fly(models[name], rig)) for name in models} | {"flight_s": FLIGHT_S}


def rotorpy(_path):
    import numpy as np
    from rotorpy.controllers.quadrotor_control import SE3Control
    from rotorpy.environments import Environment
    from rotorpy.trajectories.hover_traj import HoverTraj
    from rotorpy.vehicles.crazyflie_params import quad_params
    from rotorpy.vehicles.multirotor import Multirotor

    trajectory = HoverTraj(x0=np.array([0.0, 0.0, 0.4]))
    lab = Environment(Multirotor(quad_params), SE3Control(quad_params), trajectory, sim_rate=100)
    flown = {}
    taken = timed(lambda: flown.update(lab.run(t_final=FLIGHT_S)))
    assert abs(flown["state"]["x"][-1][2] - 0.4) < 0.02, flown["state"]["x"][-1]
    return taken | {"flight_s": FLIGHT_S}


def crazyflow(_path):
    import jax
    import numpy as np
    from crazyflow.sim import Sim
    from crazyflow.sim.integration import Integrator

    sim = Sim(n_worlds=WORLDS, integrator=Integrator.rk4, device="cpu")
    sim.reset()
    command = np.zeros((WORLDS, 1, 4))
    command[..., :2], command[..., 3] = 0.05, 0.4

    def step():
        sim.attitude_control(command)
        sim.step(STEPS)
        jax.block_until_ready(sim.data.states.pos)

    step()
    taken = timed(step)
    assert np.isfinite(np.asarray(sim.data.states.pos)).all()
    return taken | {"steps": WORLDS * STEPS}


if __name__ == "__main__":
    name = sys.argv[1]
    print(json.dumps({"version": version(name)} | globals()[name](Path(sys.argv[2]))))
