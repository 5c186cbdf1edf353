"""Reads a recording with the public MCAP and protobuf packages and prints what they see, as JSON.

usage: python_reader.py RECORDING
needs: pip install mcap mcap-protobuf-support
"""

import json
import sys

from google.protobuf.json_format import MessageToDict
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def main(path):
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        messages = {}
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            fields = MessageToDict(decoded, preserving_proto_field_name=True,
                                   always_print_fields_with_no_presence=True)
            messages.setdefault(channel.topic, []).append([message.log_time, fields])
        statistics = reader.get_summary().statistics
        json.dump({
            "message_count": statistics.message_count,
            "attachments": {a.name: a.data.decode() for a in reader.iter_attachments()},
            "metadata": {m.name: m.metadata for m in reader.iter_metadata()},
            "messages": messages,
        }, sys.stdout)


main(sys.argv[1])
