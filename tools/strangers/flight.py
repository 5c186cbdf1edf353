"""Flies a mission in a simulator's world, as a bench would: loop, output, readback, tracker; and keeps what only its maker knows."""

import math
from dataclasses import dataclass, field

import numpy as np

from pilot import Pilot
from world import Airframe, air_series

# One sigma of thrust from flight to flight: no two cells are equally full.
TRIM_SIGMA = 0.003
# One sigma of arrival times by the bus alone, s.
BUS_JITTER_S = 0.001
# Mean of the lateness that every iteration has, s.
LATENESS_S = 0.0015
# The tracker looks on, and the loop runs on, for so long after the mission, s.
LOOK_ON_S, RUN_ON_S = 0.3, 1.0
FOUND, LOST = 1, 2
# Events that are closer together are one, s.
EVENT_S = 1e-6
# What random numbers are for.
AIR, TRACKER, TIMING, READBACK, TRIM, FAULTS = range(1, 7)


@dataclass
class Case:
    """Everything that a case's flights share. `numbers` in the order of rig.NUMBERS, `faults` in the order in which they act."""

    numbers: list
    faults: list = field(default_factory=list)
    turbulence_m_s: float = 0.02
    turbulence_s: float = 0.8
    drain_per_min: float = 0.0
    seed: int = 0
    index: int = 0


@dataclass
class Frame:
    exposed_s: float
    arrived_s: float
    position_m: list | None
    # The mean of what the frame tells less where the airframe was when the frame seems to be of, m.
    shift_m: float


@dataclass
class Flown:
    """`cells`: an array with a row a step: time [s], length [s], altitude [m], speed [m/s], load, acceleration [m/s^2] as flown, then along
    the same path in each of the twins. `pins`: a row an iteration: time [s], throttle asked for, pin."""

    loop: list
    frames: list
    pins: np.ndarray
    cells: np.ndarray


def stream(case, flight, purpose):
    return np.random.default_rng([case.seed, case.index, flight, purpose])


def twins(case):
    """Which faults each twin has, of those that act on flight: none of them; and, of several, all but one."""
    acting = [i for i, fault in enumerate(case.faults) if fault.acts_on_flight()]
    if not acting:
        return []
    return [[], *([[j for j in acting if j != i] for i in acting] if len(acting) > 1 else [])]


def fly(rig, mission, case, flight, begins_min, simulator):
    duration_s = sum(phase["duration_s"] for phase in mission["phase"])
    iterations = int((duration_s + RUN_ON_S) / rig.period_s)
    trim = 1.0 + TRIM_SIGMA * float(np.clip(stream(case, flight, TRIM).normal(), -3.0, 3.0))
    air = air_series(stream(case, flight, AIR), duration_s + RUN_ON_S + 2.0, case.turbulence_m_s, case.turbulence_s)
    airframe = Airframe(case.numbers, trim, case.drain_per_min, begins_min)

    def faults(kept):
        return [case.faults[i].fresh(np.random.default_rng([case.seed, case.index, flight, FAULTS, i])) for i in kept]

    everything = range(len(case.faults))
    own = faults(everything)
    worlds = [simulator.World(rig, airframe, own, air)]
    worlds += [simulator.World(rig, airframe, faults(kept), air) for kept in twins(case)]
    bench = Bench(rig, case, own, worlds, simulator, stream(case, flight, TRACKER), duration_s)
    timing, readback = stream(case, flight, TIMING), stream(case, flight, READBACK)
    pilot, loop, pins = Pilot(rig, mission), [], []
    converter, free_s, told = Converter(rig, own), 0.0, 0
    noise = rig.readback_noise_fraction * rig.range
    for index in range(iterations):
        scheduled_s = index * rig.period_s
        late_s = 0.4 * LATENESS_S + 0.6 * LATENESS_S * timing.exponential() + sum(f.loop_late_s(timing, index) for f in own)
        # An iteration that was held up holds up the next; none is left out.
        started_s = max(scheduled_s, free_s) + late_s
        bench.advance(started_s)
        while told < len(bench.frames) and bench.frames[told].arrived_s <= started_s:
            frame = bench.frames[told]
            if frame.position_m:
                pilot.observe(frame.arrived_s - rig.numbers[6], frame.position_m)
            told += 1
        sense_s, control_s, actuate_s = (usual * timing.uniform(0.8, 1.4) for usual in (2e-4, 5e-5, 1.2e-3))
        sticks, state = pilot.decide(started_s)
        written_s = started_s + sense_s + control_s + 0.5 * actuate_s
        ended_s = started_s + sense_s + control_s + actuate_s
        bench.advance(written_s)
        pin = converter.write(begins_min + written_s / 60.0, sticks[0])
        tilt = tuple((x - rig.centre) * rig.tilt_rad_per_unit for x in sticks[1:3])
        bench.write(written_s, pin, tilt)
        pins.append((written_s, sticks[0], pin))
        measured = [x + noise * readback.normal() for x in (pin, *sticks[1:])]
        loop.append({"index": index, "scheduled_s": scheduled_s, "started_s": started_s, "sense_s": sense_s, "control_s": control_s,
                     "actuate_s": actuate_s, "overrun": ended_s - scheduled_s > rig.period_s, "written_s": written_s, "ended_s": ended_s,
                     "sticks": sticks, "measured": measured, "state": state, "frames_told": told})
        free_s = ended_s
    # The tracker is heard out, however late it is.
    bench.advance(bench.exposure_s(bench.frame_count))
    return Flown(loop, bench.frames, np.array(pins), np.array(bench.cells))


