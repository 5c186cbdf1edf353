"""MuJoCo on the bench's work; run by tools/performance, prints one JSON object.

One free body with the airframe's mass and inertia under four thrusters, at steps of 1 ms: steps a second with the loop in
C, and a 20 s flight whose controller is Python, 10 times a second. Usage: mujoco_flight.py AIRFRAME.toml
"""

import json
import sys
import time
import tomllib
from collections import deque

import mujoco

STEP_S = 0.001
STEPS = 100_000
FLIGHT_S = 20.0
FLIGHTS = 5

PERIOD_S = 0.1
DELAY_PERIODS = 3
GRAVITY_M_S2 = 9.80665
START_M, ALTITUDE_M = 0.1, 0.4
# Gains of rigs/virtual.toml.
POSITION_GAIN_PER_S, SPEED_GAIN_PER_S, INTEGRAL_GAIN_PER_S2, EXTRAPOLATION_S = 0.8, 1.6, 1.2, 0.4


def model(airframe, integrator):
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
          <option timestep="{STEP_S}" integrator="{integrator}" gravity="0 0 -{GRAVITY_M_S2}">
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


def fly(m):
    """The paper's figure 14 on positions of 0.3 s ago; returns altitudes, one a period."""
    d = mujoco.MjData(m)
    mass_kg = m.body_mass[1]
    integral_n = mass_kg * GRAVITY_M_S2
    seen = deque([START_M] * (DELAY_PERIODS + 5), maxlen=DELAY_PERIODS + 5)
    altitudes = []
    for _ in range(round(FLIGHT_S / PERIOD_S)):
        seen.append(d.qpos[2])
        # Velocity over two periods, acceleration between two such windows, as the bench's estimator has them.
        z, z2, z4 = seen[4], seen[2], seen[0]
        slope, before = (z - z2) / (2 * PERIOD_S), (z2 - z4) / (2 * PERIOD_S)
        speed = slope + (slope - before) / (2 * PERIOD_S) * EXTRAPOLATION_S
        altitude = z + slope * EXTRAPOLATION_S
        error = POSITION_GAIN_PER_S * (ALTITUDE_M - altitude) - speed
        integral_n += mass_kg * INTEGRAL_GAIN_PER_S2 * PERIOD_S * error
        d.ctrl[:] = max(0.0, mass_kg * SPEED_GAIN_PER_S * error + integral_n) / 4
        mujoco.mj_step(m, d, nstep=round(PERIOD_S / STEP_S))
        altitudes.append(d.qpos[2])
    return altitudes


def flight_s(m):
    """Median wall time of a flight, which must settle as the bench's does."""
    times = []
    for _ in range(FLIGHTS):
        began = time.perf_counter()
        altitudes = fly(m)
        times.append(time.perf_counter() - began)
        assert all(abs(z - ALTITUDE_M) < 0.02 for z in altitudes[-20:]), altitudes[-20:]
    return sorted(times)[FLIGHTS // 2]


def main():
    with open(sys.argv[1], "rb") as file:
        airframe = tomllib.load(file)
    result = {"version": mujoco.__version__}
    for integrator in ("Euler", "RK4"):
        m = model(airframe, integrator)
        result[integrator] = {"steps_per_s": steps_per_s(m), "flight_s": flight_s(m)}
    print(json.dumps(result))


main()
