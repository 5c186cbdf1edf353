"""What is put into a case beside nominal flight, in forms that are neither the bench's laws nor those of its blind check.

A fault of any kind offers the same places to act at and acts at some of them. Faults of the simulator's own making are set in its
configuration (`configure_rotorpy`, `configure_mujoco`); the others are wrapped around commands, forces and the tracker."""

import copy
import math

from rig import GRAVITY_M_S2


class Fault:
    """Acts nowhere. Sizes and units are those of the constructor's names."""

    # Whether it shows in counts, spreads or time stamps alone, so that the mean flight does not tell it.
    spread_only = False
    # Whether its force is random, so that only the energy that it adds tells it.
    random_force = False
    # One fault of a slot fits into a case: there is one camera, one converter, one loop.
    slot = None

    def acts_on_flight(self):
        """Whether forces are others with it than without, along one path and under the same pins."""
        return self.slot not in ("tracker", "loop", "output")

    def fresh(self, random):
        """A copy for one flight, with that flight's random numbers."""
        own = copy.deepcopy(self)
        own.begin(random)
        return own

    def begin(self, random):
        pass

    # The simulator's own features.

    def configure_rotorpy(self, parameters, rotors):
        pass

    def configure_mujoco(self, settings):
        pass

    # Command to pins (the readback shows it), pins to motors (it does not).

    def output(self, session_min, asked, pin_before):
        return asked

    def throttle(self, now, throttle):
        return throttle

    # Forces.

    def thrust(self, now, thrust_n):
        return thrust_n

    def ground(self, now, z_m, ground):
        return ground

    def lift(self, now, z_m, v_m_s):
        return 1.0

    def force_n(self, now, z_m, v_m_s):
        return 0.0

    def wind_m_s(self, now):
        return 0.0

    def advance(self, now, dt_s):
        pass

    # The tracker: lateness of a frame, the place it tells, whether it is lost; the loop.

    def frame_late_s(self, random, count, t_s):
        return 0.0

    def mean_late_s(self):
        """By how much frames are late in the mean, where that is what tells the fault, s."""
        return 0.0

    def told_m(self, z_m, v_m_s, load, t_s):
        """The altitude as told, by the mean; noise is another matter."""
        return z_m

    def noise_m(self, random, count):
        return 0.0

    def lost(self, random, count):
        return False

    def loop_late_s(self, random, index):
        return 0.0

    # For detectability: twice the divergence that shows in spreads and counts.

    def spread(self, watch):
        return 0.0


def excess(more):
    """Twice the divergence of a normal number whose variance has grown by `more` of itself."""
    return max(0.0, more - math.log1p(more))


def relax(level, target, dt_s, time_s):
    return target + (level - target) * math.exp(-dt_s / time_s)


# --- tracker ----------------------------------------------------------------------------------------------------------


class Buffered(Fault):
    """Frames wait in a buffer of fixed length: latency."""

    slot = "tracker"

    def __init__(self, extra_s):
        self.extra_s = extra_s

    def frame_late_s(self, random, count, t_s):
        return self.extra_s

    def mean_late_s(self):
        return self.extra_s


class Smoothing(Fault):
    """The tracker tells a moving average over the last frames, so that what it tells is old by half of them."""

    slot = "tracker"

    def __init__(self, extra_s, frame_s):
        # Means over n frames are (n - 1)/2 frames old.
        self.length = max(2, round(2.0 * extra_s / frame_s) + 1)
        self.extra_s = 0.5 * (self.length - 1) * frame_s
        self.kept = []

    def begin(self, random):
        self.kept = []

    def told_m(self, z_m, v_m_s, load, t_s):
        self.kept = (self.kept + [z_m])[-self.length:]
        return sum(self.kept) / len(self.kept)


class LogNormalWaits(Fault):
    """Frames wait for log-normal times, as those of a busy machine."""

    slot = "tracker"
    spread_only = True

    def __init__(self, sigma_s, spread):
        # `spread` is one sigma of the logarithm; the median is chosen for the deviation asked for.
        self.sigma_s, self.spread_ln = sigma_s, spread
        self.median_s = sigma_s / math.sqrt((math.exp(spread**2) - 1.0) * math.exp(spread**2))

    def frame_late_s(self, random, count, t_s):
        return min(self.median_s * math.exp(self.spread_ln * random.normal()), 0.5)

    def spread(self, watch):
        return watch.frames * excess((self.sigma_s / watch.bus_jitter_s) ** 2)


