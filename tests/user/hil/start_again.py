"""Sits at the live page of a lab whose marker is hidden: presses START, uncovers the marker once the page says that it was not seen, presses
START again, and ends the bench after the flight. Prints the warning and what the flight came to.

usage: start_again.py WORDS HIDDEN    (what the bench says, and the file that hides the marker)
"""

import base64
import json
import os
import re
import socket
import struct
import sys
import time
from pathlib import Path

TEXT, PING, PONG, CLOSE = 1, 9, 10, 8


def main():
    words, hidden = map(Path, sys.argv[1:])
    while not (page := re.search(r"live page: http://([\d.]+):(\d+)/#(\w+)\n", words.read_text() if words.exists() else "")):
        time.sleep(0.1)
    host, port, token = page.groups()
    stream = socket.create_connection((host, int(port))).makefile("rwb")
    key = base64.b64encode(os.urandom(16)).decode()
    stream.write((
        f"GET /live HTTP/1.1\r\nHost: {host}:{port}\r\nOrigin: http://{host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n"
    ).encode())
    stream.flush()
    while stream.readline().strip():
        pass
    say(stream, {"token": token})
    pressed = 0
    for message in messages(stream):
        stage, warning = message.get("stage"), message.get("warning")
        if stage == "waiting" and pressed == 0:
            say(stream, {"command": "start"})
            pressed = 1
        elif stage == "waiting" and pressed == 1 and warning:
            print(warning, flush=True)
            hidden.unlink()
            say(stream, {"command": "start"})
            pressed = 2
        elif stage == "landed":
            print(message["headline"], flush=True)
            say(stream, {"command": "end"})
            return


def say(stream, value):
    send(stream, TEXT, json.dumps(value).encode())


def send(stream, kind, data):
    """A frame of a client: short, and masked, with zeros."""
    stream.write(bytes([0x80 | kind, 0x80 | len(data)]) + bytes(4) + data)
    stream.flush()


def messages(stream):
    """The texts that the bench sends, as JSON."""
    while head := stream.read(2):
        kind, length = head[0] & 15, head[1]
        if length > 125:
            length = struct.unpack(*((">H", stream.read(2)) if length == 126 else (">Q", stream.read(8))))[0]
        data = stream.read(length)
        if kind == PING:
            send(stream, PONG, data)
        elif kind == CLOSE:
            return
        elif kind == TEXT:
            yield json.loads(data)


main()