class Converter:
    """The output: the faults' doing, then the rig's resolution and ends."""

    def __init__(self, rig, faults):
        self.rig, self.faults = rig, [fault for fault in faults if fault.slot == "output"]
        self.step = rig.range / (2**rig.bits - 1) if rig.bits else 0.0
        self.pin = rig.low

    def write(self, session_min, command):
        rig = self.rig
        x = min(max(command, rig.low), rig.high)
        for fault in self.faults:
            x = fault.output(session_min, x, self.pin)
        if self.step:
            x = rig.low + self.step * round((x - rig.low) / self.step)
        self.pin = min(max(x, rig.low), rig.high)
        return self.pin


class Bench:
    """Worlds and camera together: they go on from event to event."""

    def __init__(self, rig, case, faults, worlds, simulator, random, duration_s):
        self.rig, self.case, self.faults, self.worlds, self.simulator, self.random = rig, case, faults, worlds, simulator, random
        self.t_s, self.cells, self.frames = 0.0, [], []
        self.frame_count = int((duration_s + LOOK_ON_S) / rig.frame_s)
        self.first_s = random.uniform(0.0, rig.frame_s)
        # A camera that has run for a while, no one knows how long.
        self.count = int(random.integers(100_000))
        self.last_arrival_s = -1.0
        self.latency_s = max(case.numbers[6] - simulator.MOTOR_S, 0.0)

    def write(self, t_s, pin, tilt):
        """A pin changes; every world hears of it, and its own faults make of it what they do."""
        for world in self.worlds:
            world.edges.append((t_s, pin, tilt))

    def exposure_s(self, frame):
        return self.first_s + frame * self.rig.frame_s

    def advance(self, to_s):
        while self.t_s < to_s - 1e-9:
            due_s = self.exposure_s(len(self.frames)) if len(self.frames) < self.frame_count else math.inf
            events = [due_s, self.t_s + self.simulator.STEP_S, min(world.next_edge_s() for world in self.worlds)]
            # An event that is due now is no end of a step.
            dt_s = max(min([to_s, *(event for event in events if event > self.t_s + EVENT_S)]) - self.t_s, EVENT_S)
            flown, *others = self.worlds
            z_m, v_m_s, load = float(flown.place()[2]), flown.speed(), flown.now.load
            led = [twin.led(flown, dt_s) for twin in others]
            acceleration = flown.step(dt_s)
            self.cells.append((self.t_s, dt_s, z_m, v_m_s, load, acceleration, *led))
            self.t_s += dt_s
            for world in self.worlds:
                world.now.t_s = self.t_s
            if due_s <= self.t_s + EVENT_S:
                self.expose(self.t_s)

    def expose(self, t_s):
        random, rig, flown = self.random, self.rig, self.worlds[0]
        self.count += 1
        place, v_m_s = flown.place(), flown.speed()
        extra_s = sum(fault.frame_late_s(random, self.count, t_s) for fault in self.faults)
        bus_s = BUS_JITTER_S * float(np.clip(random.normal(), -3.0, 3.0))
        # Frames do not overtake one another.
        arrived_s = max(t_s + self.latency_s + extra_s + bus_s, self.last_arrival_s + 1e-4)
        self.last_arrival_s = arrived_s
        # A late frame seems to be of a later time than it is.
        mean_m = place[2]
        for fault in self.faults:
            mean_m = fault.told_m(mean_m, v_m_s, flown.now.load, t_s)
        shift_m = mean_m - place[2] - v_m_s * sum(fault.mean_late_s() for fault in self.faults)
        noise = rig.noise_m * random.normal(size=3)
        z_m = mean_m + noise[2] + sum(fault.noise_m(random, self.count) for fault in self.faults)
        lost = random.random() < rig.dropout_probability
        lost = any([fault.lost(random, self.count) for fault in self.faults]) or lost
        rounded = lambda x: round(x / rig.resolution_m) * rig.resolution_m if rig.resolution_m else x
        position_m = None if lost else [rounded(float(x)) for x in (place[0] + noise[0], place[1] + noise[1], z_m)]
        self.frames.append(Frame(t_s, arrived_s, position_m, float(shift_m)))