class Batches(Fault):
    """Frames are handed over in batches: the first of a batch waits for the last."""

    slot = "tracker"
    spread_only = True

    def __init__(self, sigma_s, length):
        self.sigma_s, self.length = sigma_s, length
        # Waits are evenly spaced from the longest to none: their deviation is step * sqrt((n^2 - 1)/12).
        self.step_s = sigma_s / math.sqrt((length**2 - 1) / 12.0)

    def frame_late_s(self, random, count, t_s):
        return (self.length - 1 - count % self.length) * self.step_s

    def spread(self, watch):
        return watch.frames * excess((self.sigma_s / watch.bus_jitter_s) ** 2)


class Perspective(Fault):
    """A camera off its calibrated distance: altitudes are stretched, more so above, as a tilted image plane does."""

    slot = "tracker"

    def __init__(self, scale_error, bias_m):
        self.scale_error, self.bias_m = scale_error, bias_m

    def told_m(self, z_m, v_m_s, load, t_s):
        k = self.scale_error
        return z_m * (1.0 + k) / (1.0 - 0.3 * k * (z_m - 0.5)) + self.bias_m


class UniformNoise(Fault):
    """A coarser detector: noise that is uniform, not normal."""

    slot = "tracker"
    spread_only = True

    def __init__(self, sigma_m):
        self.sigma_m = sigma_m

    def noise_m(self, random, count):
        return math.sqrt(3.0) * self.sigma_m * random.uniform(-1.0, 1.0)

    def spread(self, watch):
        return watch.frames * excess(self.sigma_m**2 / watch.variance)


class FlickerNoise(Fault):
    """Noise that comes and goes: loud for a while, then quiet, with lamps that flicker."""

    slot = "tracker"
    spread_only = True

    def __init__(self, sigma_m, frames):
        self.sigma_m, self.frames = sigma_m, frames

    def noise_m(self, random, count):
        # Mean square over a period is sigma^2.
        return self.sigma_m * math.sqrt(2.0) * abs(math.sin(math.pi * count / self.frames)) * random.normal()

    def spread(self, watch):
        return watch.frames * excess(self.sigma_m**2 / watch.variance)


class DimLight(Fault):
    """Frames are lost one by one, each for itself."""

    slot = "tracker"
    spread_only = True

    def __init__(self, probability):
        self.probability = probability

    def lost(self, random, count):
        return random.random() < self.probability

    def spread(self, watch):
        usual = min(max(watch.rig.dropout_probability, 1e-4), 0.5)
        p = min(usual + self.probability, 0.9)
        return 2.0 * watch.frames * (p * math.log(p / usual) + (1.0 - p) * math.log((1.0 - p) / (1.0 - usual)))


class Blinking(DimLight):
    """A lamp that blinks: some frames out of every so many are lost."""

    def __init__(self, probability, period):
        super().__init__(probability)
        self.period = period

    def lost(self, random, count):
        return (count % self.period) < self.probability * self.period - 1e-9 and self.probability * self.period >= 1.0


class Reflections(Fault):
    """Now and then a reflection in the floor is taken for the marker: anywhere within a range below."""

    slot = "tracker"
    spread_only = True

    def __init__(self, probability, range_m):
        self.probability, self.range_m = probability, range_m

    def noise_m(self, random, count):
        return -self.range_m * random.random() if random.random() < self.probability else 0.0

    def spread(self, watch):
        return watch.frames * self.probability * excess(self.range_m**2 / 3.0 / watch.variance)


class WarmCamera(Fault):
    """The camera's mount creeps as it warms up: altitude drifts. Outside the library."""

    slot = "tracker"

    def __init__(self, drift_m_per_min):
        self.drift_m_per_min = drift_m_per_min

    def told_m(self, z_m, v_m_s, load, t_s):
        return z_m + self.drift_m_per_min * t_s / 60.0


class MotionBlur(Fault):
    """A marker that moves is smeared and found too low, either way it moves. Outside the library."""

    slot = "tracker"

    def __init__(self, blur_s):
        self.blur_s = blur_s

    def told_m(self, z_m, v_m_s, load, t_s):
        return z_m - self.blur_s * abs(v_m_s)


