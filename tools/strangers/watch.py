"""How well what was put into a case can be seen: its detectability d', as the blind check counts it (docs/blind.md).

d' is the square root of twice the expected log-likelihood ratio between the flights as they were and the same flights without the
fault, for an observer who knows noise, turbulence and laws but not this case's own numbers. Along the flown path a twin without the
fault flies in the same simulator; what that changes in acceleration and in the measured altitude goes through the innovations of the
observer's Kalman filter. One sigma of each of the rig's numbers goes through it as well, and what these explain under their prior is
projected out. What shows in readbacks, time stamps, lost frames or the spread of noise is counted from its distribution instead."""

import math

import numpy as np

from flight import BUS_JITTER_S, LATENESS_S, TRIM_SIGMA, Converter
from laws import excess
from rig import GRAVITY_M_S2

# Below this altitude the airframe may stand on the floor, which hides every force that does not lift it, m.
FLOOR_M = 0.002
LARGEST = 1000.0
# How many numbers in a second of flight tell of a random force: wind is slower than frames.
RANDOM_FORCE_PER_S = 4.0
# Every room's air moves; wind beyond this is gusts. As an acceleration, m/s^2.
STRONGEST_TURBULENCE_M_S2 = 0.05


class Watch:
    """What the flights of a case add up to. Signals: all faults, each fault, then one sigma of each of the rig's numbers."""

    bus_jitter_s, lateness_s = BUS_JITTER_S, LATENESS_S

    def __init__(self, rig, case):
        self.rig, self.case = rig, case
        count = 1 + len(case.faults) + len(rig.sigma)
        self.gram = np.zeros((count, count))
        self.aside = [0.0] * len(case.faults)
        self.frames = self.variances = self.iterations = self.airborne_s = 0.0

    @property
    def variance(self):
        """Mean variance of an innovation, m^2."""
        return max(self.variances / max(self.frames, 1.0), 1e-12)

    def add(self, flown):
        faults = self.case.faults
        if not faults:
            return
        force = self.forces(flown)
        shift = np.array([frame.shift_m for frame in flown.frames])
        sight = np.zeros((len(flown.frames), len(force)))
        trackers = [i for i, fault in enumerate(faults) if fault.slot == "tracker"]
        for signal in [0] + [1 + i for i in trackers]:
            sight[:, signal] = shift
        # A latency of one sigma shows every frame where the airframe was a little before.
        latency = 1 + len(faults) + 6
        speeds = np.interp([frame.exposed_s for frame in flown.frames], flown.cells[:, 0], flown.cells[:, 3])
        sight[:, latency] = -speeds * self.rig.sigma[6]
        self.filter(flown, force, sight)
        for i, fault in enumerate(faults):
            if fault.slot == "output":
                self.aside[i] += self.readback(flown)
        self.iterations += len(flown.pins)

    def forces(self, flown):
        """Each signal's acceleration, m/s^2, a row a signal and a column a step."""
        faults, rig, cells = self.case.faults, self.rig, flown.cells
        z, v, load, as_flown = cells[:, 2], cells[:, 3], cells[:, 4], cells[:, 5]
        standing = z < FLOOR_M
        bear = lambda a: np.where(standing, np.maximum(a, 0.0), a)
        difference = lambda column: bear(as_flown) - bear(cells[:, column])
        acting = [i for i, fault in enumerate(faults) if fault.acts_on_flight()]
        nothing = np.zeros(len(cells))
        everything = difference(6) if acting else nothing
        of_one = lambda i: everything if len(acting) == 1 else difference(7 + acting.index(i))
        each = [of_one(i) if i in acting else nothing for i in range(len(faults))]
        # One sigma of a number, along the path, by the rig's own law.
        mass, drag, gain, _, multiplier, height_m, _ = self.case.numbers
        weightless = rig.weight_n * load / mass
        cushion = 1.0 + (multiplier - 1.0) * np.maximum(0.0, 1.0 - np.maximum(z, 0.0) / height_m)
        inside = np.where(z < height_m, 1.0, 0.0)
        numbers = [-weightless * cushion / mass, -v / mass, weightless * cushion / gain, -gain / mass * cushion,
                   weightless * np.maximum(0.0, 1.0 - np.maximum(z, 0.0) / height_m),
                   weightless * inside * (multiplier - 1.0) * np.maximum(z, 0.0) / height_m**2, np.zeros_like(z)]
        numbers = [np.where(standing, 0.0, sigma * x) for sigma, x in zip(rig.sigma, numbers)]
        return np.array([everything, *each, *numbers])

    def filter(self, flown, force, sight):
        """Runs the observer's filter (altitude, speed, trim of the flight, wind) along a flight and adds up the whitened signals."""
        rig, case, cells = self.rig, self.case, flown.cells
        mass, drag, _, _, multiplier, height_m, _ = case.numbers
        noise = rig.noise_m**2 + rig.resolution_m**2 / 12.0 + 1e-9
        wind = (case.turbulence_m_s * drag / mass) ** 2
        p = np.diag([0.003**2, 0.03**2, (TRIM_SIGMA * GRAVITY_M_S2) ** 2, wind])
        error = np.zeros((4, len(force)))
        cushion = -GRAVITY_M_S2 * (multiplier - 1.0) / height_m
        frame = 0
        exposures = [f.exposed_s for f in flown.frames] + [math.inf]
        for i, (t_s, dt, z, *_) in enumerate(cells):
            end_s = t_s + dt
            push = np.stack([0.5 * dt * dt * force[:, i], dt * force[:, i]])
            if z < FLOOR_M:
                for k, variance in enumerate((0.003**2, 0.03**2)):
                    p[k, :] = p[:, k] = 0.0
                    p[k, k] = variance
                # A lift-off that comes late is an error from there on; while both stand there is none.
                error[:2] = np.where(force[:, i] == 0.0, 0.0, error[:2] + push)
                error[2:] = np.where(force[:, i] == 0.0, 0.0, error[2:])
                while exposures[frame] <= end_s:
                    frame += 1
                continue
            self.airborne_s += dt
            keep = math.exp(-dt / case.turbulence_s)
            a = np.array([[1.0, dt, 0.5 * dt * dt, 0.5 * dt * dt], [dt * cushion if z < height_m else 0.0, 1.0 - dt * drag / mass, dt, dt],
                          [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, keep]])
            p = a @ p @ a.T
            p[3, 3] += wind * (1.0 - keep * keep)
            error = a @ error
            error[:2] += push
            while exposures[frame] <= end_s + 1e-9:
                if flown.frames[frame].position_m:
                    variance = p[0, 0] + noise
                    gain = p[:, 0] / variance
                    innovation = error[0] + sight[frame]
                    self.gram += np.outer(innovation, innovation) / variance
                    self.frames += 1
                    self.variances += variance
                    error = error - np.outer(gain, innovation)
                    p = p - np.outer(gain, p[0])
                frame += 1

    def readback(self, flown):
        """Squared distance of the pins from a sound converter's, in the readback's noise."""
        sound = Converter(self.rig, [])
        sigma = max(self.rig.readback_noise_fraction, 1e-5) * self.rig.range
        return sum(((pin - sound.write(0.0, asked)) / sigma) ** 2 for _, asked, pin in flown.pins)

    def detectability(self):
        """d' of everything, and of each fault."""
        faults = self.case.faults
        if not faults:
            return 0.0, []
        count = 1 + len(faults)
        own, cross = self.gram[:count, :count], self.gram[count:, :count]
        # The numbers' prior of one sigma makes it positive definite.
        prior = self.gram[count:, count:] + np.eye(len(self.rig.sigma))
        beyond = np.maximum(np.diag(own - cross.T @ np.linalg.solve(prior, cross)), 0.0)
        each, rest = [], 0.0
        for i, fault in enumerate(faults):
            mean = self.energy(fault, self.gram[1 + i, 1 + i]) if fault.random_force else beyond[1 + i]
            more = self.aside[i] + fault.spread(self)
            if fault.spread_only or fault.random_force:
                more, mean = more + (mean if fault.random_force else 0.0), 0.0
            each.append(mean + more)
            rest += more
        lone = [fault for fault in faults if not (fault.spread_only or fault.random_force)]
        everything = rest + (sum(x for x, f in zip(beyond[1:], faults) if f in lone) if len(lone) < len(faults) else beyond[0])
        root = lambda x: min(math.sqrt(max(x, 0.0)), LARGEST)
        return root(everything), [root(x) for x in each]

    def energy(self, fault, squared):
        """What a random force adds to the innovations; of wind, no more than exceeds what turbulence may be."""
        count = max(RANDOM_FORCE_PER_S * self.airborne_s, 1.0)
        mass, drag = self.case.numbers[:2]
        wind = (fault.sigma_m_s**2 + self.case.turbulence_m_s**2) * (drag / mass) ** 2
        beyond = max(wind / STRONGEST_TURBULENCE_M_S2**2 - 1.0, 0.0)
        return min(count * excess(squared / count), count * excess(beyond))
