"""MuJoCo on the bench's work; run by tools/performance, prints one JSON object.

One free body with the airframe's mass and inertia under four thrusters, at steps of 1 ms: steps a second with the loop in
C, and a 20 s flight whose controller is Python, 10 times a second. Numbers are the rig's. Usage: mujoco_flight.py RIG.toml
"""

import json
import sys
import time
import tomllib
from collections import deque
from pathlib import Path

import mujoco

STEPS = 100_000
FLIGHT_S = 20.0
FLIGHTS = 5
GRAVITY_M_S2 = 9.80665
START_M, ALTITUDE_M = 0.1, 0.4


def load(path):
    with path.open("rb") as file:
        return tomllib.load(file)


def model(rig, airframe, integrator):
    """Rotors at the corners of a square, neighbours turning opposite ways. No geometry, and all that a free body does not
    need is switched off, which makes MuJoCo faster."""
    mass, arm = airframe["mass_kg"]["value"], airframe["stabiliser"]["arm_m"] * 0.5**0.5
    inertia = " ".join(map(str, airframe["stabiliser"]["inertia_kg_m2"]))
    corners = [(arm, arm, 1), (-arm, arm, -1), (-arm, -arm, 1), (arm, -arm, -1)]
    sites = "".join(f'<site name="rotor{i}" pos="{x} {y} 0"/>' for i, (x, y, _) in enumerate(corners))
    motors = "".join(
        f'<motor site="rotor{i}" gear="0 0 1 0 0 {0.005 * turn}" ctrllimited="true" ctrlrange="0 {mass * 9.8}"/>'
        for i, (_, _, turn) in enumerate(corners)
    )
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option timestep="{rig['plant']['step_s']}" integrator="{integrator}" gravity="0 0 -{GRAVITY_M_S2}">
            <flag constraint="disable" contact="disable" sensor="disable" spring="disable" damper="disable"
                  warmstart="disable" autoreset="disable"/>
          </option>
          <worldbody>
            <body pos="0 0 {START_M}">
              <freejoint/><inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia}"/>{sites}
            </body>
          </worldbody>
          <actuator>{motors}</actuator>
        </mujoco>""")


def steps_per_s(m):
    """A little above hover, with a slow turn, so that nothing is zero."""
    d = mujoco.MjData(m)
    weight_n = m.body_mass[1] * GRAVITY_M_S2
    d.ctrl[:] = weight_n / 4 * 1.02
    d.qvel[3:] = 0.1, 0.2, 0.3
    began = time.perf_counter()
    mujoco.mj_step(m, d, nstep=STEPS)
    took = time.perf_counter() - began
    assert d.time > 0 and all(map(lambda q: q == q, d.qpos))
    return STEPS / took


def fly(m, rig):
    """The paper's figure 14 on positions as old as the rig's latency; returns altitudes, one a period."""
    d, law, period_s = mujoco.MjData(m), rig["control"], rig["loop"]["period_s"]
    delay, window = (round(s / period_s) for s in (rig["tracker"]["latency_s"]["value"], law["velocity_window_s"]))
    window_s, ahead_s = window * period_s, law["extrapolation_s"]
    mass_kg = m.body_mass[1]
    integral_n = mass_kg * GRAVITY_M_S2
    seen = deque([START_M] * (delay + 2 * window + 1), maxlen=delay + 2 * window + 1)
    altitudes = []
    for _ in range(round(FLIGHT_S / period_s)):
        seen.append(d.qpos[2])
        # Velocity over a window, acceleration between two neighbouring ones, as the bench's estimator has them.
        z, z1, z2 = seen[2 * window], seen[window], seen[0]
        slope, before = (z - z1) / window_s, (z1 - z2) / window_s
        speed = slope + (slope - before) / window_s * ahead_s
        altitude = z + slope * ahead_s
        error = law["position_gain_per_s"] * (ALTITUDE_M - altitude) - speed
        integral_n += mass_kg * law["integral_gain_per_s2"] * period_s * error
        d.ctrl[:] = max(0.0, mass_kg * law["speed_gain_per_s"] * error + integral_n) / 4
        mujoco.mj_step(m, d, nstep=round(period_s / m.opt.timestep))
        altitudes.append(d.qpos[2])
    return altitudes


def flight_s(m, rig):
    """Median wall time of a flight, which must settle as the bench's does."""
    times = []
    for _ in range(FLIGHTS):
        began = time.perf_counter()
        altitudes = fly(m, rig)
        times.append(time.perf_counter() - began)
        assert all(abs(z - ALTITUDE_M) < 0.02 for z in altitudes[-20:]), altitudes[-20:]
    return sorted(times)[FLIGHTS // 2]


def main():
    path = Path(sys.argv[1])
    rig = load(path)
    airframe = load(path.parent / rig["airframe"])
    result = {"version": mujoco.__version__}
    for integrator in ("Euler", "RK4"):
        m = model(rig, airframe, integrator)
        result[integrator] = {"steps_per_s": steps_per_s(m), "flight_s": flight_s(m, rig)}
    print(json.dumps(result))


if __name__ == "__main__":
    main()