# --- loop -------------------------------------------------------------------------------------------------------------


class LogNormalStalls(Fault):
    """Now and then an iteration waits for a log-normal time."""

    slot = "loop"
    spread_only = True

    def __init__(self, probability, mean_s):
        self.probability, self.mean_s = probability, mean_s

    def loop_late_s(self, random, index):
        if index == 0 or random.random() >= self.probability:
            return 0.0
        spread = 0.8
        return min(self.mean_s * math.exp(spread * random.normal() - 0.5 * spread**2), 10.0 * self.mean_s)

    def spread(self, watch):
        ratio = 1.0 + self.mean_s / watch.lateness_s
        return 2.0 * watch.iterations * self.probability * (ratio - 1.0 - math.log(ratio))


class Backups(LogNormalStalls):
    """Another program runs for a while every so often: some iterations in a row are late."""

    def __init__(self, probability, mean_s):
        super().__init__(probability, mean_s)
        self.run = 5

    def loop_late_s(self, random, index):
        every = max(self.run + 1, round(self.run / self.probability))
        return self.mean_s * random.uniform(0.5, 1.5) if index % every >= every - self.run else 0.0


# --- actuator ---------------------------------------------------------------------------------------------------------


class ThreePackets(Fault):
    """The receiver tells the mean of the last packets that it heard: a lag of finite memory."""

    slot = "radio"

    def __init__(self, lag_s):
        # A mean over a time T lags by T/2.
        self.memory_s = 2.0 * lag_s
        self.past = []

    def begin(self, random):
        self.past = []

    def throttle(self, now, throttle):
        if not self.past or self.past[-1][1] != throttle:
            self.past.append((now.t_s, throttle))
        from_s, total, until_s = now.t_s - self.memory_s, 0.0, now.t_s
        for t_s, value in reversed(self.past):
            begin_s = max(t_s, from_s)
            total += value * max(0.0, until_s - begin_s)
            until_s = begin_s
            if until_s <= from_s:
                break
        total += self.past[0][1] * max(0.0, until_s - from_s)
        return total / self.memory_s


class ThreePoles(Fault):
    """Three equal low passes in a row between pins and motors."""

    slot = "radio"

    def __init__(self, lag_s, rest):
        self.pole_s, self.levels = lag_s / 3.0, [rest] * 3
        self.asked = rest

    def throttle(self, now, throttle):
        self.asked = throttle
        return self.levels[2]

    def advance(self, now, dt_s):
        into = self.asked
        for i in range(3):
            before = self.levels[i]
            self.levels[i] = relax(before, into, dt_s, self.pole_s)
            into = 0.5 * (before + self.levels[i])


class Compressed(Fault):
    """Above a level the output goes on rising at a twentieth of the rate."""

    slot = "output"

    def __init__(self, level):
        self.level = level

    def output(self, session_min, asked, pin_before):
        return asked if asked < self.level else self.level + 0.05 * (asked - self.level)


class Companded(Fault):
    """Steps that are finer at low throttle and coarser above, as a companding converter has them; `step` is that at `hover`."""

    slot = "output"

    def __init__(self, step, low, hover, high):
        self.step, self.low, self.hover, self.high = step, low, hover, high
        # Steps grow in proportion to the distance from a point below rest.
        self.base = hover - low + 0.5 * (high - low)
        self.ratio = step / self.base

    def output(self, session_min, asked, pin_before):
        place = math.log((asked - self.low + 0.5 * (self.high - self.low)) / self.base) / math.log1p(self.ratio)
        back = self.base * (1.0 + self.ratio) ** round(place) + self.low - 0.5 * (self.high - self.low)
        return min(max(back, self.low), self.high)


class ThreePlays(Fault):
    """A train of three plays of different width (Prandtl and Ishlinskii); `width` is that of the widest."""

    slot = "output"

    def __init__(self, width, rest):
        self.widths, self.places = [width, 0.6 * width, 0.3 * width], [rest] * 3
        self.shares = [0.6, 0.25, 0.15]

    def output(self, session_min, asked, pin_before):
        self.places = [min(max(place, asked - 0.5 * w), asked + 0.5 * w) for place, w in zip(self.places, self.widths)]
        return sum(share * place for share, place in zip(self.shares, self.places))


