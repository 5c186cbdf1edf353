"""MuJoCo (mujoco.org): a free body with four thrusters, its fluid forces for drag, its contact for the floor, its filters for motors.

Linear drag of the rig is MuJoCo's viscous drag on the body's inertia box, scaled to give it; density is zero unless a law sets it."""

import mujoco
import numpy as np

from rig import GRAVITY_M_S2
from world import World

NAME = "mujoco"
STEP_S = 0.002
# Time constant of thrust in nominal flight, s; the rig's latency is of the whole chain and holds it.
MOTOR_S = 0.004
HALF_HEIGHT_M = 0.01
# Torque of a rotor about its axis over its thrust, m.
SPIN_M = 0.006


def model(mass_kg, inertia, arm_m, settings):
    """The airframe as MuJoCo's XML. Rotors sit at the corners of a square, neighbours turning opposite ways."""
    side_m = arm_m * 0.5**0.5
    corners = [(side_m, side_m, 1), (-side_m, side_m, -1), (-side_m, -side_m, 1), (side_m, -side_m, -1)]
    sites = "".join(f'<site name="rotor{i}" pos="{x} {y} 0"/>' for i, (x, y, _) in enumerate(corners))
    motors = "".join(f'<general site="rotor{i}" gear="0 0 1 0 0 {SPIN_M * turn}" dyntype="filterexact" dynprm="{settings["motor_s"]}"/>'
                     for i, (_, _, turn) in enumerate(corners))
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option timestep="{STEP_S}" integrator="implicitfast" gravity="0 0 -{GRAVITY_M_S2}"/>
          <worldbody>
            <geom type="plane" size="5 5 1" solref="0.006 1"/>
            <body pos="0 0 {HALF_HEIGHT_M}">
              <freejoint/><inertial pos="0 0 0" mass="{mass_kg}" diaginertia="{' '.join(map(str, inertia))}"/>
              <geom type="box" size="{side_m} {side_m} {HALF_HEIGHT_M}" solref="0.006 1"/>{sites}
            </body>
            {settings["bodies"]}
          </worldbody>
          <actuator>{motors}</actuator>
          {settings["more"]}
        </mujoco>""")


class MuJoCoWorld(World):
    def __init__(self, rig, airframe, laws, air):
        super().__init__(rig, airframe, laws, air)
        mass_kg, drag = airframe.numbers[:2]
        # What laws may set: mass, motors' time constant, density over that which gives 1 N at 1 m/s, share of the thrust each rotor gives, further bodies.
        settings = {"mass_kg": mass_kg, "motor_s": MOTOR_S, "square_n": 0.0, "rotors": np.ones(4), "bodies": "", "more": ""}
        for law in laws:
            law.configure_mujoco(settings)
        stabiliser = rig.stabiliser
        self.inertia = np.array(stabiliser["inertia_kg_m2"])
        self.natural, self.damping = stabiliser["natural_frequency_rad_s"], stabiliser["damping_ratio"]
        self.arm_m = stabiliser["arm_m"]
        self.rotors = settings["rotors"]
        self.model = model(settings["mass_kg"], self.inertia, self.arm_m, settings)
        self.model.opt.viscosity = drag / self.fluid_n(viscosity=1.0)
        if settings["square_n"]:
            viscosity = self.model.opt.viscosity
            self.model.opt.density = settings["square_n"] / self.fluid_n(density=1.0)
            self.model.opt.viscosity = viscosity
        self.data = mujoco.MjData(self.model)
        self.settle()

    def fluid_n(self, viscosity=0.0, density=0.0):
        """Drag at a climb of 1 m/s in such a fluid, N."""
        self.model.opt.viscosity, self.model.opt.density = viscosity, density
        data = mujoco.MjData(self.model)
        data.qpos[2], data.qvel[2] = 1.0, 1.0
        mujoco.mj_forward(self.model, data)
        self.model.opt.viscosity = self.model.opt.density = 0.0
        return -float(data.qfrc_passive[2])

    def settle(self):
        """Lets the airframe sink into the floor's soft contact; altitude counts from there."""
        for _ in range(round(0.5 / STEP_S)):
            mujoco.mj_step(self.model, self.data)
        self.rest_m = float(self.data.qpos[2])
        self.data.time = 0.0

    def place(self):
        x, y, z = self.data.qpos[:3]
        return np.array([x, y, z - self.rest_m])

    def speed(self):
        return float(self.data.qvel[2])

    def drive(self, dt_s):
        """Sets forces for a step of the thrust that is commanded and of the torques that hold the tilt asked for."""
        data, z_m, v_m_s = self.data, float(self.data.qpos[2]) - self.rest_m, float(self.data.qvel[2])
        thrust_n = self.begin(self.now.t_s, z_m, v_m_s)
        pitch, roll = self.tilt
        w, x, y, z = data.qpos[3:7]
        error = np.array([roll - 2.0 * w * x, pitch - 2.0 * w * y, -2.0 * w * z])
        rates = data.qvel[3:6]
        torque = self.inertia * (self.natural**2 * error - 2.0 * self.damping * self.natural * rates)
        side_m = self.arm_m * 0.5**0.5
        a, b, c = torque[0] / (4.0 * side_m), torque[1] / (4.0 * side_m), torque[2] / (4.0 * SPIN_M)
        data.ctrl[:] = np.maximum(0.0, 0.25 * thrust_n + np.array([a - b + c, a + b - c, -a + b + c, -a - b - c]))
        self.model.actuator_gainprm[:, 0] = self.rotors * self.lift(z_m, v_m_s)
        self.model.opt.wind[2] = self.wind_m_s()
        data.xfrc_applied[1, 2] = self.push_n(z_m, v_m_s)
        self.model.opt.timestep = dt_s

    def step(self, dt_s):
        self.drive(dt_s)
        before = float(self.data.qvel[2])
        mujoco.mj_step(self.model, self.data)
        self.remember(dt_s)
        self.now.t_s += dt_s
        return (float(self.data.qvel[2]) - before) / dt_s

    def led(self, other, dt_s):
        self.data.qpos[:7], self.data.qvel[:6] = other.data.qpos[:7], other.data.qvel[:6]
        self.data.qpos[2] += self.rest_m - other.rest_m
        return self.step(dt_s)
