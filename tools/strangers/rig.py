"""A rig file of the bench as the strangers' laboratory reads it, and the numbers of one airframe within its tolerances."""

import math
import tomllib

GRAVITY_M_S2 = 9.80665
NUMBERS = ["mass_kg", "drag_n_s_per_m", "gain_n_per_unit", "offset", "ground_effect_multiplier", "ground_effect_height_m", "tracker_latency_s"]
UNITS = {"volt": "v", "fraction": "fraction", "count": "count"}


class Rig:
    """What a rig says of the flight, from the TOML that a recording holds (the airframe is in it)."""

    def __init__(self, text):
        rig = tomllib.loads(text)
        air, track = rig["airframe"], rig["tracker"]
        unit = UNITS[air["actuation"]]
        told = [air["mass_kg"], air["drag_n_s_per_m"], air["thrust"][f"gain_n_per_{unit}"], air["thrust"][f"offset_{unit}"],
                air["ground_effect"]["multiplier"], air["ground_effect"]["height_m"], track["latency_s"]]
        pairs = [(x["value"], x["sigma"]) if isinstance(x, dict) else (x, 0.0) for x in told]
        self.name = rig["name"]
        # Both in the order of NUMBERS: the nominal values, and one sigma of each.
        self.numbers = [value for value, _ in pairs]
        self.sigma = [sigma for _, sigma in pairs]
        self.period_s = rig["loop"]["period_s"]
        self.bits, self.readback_noise_fraction = rig["output"]["bits"], rig["output"]["readback_noise_fraction"]
        self.frame_s, self.resolution_m, self.noise_m = track["frame_period_s"], track["resolution_m"], track["noise_m"]
        self.dropout_probability = track["dropout_probability"]
        self.control, self.safety = rig["control"], rig["safety"]
        sticks = air["sticks"]
        self.low, self.high, self.centre = sticks[f"min_{unit}"], sticks[f"max_{unit}"], sticks[f"centre_{unit}"]
        self.tilt_rad_per_unit = sticks[f"tilt_rad_per_{unit}"]
        self.stabiliser = air["stabiliser"]
        self.weight_n = self.numbers[0] * GRAVITY_M_S2
        self.gain, self.offset = self.numbers[2], self.numbers[3]
        self.hover = self.throttle_for(self.weight_n)
        # Units of throttle for a thrust of the weight.
        self.per_weight = self.weight_n / self.gain

    @property
    def range(self):
        return self.high - self.low

    def throttle_for(self, thrust_n):
        return self.offset + thrust_n / self.gain if thrust_n > 0.0 else self.low


def deviations(random):
    """How far each number of an airframe is off, in sigmas: within one, and in a fifth of the cases one of them up to 1.5."""
    off = []
    for _ in NUMBERS:
        x = random.normal()
        while abs(x) > 1.0:
            x = random.normal()
        off.append(float(x))
    if random.random() < 0.2:
        off[int(random.integers(len(off)))] = float(random.choice([-1.0, 1.0]) * random.uniform(1.0, 1.5))
    return off


def drawn(rig, off):
    """The airframe's own numbers, kept to what can be."""
    numbers = [value + x * sigma for value, x, sigma in zip(rig.numbers, off, rig.sigma)]
    numbers[1] = max(numbers[1], 0.0)
    numbers[4] = max(numbers[4], 1.0)
    numbers[5] = max(numbers[5], 1e-3)
    numbers[6] = max(numbers[6], 0.02)
    return numbers


def points(value, t_s):
    """A mission's value over time: a number, or points [time, value] with straight lines between them."""
    if not isinstance(value, list):
        return float(value)
    if t_s < value[0][0]:
        return value[0][1]
    for (t0, a), (t1, b) in zip(value, value[1:]):
        if t_s < t1:
            return a + (b - a) * (t_s - t0) / (t1 - t0)
    return value[-1][1]


def sweep(phase, amplitude, t_s):
    """The sine of sweeping frequency of a phase: `amplitude` is the key that holds its amplitude."""
    if amplitude not in phase:
        return 0.0
    low, high, whole = phase["chirp_from_hz"], phase["chirp_to_hz"], phase["duration_s"]
    return phase[amplitude] * math.sin(math.tau * (low * t_s + 0.5 * (high - low) / whole * t_s * t_s))