class SlewLimit(Fault):
    """Behind the readback, throttle moves no faster than a rate. Outside the library."""

    slot = "radio"

    def __init__(self, per_s, rest):
        self.per_s, self.level, self.asked = per_s, rest, rest

    def throttle(self, now, throttle):
        self.asked = throttle
        return self.level

    def advance(self, now, dt_s):
        step = self.per_s * dt_s
        self.level += min(max(self.asked - self.level, -step), step)


# --- propulsion -------------------------------------------------------------------------------------------------------


class SlowMotors(Fault):
    """The simulator's own motors, slower: RotorPy's of rotor speed, MuJoCo's of thrust."""

    def __init__(self, time_s):
        self.time_s = time_s

    def configure_rotorpy(self, parameters, rotors):
        parameters["tau_m"] += self.time_s

    def configure_mujoco(self, settings):
        settings["motor_s"] += self.time_s


class TorqueMotors(Fault):
    """Rotors driven by torque against their drag: w' = (asked^2 - w^2)/(2 tau), so that they lag more when slow."""

    def __init__(self, time_s, weight_n):
        self.time_s, self.weight_n = time_s, weight_n
        # Rotor speed over that of hover, and the square that is asked for.
        self.speed = self.asked = 0.0

    def thrust(self, now, thrust_n):
        self.asked = thrust_n / self.weight_n
        return self.weight_n * self.speed**2

    def advance(self, now, dt_s):
        # Two steps of Heun each: it is stiff where the rotor is fast.
        for _ in range(2):
            slope = lambda speed: (self.asked - speed**2) / (2.0 * self.time_s)
            guess = max(self.speed + 0.5 * dt_s * slope(self.speed), 0.0)
            self.speed = max(self.speed + 0.25 * dt_s * (slope(self.speed) + slope(guess)), 0.0)


class ExponentialCurve(Fault):
    """Thrust bends as an exponential of what the rig's law gives, equal to it at rest and at hover; `bend` below zero levels off."""

    def __init__(self, bend, weight_n):
        self.bend, self.weight_n = bend, weight_n

    def thrust(self, now, thrust_n):
        return self.weight_n * math.expm1(self.bend * thrust_n / self.weight_n) / math.expm1(self.bend)


class KinkedCurve(Fault):
    """Thrust with a kink at hover: above it a step of throttle is worth more, or less, than below."""

    def __init__(self, change, weight_n):
        self.change, self.weight_n = change, weight_n

    def thrust(self, now, thrust_n):
        return thrust_n + self.change * max(thrust_n - self.weight_n, 0.0)


class WornRotor(Fault):
    """One rotor of four is chipped and gives less for its speed; the attitude loop makes up for the torque."""

    def __init__(self, fraction):
        # The loss of all four together.
        self.fraction = fraction

    def configure_rotorpy(self, parameters, rotors):
        rotors[0] -= 4.0 * self.fraction

    def configure_mujoco(self, settings):
        settings["rotors"][0] -= 4.0 * self.fraction


class WornAll(WornRotor):
    """All rotors are worn alike."""

    def configure_rotorpy(self, parameters, rotors):
        rotors -= self.fraction

    def configure_mujoco(self, settings):
        settings["rotors"] -= self.fraction


class NernstCell(Fault):
    """A cell whose voltage falls with the logarithm of what is left; thrust goes with its square."""

    def __init__(self, loss_per_min, full_min):
        self.slope, self.full_min, self.drawn_min = loss_per_min, full_min, 0.0

    def thrust(self, now, thrust_n):
        left = max(1.0 - self.drawn_min / self.full_min, 0.05)
        return thrust_n * max(1.0 + 0.5 * self.slope * self.full_min * math.log(left), 0.3) ** 2

    def advance(self, now, dt_s):
        self.drawn_min += max(now.load, 0.0) ** 1.5 * dt_s / 60.0


