"""What viewers make of a recording: Foxglove's schemas decode it, and Rerun loads it. Prints what they see, as JSON.

usage: python_viewers.py RECORDING FOLDER SCRIPT
needs: pip install mcap mcap-protobuf-support foxglove-sdk rerun-sdk
"""

import collections
import json
import pathlib
import re
import subprocess
import sys

from foxglove import messages
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.json_format import MessageToDict
from mcap.reader import make_reader


def foxglove_class(name):
    """The message class of the SDK's own schema, which knows nothing of the recording's."""
    schema = getattr(messages, name).get_schema()
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def by_foxglove(path):
    """The first message of each channel in Foxglove's schemas, how many there are, and fields that the SDK does not know."""
    first, counts, unknown, classes = {}, collections.Counter(), [], {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            package, _, name = schema.name.partition(".")
            if package != "foxglove":
                continue
            counts[channel.topic] += 1
            decoded = classes.setdefault(name, foxglove_class(name)).FromString(message.data)
            # What is not in the SDK's schema is kept on reading; without it the message is shorter.
            whole = decoded.ByteSize()
            decoded.DiscardUnknownFields()
            if decoded.ByteSize() != whole:
                unknown.append(channel.topic)
            if channel.topic not in first:
                fields = MessageToDict(decoded, preserving_proto_field_name=True)
                first[channel.topic] = {"schema": schema.name, "log_time": message.log_time, "fields": fields}
    return {"first": first, "counts": counts, "unknown": unknown}


RERUN = pathlib.Path(sys.executable).with_name("rerun")


def by_rerun(path, folder):
    """What Rerun's own reader makes of it."""
    converted = pathlib.Path(folder) / "recording.rrd"
    subprocess.run([RERUN, "mcap", "convert", path, "-o", converted], check=True, capture_output=True)
    return rows_of(converted)


def by_script(path, folder, script):
    """The same by the script that brings its own layout."""
    saved = pathlib.Path(folder) / "script.rrd"
    subprocess.run([sys.executable, script, path, "--save", saved], check=True, capture_output=True)
    return rows_of(saved)


def rows_of(rrd):
    """The components that Rerun has of each entity, and in how many rows, by its own dump."""
    printed = subprocess.run([RERUN, "rrd", "print", rrd], check=True, capture_output=True, text=True).stdout
    rows = collections.defaultdict(collections.Counter)
    for count, entity, columns in re.findall(r"with (\d+) rows .*? - (/\S+) - .*?data columns: \[(.*?)\]", printed):
        for column in columns.split():
            rows[entity][column] += int(count)
    return rows


recording, folder, script = sys.argv[1:]
seen = {"foxglove": by_foxglove(recording), "rerun": by_rerun(recording, folder), "script": by_script(recording, folder, script)}
json.dump(seen, sys.stdout)
