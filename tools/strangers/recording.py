"""Writes a flight as a recording of the bench: channels, messages and session as a recording that the program itself made has them."""

import io

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from flight import FOUND, LOST
from rig import Rig

TOPICS = {"/tracker/position": "Position", "/control/state": "ControlState", "/control/command": "Command", "/dac/readback": "Readback", "/loop/tick": "Tick"}


class Template:
    """What a simulated flight of the bench has that is the same for every flight of its rig and mission: schemas, rig, mission, session."""

    def __init__(self, path):
        self.path = path
        with open(path, "rb") as file:
            reader = make_reader(file)
            self.header, summary = reader.get_header(), reader.get_summary()
            self.metadata = {item.name: dict(item.metadata) for item in reader.iter_metadata()}
            self.attachments = {item.name: item for item in reader.iter_attachments()}
        # A seal tells no seed, and neither does a session that had none.
        self.metadata["bench"].pop("seed", None)
        self.rig_toml = self.attachments["rig.toml"].data.decode()
        self.mission_toml = self.attachments["mission.toml"].data.decode()
        self.rig = Rig(self.rig_toml)
        self.schemas, self.messages = {}, {}
        for channel in summary.channels.values():
            if channel.topic in TOPICS:
                schema = summary.schemas[channel.schema_id]
                self.schemas[channel.topic] = schema
                self.messages[channel.topic] = message_class(schema)

    def __reduce__(self):
        # Classes of messages are made while the program runs and cannot be handed to another process.
        return Template, (self.path,)

    def write(self, path, records, filling=""):
        """Writes records (topic, log time [ns], publish time [ns], message) and returns how long the file is, bytes."""
        stream = io.BytesIO()
        writer = Writer(stream, compression=CompressionType.ZSTD, chunk_size=1 << 22)
        writer.start(profile=self.header.profile, library=self.header.library)
        for name, item in self.attachments.items():
            data = (self.mission_toml + filling).encode() if name == "mission.toml" else item.data
            writer.add_attachment(create_time=0, log_time=0, name=name, media_type=item.media_type, data=data)
        for name in ("bench", "bench.extra"):
            writer.add_metadata(name, self.metadata[name])
        channels = {}
        for topic in TOPICS:
            schema = self.schemas[topic]
            schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[topic] = writer.register_channel(topic, "protobuf", schema_id)
        sequence = dict.fromkeys(TOPICS, 0)
        for topic, log_ns, publish_ns, message in records:
            writer.add_message(channels[topic], log_time=log_ns, data=message.SerializeToString(deterministic=True), publish_time=publish_ns, sequence=sequence[topic])
            sequence[topic] += 1
        writer.add_metadata("bench.end", self.metadata["bench.end"])
        writer.finish()
        path.write_bytes(stream.getvalue())
        return len(stream.getvalue())


def message_class(schema):
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def ns(seconds):
    return max(0, round(1e9 * seconds))


def records(template, flown):
    """A flight's records in the order in which a bench would have made them."""
    made, told = [], 0
    latency_s = template.rig.numbers[6]

    def frame(f):
        message = template.messages["/tracker/position"](exposed_at_ns=ns(f.arrived_s - latency_s), arrived_at_ns=ns(f.arrived_s), status=FOUND if f.position_m else LOST)
        fill(message.position_m, f.position_m or (0.0, 0.0, 0.0))
        message.pixel.SetInParent()
        made.append(("/tracker/position", message.arrived_at_ns, message.exposed_at_ns, message))

    def add(topic, time_s, message):
        made.append((topic, ns(time_s), ns(time_s), message))

    for turn in flown.loop:
        while told < turn["frames_told"]:
            frame(flown.frames[told])
            told += 1
        own = turn["state"]
        state = template.messages["/control/state"](
            time_ns=ns(turn["started_s"]), phase=own["phase"], vertical_speed_setpoint_m_s=own.get("wanted_m_s", 0.0), vertical_speed_error_m_s=own.get("error_m_s", 0.0),
            integral_n=own["integral_n"], thrust_n=own.get("thrust_n", 0.0))
        fill(state.setpoint_m, (0.0, 0.0, own.get("setpoint_z_m", 0.0)))
        fill(state.estimate_m, own["estimate_m"])
        fill(state.estimate_m_s, own["estimate_m_s"])
        add("/control/state", turn["started_s"], state)
        command = template.messages["/control/command"](time_ns=ns(turn["written_s"]))
        stick(command.sticks, turn["sticks"])
        add("/control/command", turn["written_s"], command)
        readback = template.messages["/dac/readback"](time_ns=ns(turn["ended_s"]), device_time_ns=ns(turn["ended_s"]))
        stick(readback.sticks, turn["measured"])
        readback.faults.SetInParent()
        add("/dac/readback", turn["ended_s"], readback)
        add("/loop/tick", turn["started_s"], template.messages["/loop/tick"](
            index=turn["index"], scheduled_ns=ns(turn["scheduled_s"]), started_ns=ns(turn["started_s"]), lateness_s=turn["started_s"] - turn["scheduled_s"],
            sense_s=turn["sense_s"], control_s=turn["control_s"], actuate_s=turn["actuate_s"], overrun=turn["overrun"]))
    for left in flown.frames[told:]:
        frame(left)
    return made


def fill(vector, values):
    vector.SetInParent()
    vector.x, vector.y, vector.z = (float(x) for x in values)


def stick(sticks, values):
    sticks.throttle, sticks.pitch, sticks.roll, sticks.yaw = (float(x) for x in values)