class DiffusingCell(Fault):
    """Ions that diffuse: a sag that grows about as the square root of time under load (three stages, each five times slower)."""

    def __init__(self, sag, fast_s):
        self.sag, self.times_s, self.levels = sag, [fast_s, 5.0 * fast_s, 25.0 * fast_s], [0.0] * 3

    def thrust(self, now, thrust_n):
        return thrust_n * max(1.0 - self.sag * sum(self.levels) / 3.0, 0.3)

    def advance(self, now, dt_s):
        self.levels = [relax(level, now.load, dt_s, time_s) for level, time_s in zip(self.levels, self.times_s)]


class Resistance(Fault):
    """A resistance that drops voltage with the current, and thrust with it, after the smoothing of a capacitor."""

    def __init__(self, sag, time_s):
        self.sag, self.time_s, self.current = sag, time_s, 0.0

    def thrust(self, now, thrust_n):
        # Voltage 1 - sag/2 at hover, thrust as its square.
        return thrust_n * max(1.0 - 0.5 * self.sag * self.current, 0.3) ** 2

    def advance(self, now, dt_s):
        self.current = relax(self.current, max(now.load, 0.0) ** 1.2, dt_s, self.time_s)


class BoucWen(Fault):
    """Thrust with the hysteresis of Bouc and Wen, which no readback shows. Outside the library."""

    def __init__(self, width):
        self.width, self.z, self.last = width, 0.0, None

    def thrust(self, now, thrust_n):
        return thrust_n - self.width * self.z * (thrust_n / now.load if now.load > 1e-6 else 0.0)

    def advance(self, now, dt_s):
        if self.last is not None:
            # A change of the load of `scale` brings the hysteretic part from one side to the other.
            step, scale = now.load - self.last, 0.03
            self.z = min(max(self.z + (step - 0.5 * abs(step) * self.z - 0.5 * step * abs(self.z)) / scale, -1.0), 1.0)
        self.last = now.load


class BrownOut(Fault):
    """Above a load the supply breaks in, and the motors have less for a moment. Outside the library."""

    def __init__(self, depth, above, length_s):
        self.depth, self.above, self.length_s = depth, above, length_s
        self.left_s = self.rest_s = 0.0

    def thrust(self, now, thrust_n):
        return thrust_n * (1.0 - self.depth) if self.left_s > 0.0 else thrust_n

    def advance(self, now, dt_s):
        self.left_s, self.rest_s = self.left_s - dt_s, self.rest_s - dt_s
        if now.load > self.above and self.left_s <= 0.0 and self.rest_s <= 0.0:
            self.left_s, self.rest_s = self.length_s, 4.0 * self.length_s


class LostBlade(Fault):
    """A piece of a propeller comes off in flight: from then on thrust is missing. Outside the library."""

    def __init__(self, fraction):
        self.fraction, self.at_s = fraction, 0.0

    def begin(self, random):
        self.at_s = random.uniform(4.0, 18.0)

    def thrust(self, now, thrust_n):
        return thrust_n * (1.0 - self.fraction) if now.t_s > self.at_s else thrust_n


# --- environment ------------------------------------------------------------------------------------------------------


class HaydenGround(Fault):
    """Ground effect by Hayden's fit, 1/(0.9926 + 0.15176 (R/z)^2) in power at a thrust, read as thrust at a power, in part in place of the rig's law.

    Source: Hayden, The Effect of the Ground on Helicopter Hovering Power Required, AHS Forum 32, 1976."""

    def __init__(self, share, radius_m):
        self.share, self.radius_m = share, radius_m

    def ground(self, now, z_m, ground):
        # The rotors stand half a radius above the skids; the gain is far from unbounded there.
        ratio = self.radius_m / (max(z_m, 0.0) + 0.5 * self.radius_m)
        gain = (0.9926 + 0.15176 * ratio**2) ** (2.0 / 3.0) - 0.9926 ** (2.0 / 3.0)
        return (1.0 - self.share) * ground + self.share * gain


class CosineGround(Fault):
    """Ground effect that begins and ends smoothly, at another height: half a cosine."""

    def __init__(self, share, gain, height_m):
        self.share, self.gain, self.height_m = share, gain, height_m

    def ground(self, now, z_m, ground):
        shape = 0.5 + 0.5 * math.cos(math.pi * min(max(z_m, 0.0) / self.height_m, 1.0))
        return (1.0 - self.share) * ground + self.share * self.gain * shape


