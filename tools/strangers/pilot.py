"""The paper's controller (docs/control.md), written again: position and speed over the delay, wanted speed from the position's
error, thrust from the speed's error by a proportional and an integral term that starts at the weight. Sideways the same by tilt,
without the integral."""

from collections import deque

import numpy as np

from rig import GRAVITY_M_S2, points, sweep

PHASES = {"idle": 1, "launch": 2, "open": 3, "hold": 4, "land": 5, "abort": 6}
# A parabola through fewer positions is noise.
LEAST_POSITIONS = 6


class Pilot:
    def __init__(self, rig, mission):
        self.rig, self.phases = rig, mission["phase"]
        self.mass_kg = rig.numbers[0]
        # Believed exposure [s] and position [m] on three axes, newest last.
        self.seen = deque()
        self.integral_n = rig.weight_n
        self.aborted = self.cut = False
        self.held_m = 0.0

    def observe(self, exposed_s, position_m):
        self.seen.append((exposed_s, *position_m))
        while exposed_s - self.seen[0][0] > 2.0 * self.rig.control["velocity_window_s"] + 1e-3:
            self.seen.popleft()
        # Above the ceiling the flight is given up, as the bench does.
        self.aborted |= position_m[2] > self.rig.safety["ceiling_m"]

    def guess(self):
        """Position [m] and velocity [m/s] by now, three axes each, by a parabola through the window; none before the first position."""
        if not self.seen:
            return None
        rows = np.array(self.seen)
        if len(rows) < LEAST_POSITIONS:
            return rows[-1, 1:], np.zeros(3)
        control = self.rig.control
        # The rig's delay holds half of a velocity window, which a parabola does not lag by.
        delay_s = max(0.0, control["extrapolation_s"] - 0.5 * control["velocity_window_s"])
        t = rows[:, 0] - rows[-1, 0]
        fit = np.linalg.lstsq(np.stack([np.ones_like(t), t, 0.5 * t * t], axis=1), rows[:, 1:], rcond=None)[0]
        return fit[0] + fit[1] * delay_s, fit[1] + fit[2] * delay_s

    def decide(self, t_s):
        """One iteration: the sticks (throttle, pitch, roll, yaw) and what the controller's state records."""
        rig, guess = self.rig, self.guess()
        state = {"estimate_m": guess[0] if guess else np.zeros(3), "estimate_m_s": guess[1] if guess else np.zeros(3)}
        phase, since_s = self.phase(t_s)
        kind = "abort" if self.aborted else phase["kind"]
        state["phase"] = PHASES[kind]
        throttle, closed = rig.low, False
        if kind in ("launch", "open"):
            state["thrust_n"] = (points(phase["thrust_to_weight"], since_s) + sweep(phase, "chirp_amplitude", since_s)) * rig.weight_n
            throttle = self.clamped(state["thrust_n"])
        elif kind == "hold":
            self.held_m = points(phase["altitude_m"], since_s) + sweep(phase, "chirp_amplitude_m", since_s)
            throttle, closed = self.altitude(self.held_m, 0.0, guess, state), True
        elif kind == "land":
            self.cut |= bool(self.seen) and self.seen[-1][3] < phase["cut_below_m"]
            if not self.cut:
                wanted_m = max(0.0, self.held_m - phase["descent_m_s"] * since_s)
                throttle, closed = self.altitude(wanted_m, -phase["descent_m_s"], guess, state), True
        state["integral_n"] = self.integral_n
        pitch, roll = self.tilt(guess) if closed and guess else (0.0, 0.0)
        per = rig.tilt_rad_per_unit
        return (throttle, rig.centre + pitch / per, rig.centre + roll / per, rig.centre), state

    def phase(self, t_s):
        begin_s = 0.0
        for phase in self.phases:
            if t_s < begin_s + phase["duration_s"]:
                return phase, t_s - begin_s
            begin_s += phase["duration_s"]
        return self.phases[-1], self.phases[-1]["duration_s"]

    def altitude(self, wanted_m, ahead_m_s, guess, state):
        """Figure 14 of the paper; returns the throttle."""
        control, weight_n = self.rig.control, self.rig.weight_n
        state["setpoint_z_m"] = wanted_m
        thrust_n = self.integral_n
        if guess:
            position_m, velocity_m_s = guess
            wanted_m_s = (wanted_m - position_m[2]) * control["position_gain_per_s"] + ahead_m_s
            error_m_s = wanted_m_s - velocity_m_s[2]
            state["wanted_m_s"], state["error_m_s"] = wanted_m_s, error_m_s
            grown_n = self.integral_n + self.mass_kg * control["integral_gain_per_s2"] * self.rig.period_s * error_m_s
            self.integral_n = min(max(grown_n, 0.5 * weight_n), 1.6 * weight_n)
            thrust_n = self.integral_n + self.mass_kg * control["speed_gain_per_s"] * error_m_s
        state["thrust_n"] = thrust_n
        return self.clamped(thrust_n)

    def tilt(self, guess):
        """Pitch (nose down pushes towards +x) and roll (right side down pushes towards -y) that bring the airframe back, rad."""
        control = self.rig.control
        position_m, velocity_m_s = guess
        speed_m_s = -control["lateral_position_gain_per_s"] * position_m[:2] - velocity_m_s[:2]
        most = control["tilt_max_rad"]
        pitch, left = np.clip(control["lateral_speed_gain_per_s"] * speed_m_s / GRAVITY_M_S2, -most, most)
        return float(pitch), float(-left)

    def clamped(self, thrust_n):
        return min(max(self.rig.throttle_for(thrust_n), self.rig.low), self.rig.high)
