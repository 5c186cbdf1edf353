"""Reads a sealed case as any stranger would: its rig file and its recordings, with nothing of the bench's own code."""

import tomllib
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

G = 9.80665
TOPICS = ["/tracker/position", "/control/command", "/dac/readback", "/loop/tick"]
FOUND = 1
NUMBERS = ["mass", "drag", "gain", "offset", "multiplier", "height", "latency"]


class Rig:
    """What the nominal model knows: seven numbers with one sigma each, and the two ends."""

    def __init__(self, path):
        rig = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        air, track = rig["airframe"], rig["tracker"]
        unit = {"volt": "v", "fraction": "fraction", "count": "count"}[air["actuation"]]
        told = [
            air["mass_kg"], air["drag_n_s_per_m"], air["thrust"][f"gain_n_per_{unit}"], air["thrust"][f"offset_{unit}"],
            air["ground_effect"]["multiplier"], air["ground_effect"]["height_m"], track["latency_s"],
        ]
        pairs = [(x["value"], x["sigma"]) if isinstance(x, dict) else (x, 0.0) for x in told]
        self.numbers = np.array([value for value, _ in pairs])
        # A number without tolerance is held by a very narrow one.
        self.sigma = np.array([sigma or 1e-6 * max(abs(value), 1e-3) for value, sigma in pairs])
        sticks = air["sticks"]
        self.low, self.high = sticks[f"min_{unit}"], sticks[f"max_{unit}"]
        bits = rig["output"]["bits"]
        self.step = (self.high - self.low) / (2**bits - 1) if bits else 0.0
        self.readback_noise = rig["output"]["readback_noise_fraction"] * (self.high - self.low)
        self.noise = float(np.hypot(track["noise_m"], track["resolution_m"] / 12**0.5))
        self.frame = track["frame_period_s"]
        self.lost = track["dropout_probability"]
        self.weight = self.numbers[0] * G
        self.hover = self.numbers[3] + self.weight / self.numbers[2]


class Flight:
    """Times in seconds: frames (exposed as believed, arrived, altitude; lost ones apart), commands, readbacks, ticks."""

    def __init__(self, path):
        rows = {topic: [] for topic in TOPICS}
        with open(path, "rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for _, channel, _, m in reader.iter_decoded_messages(topics=TOPICS):
                if channel.topic == "/tracker/position":
                    row = (m.exposed_at_ns, m.arrived_at_ns, m.position_m.z, m.status)
                elif channel.topic == "/loop/tick":
                    row = (m.started_ns, m.scheduled_ns)
                else:
                    row = (m.time_ns, m.sticks.throttle)
                rows[channel.topic].append(row)
        if not all(rows.values()):
            raise ValueError(f"{path} lacks messages of {[topic for topic, found in rows.items() if not found]}")
        frames, command, readback, ticks = (np.array(rows[topic], dtype=float) for topic in TOPICS)
        found = frames[:, 3] == FOUND
        self.arrived, self.seen = frames[:, 1] / 1e9, found
        self.exposed, self.z = frames[found, 0] / 1e9, frames[found, 2]
        self.command_t, self.command = command[:, 0] / 1e9, command[:, 1]
        self.readback = readback[:, 1]
        self.lateness = (ticks[:, 0] - ticks[:, 1]) / 1e9


def case(folder):
    flights = sorted(Path(folder).glob("flight-*.mcap"), key=lambda path: int(path.stem.split("-")[1]))
    return Rig(Path(folder) / "rig.toml"), [Flight(path) for path in flights]