class LateCushion(Fault):
    """The cushion is that of the altitude a moment ago: a pure delay."""

    def __init__(self, delay_s):
        self.delay_s, self.past = delay_s, []

    def ground(self, now, z_m, ground):
        self.steady = ground
        while len(self.past) > 1 and self.past[1][0] <= now.t_s - self.delay_s:
            self.past.pop(0)
        return self.past[0][1] if self.past else ground

    def advance(self, now, dt_s):
        self.past.append((now.t_s + dt_s, self.steady))


class NearCeiling(Fault):
    """A ceiling draws the rotors by 1/(1 - k (R/d)^2), and stops the airframe.

    Source: Hsiao, Chirarattananon, Ceiling Effects for Surface Locomotion of Small Rotorcraft, IROS 2018."""

    def __init__(self, strength_m, ceiling_m):
        self.strength_m, self.ceiling_m = strength_m, ceiling_m

    def lift(self, now, z_m, v_m_s):
        distance_m = max(self.ceiling_m - z_m, 0.0) + 0.03
        return 1.0 / (1.0 - min((self.strength_m / distance_m) ** 2, 0.5))

    def force_n(self, now, z_m, v_m_s):
        # Springy guards, some hundred times the weight a centimetre in.
        return -40.0 * max(z_m - self.ceiling_m, 0.0)


class SteppedWind(Fault):
    """Gusts as steps: the wind keeps a speed for a while, then another (RotorPy's LadderWind with random steps)."""

    random_force = True

    def __init__(self, sigma_m_s, length_s):
        self.sigma_m_s, self.length_s, self.steps = sigma_m_s, length_s, []

    def begin(self, random):
        self.steps = self.sigma_m_s * random.normal(size=400)
        self.length_s *= random.uniform(0.8, 1.25)

    def wind_m_s(self, now):
        # A step of air takes a quarter of its length to arrive.
        place = now.t_s / self.length_s
        index, part = int(place), min(4.0 * (place % 1.0), 1.0)
        return self.steps[index] * (1.0 - part) + self.steps[index + 1] * part


class SineSum(Fault):
    """Gusts as a sum of many sines (Shinozuka) with the exponential spectrum of an open window."""

    random_force = True

    def __init__(self, sigma_m_s, corner_hz):
        self.sigma_m_s, self.corner_hz, self.waves = sigma_m_s, corner_hz, []

    def begin(self, random):
        self.waves = [(self.corner_hz * random.exponential(), random.uniform(0.0, math.tau)) for _ in range(24)]
        self.key = self.value = None

    def wind_m_s(self, now):
        if self.key != now.t_s:
            self.key = now.t_s
            size = self.sigma_m_s * math.sqrt(2.0 / len(self.waves))
            self.value = size * sum(math.sin(math.tau * hz * now.t_s + phase) for hz, phase in self.waves)
        return self.value


class ConstantWind(Fault):
    """Air that rises or sinks everywhere."""

    def __init__(self, speed_m_s):
        self.speed_m_s = speed_m_s

    def wind_m_s(self, now):
        return self.speed_m_s


class SineWind(Fault):
    """A wind that swings (RotorPy's SinusoidWind). Outside the library."""

    def __init__(self, speed_m_s, hz):
        self.speed_m_s, self.hz, self.phase = speed_m_s, hz, 0.0

    def begin(self, random):
        self.phase = random.uniform(0.0, math.tau)

    def wind_m_s(self, now):
        return self.speed_m_s * math.sin(math.tau * self.hz * now.t_s + self.phase)


class Suction(Fault):
    """The floor holds the skids: a pull that fades within millimetres. Outside the library."""

    def __init__(self, pull_n, reach_m):
        self.pull_n, self.reach_m = pull_n, reach_m

    def force_n(self, now, z_m, v_m_s):
        return -self.pull_n * math.exp(-max(z_m, 0.0) / self.reach_m) if now.load > 0.3 else 0.0


class Bungee(Fault):
    """An elastic cord from above, taut below an altitude. Outside the library."""

    def __init__(self, stiffness_n_per_m, slack_above_m):
        self.stiffness, self.slack_above_m = stiffness_n_per_m, slack_above_m

    def force_n(self, now, z_m, v_m_s):
        return self.stiffness * max(self.slack_above_m - z_m, 0.0)


