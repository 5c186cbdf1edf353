"""RotorPy (github.com/spencerfolk/rotorpy): its multirotor with rotor drag, induced inflow, motor lag, allocation of thrust and torque, and ground.

Its equations are integrated here by the midpoint rule, its motors exactly; its own `step` calls scipy's adaptive integrator, which costs several times as
much. Linear vertical drag of the rig is RotorPy's induced inflow `k_z`, scaled to give it at hover."""

import copy
import math

import numpy as np
from rotorpy.vehicles import multirotor
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

from rig import GRAVITY_M_S2
from world import World

NAME = "rotorpy"
STEP_S = 0.01
# Of motors that count as nominal, s; the rig's latency is of the whole chain and holds it. RotorPy's own 0.072 s for the Crazyflie is a lag that a rig has no word for.
MOTOR_S = 0.006


class Rotation:
    """The one use that RotorPy's dynamics make of scipy's class, whose checks cost more than the dynamics."""

    def __init__(self, matrix):
        self.matrix = matrix

    @classmethod
    def from_quat(cls, q):
        x, y, z, w = q / math.sqrt(q @ q)
        return cls(np.array([[1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                             [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                             [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]]))

    def as_matrix(self):
        return self.matrix


multirotor.Rotation = Rotation


class Flown(Multirotor):
    """RotorPy's multirotor whose rotors may be worn, in air that the world around it makes thicker or thinner."""

    world = None

    def compute_body_wrench(self, body_rates, rotor_speeds, body_airspeed_vector):
        force, moment = super().compute_body_wrench(body_rates, rotor_speeds, body_airspeed_vector)
        z_m, v_m_s = self.instant
        full_n = self.k_eta * rotor_speeds**2
        more_n = (self.rotors * self.world.lift(z_m, v_m_s) - 1.0) * full_n
        force = force + np.array([0.0, 0.0, more_n.sum() + self.world.push_n(z_m, v_m_s)])
        moment = moment + np.array([self.rotor_geometry[:, 1] @ more_n, -self.rotor_geometry[:, 0] @ more_n, 0.0])
        return force, moment

    def _s_dot_fn(self, t, s, cmd_rotor_speeds):
        self.instant = s[2], s[5]
        return super()._s_dot_fn(t, s, cmd_rotor_speeds)


class RotorPyWorld(World):
    def __init__(self, rig, airframe, laws, air):
        super().__init__(rig, airframe, laws, air)
        mass_kg, drag = airframe.numbers[:2]
        parameters = copy.deepcopy(quad_params)
        hover_rad_s = math.sqrt(rig.weight_n / (4.0 * parameters["k_eta"]))
        inflow = drag / (4.0 * hover_rad_s)
        self.natural, self.damping = rig.stabiliser["natural_frequency_rad_s"], rig.stabiliser["damping_ratio"]
        parameters |= {"mass": mass_kg, "k_z": inflow, "k_d": inflow, "tau_m": MOTOR_S}
        # Share of the thrust that each rotor gives for its speed.
        rotors = np.ones(4)
        for law in laws:
            law.configure_rotorpy(parameters, rotors)
        self.quad = Flown(parameters, control_abstraction="cmd_ctbm", aero=True, enable_ground=True)
        self.quad.g = GRAVITY_M_S2
        self.quad.weight = np.array([0.0, 0.0, -self.quad.mass * GRAVITY_M_S2])
        self.quad.rotors, self.quad.world, self.quad.instant = rotors, self, (0.0, 0.0)
        # Position, velocity, attitude (x y z w), body rates, wind, rotor speeds.
        self.s = np.zeros(20)
        self.s[9] = 1.0

    def place(self):
        return self.s[0:3]

    def speed(self):
        return float(self.s[5])

    def commanded(self):
        thrust_n = self.begin(self.now.t_s, float(self.s[2]), float(self.s[5]))
        pitch, roll = self.tilt
        x, y, z, w = self.s[6:10]
        # The rig's stabiliser: RotorPy's own attitude loop is another airframe's.
        error = np.array([roll - 2.0 * w * x, pitch - 2.0 * w * y, -2.0 * w * z])
        moment = self.quad.inertia @ (self.natural**2 * error - 2.0 * self.damping * self.natural * self.s[10:13])
        self.s[13:16] = 0.0, 0.0, self.wind_m_s()
        speeds = self.quad.get_cmd_motor_speeds(None, {"cmd_thrust": thrust_n, "cmd_moment": moment})
        return np.clip(speeds, self.quad.rotor_speed_min, self.quad.rotor_speed_max)

    def step(self, dt_s):
        speeds, before = self.commanded(), self.s
        first = self.quad._s_dot_fn(0.0, before, speeds)
        middle = before + 0.5 * dt_s * first
        middle[16:] = self.rotors_after(0.5 * dt_s, before[16:], speeds)
        self.s = before + dt_s * self.quad._s_dot_fn(0.0, middle, speeds)
        self.s[16:] = self.rotors_after(dt_s, before[16:], speeds)
        self.s[6:10] /= np.linalg.norm(self.s[6:10])
        state = Multirotor._unpack_state(self.s)
        if self.quad._on_ground(state):
            self.s = Multirotor._pack_state(self.quad._handle_vehicle_on_ground(state))
        self.remember(dt_s)
        self.now.t_s += dt_s
        return float(first[5])

    def led(self, other, dt_s):
        self.s[:16] = other.s[:16]
        speeds = self.commanded()
        acceleration = float(self.quad._s_dot_fn(0.0, self.s, speeds)[5])
        self.s[16:] = self.rotors_after(dt_s, self.s[16:], speeds)
        self.remember(dt_s)
        self.now.t_s += dt_s
        return acceleration

    def rotors_after(self, dt_s, before, commanded):
        """RotorPy's first-order motors, solved exactly: a step may be as long as their time constant."""
        return commanded + (before - commanded) * math.exp(-dt_s / self.quad.tau_m)
