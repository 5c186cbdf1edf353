"""What the reference readers say of a log, as JSON: {"topics": {name: [{field: value}]}, "parameters": {name: value}}.

    python_logs.py ulog LOG [REWRITTEN]   by pyulog, which may also write the log anew
    python_logs.py dataflash LOG          by pymavlink
    python_logs.py blackbox LOG           by orangebox
    python_logs.py bag FOLDER             by rosbags, which writes the bag first
"""

import dataclasses
import json
import sys

import numpy

# As long as lists are looked at.
LISTED = 8


def plain(value):
    """A number or a text that JSON has; NaN and infinities as texts."""
    if isinstance(value, bytes):
        return value.split(b"\0")[0].decode()
    if isinstance(value, numpy.generic):
        value = value.item()
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float) and not numpy.isfinite(value):
        return "NaN" if numpy.isnan(value) else "inf" if value > 0 else "-inf"
    return value


def ulog(path, rewritten=None):
    from pyulog import ULog

    log = ULog(path)
    topics = {}
    for data in log.data_list:
        name = data.name if data.multi_id == 0 else f"{data.name}[{data.multi_id}]"
        # What fills up a message says nothing, and not every reader hands it over.
        fields = {field: column for field, column in data.data.items() if "_padding" not in field}
        rows = len(data.data["timestamp"])
        topics[name] = [{field: plain(column[row]) for field, column in fields.items()} for row in range(rows)]
    if rewritten is not None:
        log.write_ulog(rewritten)
    return {
        "topics": topics,
        "parameters": {name: plain(value) for name, value in log.initial_parameters.items()},
        "dropouts": len(log.dropouts),
    }


def dataflash(path):
    from pymavlink import DFReader

    log = DFReader.DFReader_binary(path)
    topics, parameters = {}, {}
    while (message := log.recv_msg()) is not None:
        kind = message.get_type()
        if kind == "PARM":
            parameters[message.Name] = plain(message.Value)
        instance = getattr(message.fmt, "instance_field", None)
        number = getattr(message, instance) if instance else 0
        name = kind if number == 0 else f"{kind}[{number}]"
        row = {field: plain(getattr(message, field)) for field in message.get_fieldnames()}
        topics.setdefault(name, []).append(row)
    return {"topics": topics, "parameters": parameters}


def blackbox(path):
    from orangebox import Parser
    from orangebox.types import FrameType

    parser = Parser.load(path)
    fields = parser.field_names
    of_main = len(parser.reader.field_defs[FrameType.INTRA])
    main, slow = [], []
    for frame in parser.frames():
        main.append(dict(zip(fields[:of_main], frame.data)))
        # Each main frame has the last slow one behind it.
        row = dict(zip(fields[of_main:], frame.data[of_main:]))
        if "" not in row.values() and slow[-1:] != [row]:
            slow.append(row)
    return {"topics": {"main": main, "slow": slow}, "parameters": {}}


def flat(message, before, row):
    for field in dataclasses.fields(message):
        # Constants of the type are written in capitals.
        if field.name == "__msgtype__" or field.name.isupper():
            continue
        name, value = before + field.name, getattr(message, field.name)
        if dataclasses.is_dataclass(value) and value.__msgtype__ == "builtin_interfaces/msg/Time":
            row[name] = value.sec * 1_000_000_000 + value.nanosec
        elif dataclasses.is_dataclass(value):
            flat(value, name + ".", row)
        elif isinstance(value, (list, numpy.ndarray)):
            # Arrays of fixed length are looked at whole.
            most = 64 if len(value) in (9, 36) else LISTED
            for place, element in enumerate(value[:most]):
                if dataclasses.is_dataclass(element):
                    flat(element, f"{name}[{place}].", row)
                else:
                    row[f"{name}[{place}]"] = plain(element)
        else:
            row[name] = plain(value)


def bag(folder):
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    one = lambda name, **fields: kinds[name](**fields)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            "/pose": "geometry_msgs/msg/PoseStamped",
            "/odom": "nav_msgs/msg/Odometry",
            "/battery": "sensor_msgs/msg/BatteryState",
            "/imu": "sensor_msgs/msg/Imu",
        }
        connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()}
        for k in range(20):
            stamp = one("builtin_interfaces/msg/Time", sec=1_750_000_000 + k, nanosec=5 * k)
            # Texts of different lengths move what stands behind them.
            header = one("std_msgs/msg/Header", stamp=stamp, frame_id="m" * k)
            point = one("geometry_msgs/msg/Point", x=0.1 * k, y=-1.5, z=1e-3 * k)
            turn = one("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.6, w=0.8)
            vector = one("geometry_msgs/msg/Vector3", x=1.0, y=2.0, z=-9.8)
            pose = one("geometry_msgs/msg/Pose", position=point, orientation=turn)
            messages = {
                "/pose": one("geometry_msgs/msg/PoseStamped", header=header, pose=pose),
                "/odom": one(
                    "nav_msgs/msg/Odometry",
                    header=header,
                    child_frame_id="base" + "_" * (k % 5),
                    pose=one("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=numpy.arange(36.0)),
                    twist=one(
                        "geometry_msgs/msg/TwistWithCovariance",
                        twist=one("geometry_msgs/msg/Twist", linear=vector, angular=vector),
                        covariance=numpy.arange(36.0) + k,
                    ),
                ),
                "/battery": one(
                    "sensor_msgs/msg/BatteryState",
                    header=header,
                    voltage=3.7,
                    temperature=float("nan"),
                    current=-1.25,
                    charge=0.5,
                    capacity=1.0,
                    design_capacity=1.0,
                    percentage=0.5,
                    power_supply_status=2,
                    power_supply_health=1,
                    power_supply_technology=3,
                    present=True,
                    cell_voltage=numpy.array([3.7] * (k % 4), dtype=numpy.float32),
                    cell_temperature=numpy.array([], dtype=numpy.float32),
                    location="slot",
                    serial_number="7" * (k % 3),
                ),
                "/imu": one(
                    "sensor_msgs/msg/Imu",
                    header=header,
                    orientation=turn,
                    orientation_covariance=numpy.arange(9.0),
                    angular_velocity=vector,
                    angular_velocity_covariance=numpy.arange(9.0),
                    linear_acceleration=vector,
                    linear_acceleration_covariance=numpy.arange(9.0),
                ),
            }
            for topic, message in messages.items():
                raw = store.serialize_cdr(message, topics[topic])
                writer.write(connections[topic], 1_750_000_000_000_000_000 + 10_000_000 * k, raw)
    read = {}
    with Reader(folder) as reader:
        for connection, _, raw in reader.messages():
            row = {}
            flat(store.deserialize_cdr(raw, connection.msgtype), "", row)
            read.setdefault(connection.topic, []).append(row)
    return {"topics": read, "parameters": {}}


if __name__ == "__main__":
    what, *names = sys.argv[1:]
    json.dump({"ulog": ulog, "dataflash": dataflash, "blackbox": blackbox, "bag": bag}[what](*names), sys.stdout)