class HungWeight(Fault):
    """A weight on a thread of rubber a centimetre long; it lies on the floor until the thread is taut. Outside the library."""

    LENGTH_M = 0.01
    STEP_S = 0.001

    def __init__(self, mass_kg, hz, damping):
        self.mass_kg, self.natural, self.damping = mass_kg, math.tau * hz, damping
        self.height_m = self.speed_m_s = 0.0

    def pull_n(self, z_m, v_m_s):
        taut_m = z_m - self.LENGTH_M - self.height_m
        if taut_m <= 0.0:
            return 0.0
        return self.mass_kg * max(0.0, self.natural**2 * taut_m + 2.0 * self.damping * self.natural * (v_m_s - self.speed_m_s))

    def force_n(self, now, z_m, v_m_s):
        return -self.pull_n(z_m, v_m_s)

    def advance(self, now, dt_s):
        steps = math.ceil(dt_s / self.STEP_S)
        for i in range(steps):
            z_m = now.z_m + now.v_m_s * dt_s * i / steps
            self.speed_m_s += (self.pull_n(z_m, now.v_m_s) / self.mass_kg - GRAVITY_M_S2) * dt_s / steps
            self.height_m += self.speed_m_s * dt_s / steps
            if self.height_m <= 0.0:
                self.height_m, self.speed_m_s = 0.0, max(self.speed_m_s, 0.0)


# --- airframe ---------------------------------------------------------------------------------------------------------


class Heavier(Fault):
    """Another mass, as the simulators have it."""

    def __init__(self, mass_kg):
        self.mass_kg = mass_kg

    def configure_rotorpy(self, parameters, rotors):
        parameters["mass"] += self.mass_kg

    def configure_mujoco(self, settings):
        settings["mass_kg"] += self.mass_kg


class ParasiticDrag(Fault):
    """RotorPy's parasitic drag, MuJoCo's density: drag with the square of airspeed."""

    def __init__(self, at_1_m_s_n):
        self.at_1_m_s_n = at_1_m_s_n

    def configure_rotorpy(self, parameters, rotors):
        parameters["c_Dz"] += self.at_1_m_s_n

    def configure_mujoco(self, settings):
        settings["square_n"] += self.at_1_m_s_n


class DescentWake(Fault):
    """Thrust is lost in descent by a logistic of the speed, which the wake follows with a lag."""

    def __init__(self, depth, onset_m_s, width_m_s, lag_s):
        self.depth, self.onset_m_s, self.width_m_s, self.lag_s, self.wake = depth, onset_m_s, width_m_s, lag_s, 0.0

    def steady(self, v_m_s):
        logistic = lambda x: 1.0 / (1.0 + math.exp(-x))
        return max(0.0, logistic((-v_m_s - self.onset_m_s) / self.width_m_s) - logistic(-self.onset_m_s / self.width_m_s))

    def lift(self, now, z_m, v_m_s):
        return 1.0 - self.depth * self.wake

    def advance(self, now, dt_s):
        self.wake = relax(self.wake, self.steady(now.v_m_s), dt_s, self.lag_s)


class Inflow(Fault):
    """More induced inflow: RotorPy's `k_z`, which grows with rotor speed; in MuJoCo thrust falls with climb over rotor speed."""

    def __init__(self, slope_s_per_m, weight_n):
        self.slope, self.weight_n, self.wrapped = slope_s_per_m, weight_n, False

    def configure_rotorpy(self, parameters, rotors):
        hover_rad_s = math.sqrt(self.weight_n / (4.0 * parameters["k_eta"]))
        parameters["k_z"] += self.slope * self.weight_n / (4.0 * hover_rad_s)

    def configure_mujoco(self, settings):
        self.wrapped = True

    def force_n(self, now, z_m, v_m_s):
        return -self.slope * self.weight_n * math.sqrt(max(now.load, 0.0)) * v_m_s if self.wrapped else 0.0


class ClimbDrag(Fault):
    """A canopy like a parachute upside down: drag in climb alone. Outside the library."""

    def __init__(self, n_s_per_m):
        self.n_s_per_m = n_s_per_m

    def force_n(self, now, z_m, v_m_s):
        return -self.n_s_per_m * max(v_m_s, 0.0)
