"""What every simulator's world has in common: one airframe with its numbers, its air, its battery, and the laws wrapped around it.

A world goes on step by step under the throttle that its motors hear. A world may also be led along another's path (`led`): its
motors and laws go on by themselves, its place and speed are the other's. The difference of their accelerations is what a law
that the one has and the other lacks does there."""

import math
from dataclasses import dataclass

import numpy as np

GRID_S = 0.005


@dataclass
class Now:
    """An instant as laws see it. `load` is thrust over nominal weight before the ground's and the laws' factors."""

    t_s: float = 0.0
    session_min: float = 0.0
    z_m: float = 0.0
    v_m_s: float = 0.0
    load: float = 0.0


@dataclass
class Airframe:
    """One airframe on one flight. `numbers` in the order of rig.NUMBERS; `trim` is this flight's thrust over that of others;
    `drain_per_min` the share of thrust gone after a minute of hover without any effect; `begins_min` the flight's beginning after that of the case."""

    numbers: list
    trim: float = 1.0
    drain_per_min: float = 0.0
    begins_min: float = 0.0


def air_series(random, duration_s, sigma_m_s, correlation_s):
    """The room's turbulence on the grid of GRID_S, m/s: white noise through two equal low passes, so that the air has no sudden speed."""
    settle = int(8.0 * correlation_s / GRID_S)
    count = settle + int(duration_s / GRID_S) + 2
    keep = math.exp(-GRID_S / correlation_s)
    white = random.normal(size=count)
    inner = outer = 0.0
    series = np.empty(count)
    for i, x in enumerate(white):
        inner = keep * inner + math.sqrt(1.0 - keep * keep) * x
        outer += (1.0 - keep) * (inner - outer)
        series[i] = outer
    # Two equal poles in a row halve the variance.
    return sigma_m_s * math.sqrt(2.0) * series[settle:]


class World:
    """The parts around a simulator's own physics. `laws` act in their order."""

    def __init__(self, rig, airframe, laws, air):
        self.rig, self.airframe, self.laws, self.air = rig, airframe, laws, air
        self.now = Now(session_min=airframe.begins_min)
        self.drawn_min = 0.0
        # What the motors hear: when, and the pin; and the tilt asked for (pitch, roll), rad.
        self.edges = []
        self.heard, self.tilt = rig.low, (0.0, 0.0)

    # What the simulator's own file provides: place, speed, one step, and one step along another's path.

    def place(self):
        """Position, m, three axes."""
        raise NotImplementedError

    def speed(self):
        """Vertical speed, m/s."""
        raise NotImplementedError

    def step(self, dt_s):
        """Goes on by `dt_s`; returns the vertical acceleration at (or over) the step, m/s^2."""
        raise NotImplementedError

    def led(self, other, dt_s):
        """The same along the path of `other`, which has not yet taken this step."""
        raise NotImplementedError

    # What they share.

    def begin(self, t_s, z_m, v_m_s):
        """Sets the instant, lets the motors hear what is due, and returns thrust commanded to the motors, N, all laws of propulsion in it."""
        now = self.now
        now.t_s, now.session_min = t_s, self.airframe.begins_min + t_s / 60.0
        now.z_m, now.v_m_s = z_m, v_m_s
        while self.edges and self.edges[0][0] <= t_s + 1e-9:
            _, self.heard, self.tilt = self.edges.pop(0)
        throttle = self.heard
        for law in self.laws:
            throttle = law.throttle(now, throttle)
        gain, offset = self.airframe.numbers[2:4]
        fresh = self.airframe.trim * (1.0 - self.airframe.drain_per_min * self.drawn_min / (1.0 + 0.2 * self.drawn_min))
        thrust_n = max(0.0, gain * (throttle - offset)) * fresh
        now.load = thrust_n / self.rig.weight_n
        for law in self.laws:
            thrust_n = law.thrust(now, thrust_n)
        return thrust_n

    def lift(self, z_m, v_m_s):
        """What the ground and the laws of the air make of the rotors' thrust at an altitude and a speed: a factor."""
        multiplier, height_m = self.airframe.numbers[4:6]
        ground = (multiplier - 1.0) * max(0.0, 1.0 - max(z_m, 0.0) / height_m)
        for law in self.laws:
            ground = law.ground(self.now, z_m, ground)
        factor = 1.0 + ground
        for law in self.laws:
            factor *= law.lift(self.now, z_m, v_m_s)
        return factor

    def push_n(self, z_m, v_m_s):
        """Force of the laws, up, N."""
        return sum(law.force_n(self.now, z_m, v_m_s) for law in self.laws)

    def wind_m_s(self):
        """The air's vertical speed, m/s."""
        place = self.now.t_s / GRID_S
        index = min(int(place), len(self.air) - 2)
        still = self.air[index] + (self.air[index + 1] - self.air[index]) * (place - index)
        return still + sum(law.wind_m_s(self.now) for law in self.laws)

    def remember(self, dt_s):
        """Charge drawn and the laws' memories, over a step."""
        self.drawn_min += self.now.load**1.5 * dt_s / 60.0
        for law in self.laws:
            law.advance(self.now, dt_s)

    def next_edge_s(self):
        return self.edges[0][0] if self.edges else math.inf
