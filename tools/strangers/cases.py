"""Every kind of case, how it is drawn, and the sealed cases of a seed. Families and shares are those of the blind check."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import laws
from flight import Case
from rig import NUMBERS, deviations, drawn

# Of 300 cases: nothing; one effect of the library; two; something that the library does not have.
SHARES = {"none": 60, "single": 140, "pair": 40, "outside": 60}
ORDER, DRAW = 1 << 32, 2 << 32


@dataclass(frozen=True)
class Kind:
    """`effect` is the library's name, none outside of it. Sizes are drawn uniform in the logarithm from `low` to `high`; `make` takes random
    numbers, the size and the rig, and returns the fault; `parameters` are names of the library that the size is the value of."""

    effect: str | None
    form: str
    stage: str
    size_of: str
    low: float
    high: float
    make: Callable
    regions: tuple = ()
    parameters: tuple = ()
    # Whether the size is drawn with either sign.
    signed: bool = False


def air_speed(rig, acceleration_m_s2):
    """Wind that pushes the airframe by so much through its drag, m/s."""
    return acceleration_m_s2 * rig.numbers[0] / rig.numbers[1]


KINDS = [
    Kind("tracker-latency", "buffered", "tracker", "extra latency, s", 0.012, 0.15, lambda r, x, rig: laws.Buffered(x), parameters=("extra_s",)),
    Kind("tracker-latency", "smoothing", "tracker", "extra latency, s", 0.015, 0.15, lambda r, x, rig: laws.Smoothing(x, rig.frame_s), parameters=("extra_s",)),
    Kind("tracker-jitter", "log-normal-waits", "tracker", "deviation of the wait, s", 0.0004, 0.008,
         lambda r, x, rig: laws.LogNormalWaits(x, r.uniform(0.6, 1.2)), parameters=("sigma_s",)),
    Kind("tracker-jitter", "batches", "tracker", "deviation of the wait, s", 0.0004, 0.008,
         lambda r, x, rig: laws.Batches(x, int(r.integers(2, 5))), parameters=("sigma_s",)),
    Kind("tracker-scale", "perspective", "tracker", "scale error, 1", 0.012, 0.15,
         lambda r, x, rig: laws.Perspective(x, r.uniform(-0.008, 0.008)), ("altitude",), ("scale_error",), True),
    Kind("tracker-noise", "uniform", "tracker", "noise, m", 0.0004, 0.008, lambda r, x, rig: laws.UniformNoise(x), parameters=("sigma_m",)),
    Kind("tracker-noise", "flicker", "tracker", "noise, m", 0.0004, 0.008, lambda r, x, rig: laws.FlickerNoise(x, r.uniform(20.0, 300.0)), parameters=("sigma_m",)),
    Kind("tracker-dropout", "dim-light", "tracker", "share of frames, 1", 0.003, 0.1, lambda r, x, rig: laws.DimLight(x), parameters=("probability",)),
    Kind("tracker-dropout", "blinking", "tracker", "share of frames, 1", 0.008, 0.12, lambda r, x, rig: laws.Blinking(x, round(1.001 / x * r.integers(1, 6))),
         parameters=("probability",)),
    Kind("tracker-outliers", "reflections", "tracker", "share of frames, 1", 0.0003, 0.01, lambda r, x, rig: laws.Reflections(x, r.uniform(0.05, 0.4)),
         parameters=("probability",)),
    Kind("loop-overrun", "log-normal-stalls", "loop", "share of iterations, 1", 0.002, 0.08, lambda r, x, rig: laws.LogNormalStalls(x, r.uniform(0.004, 0.05)),
         parameters=("probability",)),
    Kind("loop-overrun", "backups", "loop", "share of iterations, 1", 0.005, 0.1, lambda r, x, rig: laws.Backups(x, r.uniform(0.003, 0.04)), parameters=("probability",)),
    Kind("actuator-lag", "three-packets", "actuator", "mean lag, s", 0.008, 0.15, lambda r, x, rig: laws.ThreePackets(x), ("lagged-throttle",), ("time_constant_s",)),
    Kind("actuator-lag", "three-poles", "actuator", "sum of time constants, s", 0.008, 0.15, lambda r, x, rig: laws.ThreePoles(x, rig.low), ("lagged-throttle",),
         ("time_constant_s",)),
    Kind("actuator-saturation", "compressed", "actuator", "thrust to weight less one, 1", 0.05, 0.2, lambda r, x, rig: laws.Compressed(rig.hover + x * rig.per_weight),
         ("throttle",)),
    Kind("actuator-quantisation", "companded", "actuator", "step over range, 1", 0.0045, 0.02,
         lambda r, x, rig: laws.Companded(x * rig.range, rig.low, rig.hover, rig.high), parameters=("step_fraction",)),
    Kind("actuator-backlash", "three-plays", "actuator", "play over range, 1", 0.004, 0.025, lambda r, x, rig: laws.ThreePlays(x * rig.range, rig.low),
         parameters=("width_fraction",)),
    Kind("rotor-lag", "simulator-motors", "propulsion", "time constant, s", 0.006, 0.15, lambda r, x, rig: laws.SlowMotors(x), ("lagged-throttle",), ("time_constant_s",)),
    Kind("rotor-lag", "torque-motors", "propulsion", "time constant at hover, s", 0.006, 0.12, lambda r, x, rig: laws.TorqueMotors(x, rig.weight_n), ("lagged-throttle",),
         ("time_constant_s",)),
    Kind("thrust-curve", "exponential", "propulsion", "curvature of the exponential, 1", 0.03, 0.8, lambda r, x, rig: laws.ExponentialCurve(x, rig.weight_n),
         ("throttle",), signed=True),
    Kind("thrust-curve", "kinked", "propulsion", "change of slope, 1", 0.025, 0.6, lambda r, x, rig: laws.KinkedCurve(x, rig.weight_n), ("throttle",), signed=True),
    Kind("thrust-loss", "one-rotor", "propulsion", "fraction of thrust, 1", 0.04, 0.2, lambda r, x, rig: laws.WornRotor(x), parameters=("fraction",)),
    Kind("thrust-loss", "all-rotors", "propulsion", "fraction of thrust, 1", 0.04, 0.35, lambda r, x, rig: laws.WornAll(x), parameters=("fraction",)),
    Kind("battery-discharge", "nernst", "propulsion", "loss per minute of hover, 1/min", 0.004, 0.09, lambda r, x, rig: laws.NernstCell(x, r.uniform(4.0, 8.0)),
         ("charge",), ("loss_per_hover_minute",)),
    Kind("battery-load", "diffusion", "propulsion", "loss in steady hover, 1", 0.003, 0.08, lambda r, x, rig: laws.DiffusingCell(x, r.uniform(0.2, 0.6)), ("time",), ("sag",)),
    Kind("battery-load", "resistance", "propulsion", "loss in steady hover, 1", 0.003, 0.08, lambda r, x, rig: laws.Resistance(x, r.uniform(0.3, 3.0)), ("time",), ("sag",)),
    Kind("ground-effect-shape", "hayden", "environment", "share of the other law, 1", 0.06, 1.0, lambda r, x, rig: laws.HaydenGround(x, r.uniform(0.02, 0.06)), ("altitude",)),
    Kind("ground-effect-shape", "cosine", "environment", "share of the other law, 1", 0.012, 0.5,
         lambda r, x, rig: laws.CosineGround(x, rig.numbers[4] - 1.0, rig.numbers[5] * r.uniform(1.8, 3.5)), ("altitude",)),
    Kind("ground-effect-dynamic", "late-cushion", "environment", "delay, s", 0.003, 0.1, lambda r, x, rig: laws.LateCushion(x), ("altitude",), ("time_constant_s",)),
    Kind("ceiling-effect", "hsiao", "environment", "reach of the ceiling, m", 0.004, 0.04, lambda r, x, rig: laws.NearCeiling(x, r.uniform(1.05, 1.25)), ("altitude",)),
    Kind("gusts", "steps", "environment", "deviation of the push, m/s^2", 0.04, 0.4, lambda r, x, rig: laws.SteppedWind(air_speed(rig, x), r.uniform(0.4, 2.0))),
    Kind("gusts", "sines", "environment", "deviation of the push, m/s^2", 0.04, 0.4, lambda r, x, rig: laws.SineSum(air_speed(rig, x), r.uniform(0.15, 0.6))),
    Kind("updraft", "constant-wind", "environment", "push, m/s^2", 0.08, 1.2, lambda r, x, rig: laws.ConstantWind(air_speed(rig, x)), signed=True),
    Kind("mass-change", "mass", "airframe", "fraction of mass, 1", 0.04, 0.35, lambda r, x, rig: laws.Heavier(x * rig.numbers[0]), parameters=("fraction",), signed=True),
    Kind("quadratic-drag", "parasitic", "airframe", "drag at 1 m/s over weight, 1", 0.015, 0.5, lambda r, x, rig: laws.ParasiticDrag(x * rig.weight_n), ("speed",)),
    Kind("descent-thrust-loss", "logistic-wake", "airframe", "loss of thrust, 1", 0.008, 0.15,
         lambda r, x, rig: laws.DescentWake(x, r.uniform(0.1, 0.25), r.uniform(0.02, 0.06), r.uniform(0.05, 0.3)), ("speed",)),
    Kind("inflow-damping", "induced-inflow", "airframe", "loss per speed of climb, s/m", 0.04, 0.6, lambda r, x, rig: laws.Inflow(x, rig.weight_n), ("speed",)),
    Kind(None, "warm-camera", "tracker", "drift of altitude, m/min", 0.003, 0.1, lambda r, x, rig: laws.WarmCamera(x), ("time",), signed=True),
    Kind(None, "motion-blur", "tracker", "shift per speed, s", 0.005, 0.12, lambda r, x, rig: laws.MotionBlur(x), ("speed",), signed=True),
    Kind(None, "slew-limit", "actuator", "time for a tenth of the weight, s", 0.05, 1.0, lambda r, x, rig: laws.SlewLimit(0.1 * rig.per_weight / x, rig.low),
         ("lagged-throttle", "throttle")),
    Kind(None, "bouc-wen", "propulsion", "half-width over weight, 1", 0.001, 0.03, lambda r, x, rig: laws.BoucWen(x), ("throttle", "lagged-throttle")),
    Kind(None, "brown-out", "propulsion", "loss of thrust, 1", 0.004, 0.08, lambda r, x, rig: laws.BrownOut(x, r.uniform(1.02, 1.06), r.uniform(0.2, 0.6)), ("throttle",)),
    Kind(None, "lost-blade", "propulsion", "loss of thrust, 1", 0.003, 0.06, lambda r, x, rig: laws.LostBlade(x), ("time",)),
    Kind(None, "sine-wind", "environment", "push, m/s^2", 0.01, 0.25, lambda r, x, rig: laws.SineWind(air_speed(rig, x), r.uniform(0.1, 0.8))),
    Kind(None, "suction", "environment", "pull over weight, 1", 0.08, 1.0, lambda r, x, rig: laws.Suction(x * rig.weight_n, r.uniform(0.003, 0.008)), ("altitude",)),
    Kind(None, "bungee", "environment", "pull over weight, 1/m", 0.004, 0.12, lambda r, x, rig: laws.Bungee(x * rig.weight_n, r.uniform(0.35, 0.7)), ("altitude",)),
    Kind(None, "hung-weight", "airframe", "mass over mass, 1", 0.01, 0.2, lambda r, x, rig: laws.HungWeight(x * rig.numbers[0], r.uniform(0.8, 2.5), r.uniform(0.05, 0.15)),
         ("speed", "lagged-throttle")),
    Kind(None, "climb-drag", "airframe", "drag per speed over weight, s/m", 0.008, 0.2, lambda r, x, rig: laws.ClimbDrag(x * rig.weight_n), ("speed",)),
]


class Turns:
    """Goes through all effects before any comes again, in random order; of an effect, any form."""

    def __init__(self, outside, random):
        self.random, self.left = random, []
        self.effects = {}
        for kind in KINDS:
            if (kind.effect is None) == outside:
                self.effects.setdefault(kind.effect or kind.form, []).append(kind)

    def next(self):
        if not self.left:
            self.left = list(self.random.permutation(sorted(self.effects)))
        forms = self.effects[self.left.pop()]
        return forms[int(self.random.integers(len(forms)))]


def goes_with(a, b):
    """There is one camera, one converter, one radio, one loop; forces go with everything."""
    return a.slot is None or a.slot != b.slot


def counts(cases):
    part = {family: (cases * of_300 + 150) // 300 for family, of_300 in SHARES.items()}
    part["single"] = cases - part["none"] - part["pair"] - part["outside"]
    return part


def make(kind, random, rig, size=None):
    """A fault of a kind, of a drawn size or of that given, and its size."""
    drawn_size = float(np.exp(random.uniform(np.log(kind.low), np.log(kind.high))))
    if kind.signed and random.random() < 0.5:
        drawn_size = -drawn_size
    size = drawn_size if size is None else size
    return kind.make(random, size, rig), size


def nuisances(rig, seed, index, faults):
    """A case around its faults: this airframe's numbers, its air, its battery. Returns it with the numbers' deviations."""
    random = np.random.default_rng([seed, DRAW, 1 << 16, index])
    off = deviations(random)
    push_m_s2 = float(np.exp(random.uniform(np.log(0.006), np.log(0.05))))
    case = Case(drawn(rig, off), faults, air_speed(rig, push_m_s2), float(np.exp(random.uniform(np.log(0.3), np.log(1.5)))), float(random.uniform(0.001, 0.005)), seed, index)
    return case, dict(zip(NUMBERS, off))


def draw(rig, cases, seed):
    """All cases of a seed in the order in which they are sealed: each with its truth, but for the detectability."""
    order = np.random.default_rng([seed, ORDER])
    plans = []
    for number, (family, count) in enumerate(counts(cases).items()):
        turns = Turns(family == "outside", order)
        for i in range(count):
            random = np.random.default_rng([seed, DRAW, number, i])
            chosen = []
            while len(chosen) < {"none": 0, "pair": 2}.get(family, 1):
                kind = turns.next()
                fault, size = make(kind, random, rig)
                if all(kind.effect != other.effect and goes_with(fault, put) for other, put, _ in chosen):
                    chosen.append((kind, fault, size))
            # In the order of the catalogue: rotors before batteries, ground before mass.
            plans.append((family, sorted(chosen, key=lambda c: KINDS.index(c[0]))))
    order.shuffle(plans)
    return [sealed(rig, seed, index, family, chosen) for index, (family, chosen) in enumerate(plans)]


def sealed(rig, seed, index, family, chosen):
    case, off = nuisances(rig, seed, index, [fault for _, fault, _ in chosen])
    ingredients = [
        {**({"effect": kind.effect} if kind.effect else {}), "form": kind.form, "stage": kind.stage, "regions": list(kind.regions), "size": size,
         "size_of": kind.size_of, "detectability": 0.0, "form_in_full": f"{type(fault).__name__} {vars(fault)}"}
        for kind, fault, size in chosen
    ]
    parameters = [{"effect": kind.effect, "name": name, "value": size} for kind, _, size in chosen for name in kind.parameters]
    truth = {"family": family, "ingredients": ingredients, "parameters": parameters, "detectability": 0.0, "nuisances_sigma": off,
             "turbulence_m_s": case.turbulence_m_s, "turbulence_correlation_s": case.turbulence_s, "drain_per_min": case.drain_per_min}
    return case, truth
