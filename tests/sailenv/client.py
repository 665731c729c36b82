# SPDX-License-Identifier: Apache-2.0
"""A client of SAILenv's protocol, written from its description and independent of `tiscene.sailenv.wire_format`."""

import gzip
import io
import json
import socket
import struct

import numpy as np
from PIL import Image

MAIN, CATEGORY, OBJECT, FLOW, DEPTH = 1, 4, 8, 16, 32
ALL = MAIN | CATEGORY | OBJECT | FLOW | DEPTH
FLAGS = {"main": MAIN, "category": CATEGORY, "object": OBJECT, "flow": FLOW, "depth": DEPTH}  # in the order of replies


class Client:
    """One connection.

    Args:
        address: Host and port.
        width: Image width, px.
        height: Image height, px.
        compress: Whether views are compressed.
        send: Sends bytes through a socket; a test may split them.
        timeout: s.
    """

    def __init__(self, address, width=32, height=24, compress=False, send=None, timeout=300.0):
        self.socket = socket.create_connection(address, timeout=timeout)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.send = send or type(self.socket).sendall
        self.width, self.height, self.compress = width, height, compress
        try:
            self.write(struct.pack("<ii?", width, height, compress))
            self.id = self.int()
            self.scenes = self.texts()
        except BaseException:
            self.socket.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def write(self, data):
        self.send(self.socket, data)

    def read(self, count):
        data = b""
        while len(data) < count:
            part = self.socket.recv(count - len(data))
            if not part:
                raise EOFError
            data += part
        return data

    def int(self):
        return struct.unpack("<i", self.read(4))[0]

    def ints(self):
        return struct.unpack("<3i", self.read(12))

    def float(self):
        return struct.unpack("<f", self.read(4))[0]

    def vector(self):
        return struct.unpack("<3f", self.read(12))

    def text(self):
        return self.read(self.int()).decode()

    def texts(self):
        return [self.text() for _ in range(self.int())]

    def ask(self, command, payload=b""):
        self.write(bytes([command]) + payload)

    def request(self, command, payload=b""):
        self.ask(command, payload)
        return self.text()

    def frame(self, flags=ALL):
        self.ask(0x00, bytes([flags]))
        frame = {}
        for name, flag in FLAGS.items():
            if flags & flag:
                data = self.read(self.int())
                frame[name] = self.decoded(name, gzip.decompress(data) if self.compress else data)
        frame["deltaTime"] = self.float()
        return frame

    def decoded(self, name, data):
        shape = (self.height, self.width)
        if name == "category":
            return np.frombuffer(data, np.uint8).reshape(*shape, 3)[::-1, :, 0]
        if name == "flow":
            return np.frombuffer(data, "<f4").reshape(*shape, 2)[::-1]
        return np.asarray(Image.open(io.BytesIO(data)), np.float32) / np.float32(255.0)

    def ask_pixel(self, y, x):
        """Return frame, category, object, questions left and name; or the error."""
        status = self.request(0x40, struct.pack("<ii", y, x))
        return (*(self.int() for _ in range(4)), self.text()) if status == "ok" else status

    def delete(self):
        self.ask(0x01)
        assert self.socket.recv(1) == b""

    def change_scene(self, name):
        return self.request(0x02, text(name))

    def categories(self):
        self.ask(0x03)
        return {self.int(): self.text() for _ in range(self.int())}

    def position(self):
        self.ask(0x04)
        return self.vector()

    def set_position(self, position):
        return self.request(0x05, struct.pack("<3f", *position))

    def rotation(self):
        self.ask(0x06)
        return self.vector()

    def set_rotation(self, rotation):
        return self.request(0x07, struct.pack("<3f", *rotation))

    def toggle_follow(self):
        return self.request(0x08)

    def spawn(self, name, position=(0, 0, 0), rotation=(0, 0, 0), scale=(1, 1, 1), limited=True, dynamic=None):
        payload = text(name) + struct.pack("<6f?3f??", *position, *rotation, True, *scale, True, limited)
        if dynamic is None:
            return self.request(0x09, payload + b"\0")
        return self.request(0x09, payload + b"\1" + text(dynamic.get_type()) + text(json.dumps(dynamic.asdict())))

    def despawn(self, id):
        return self.request(0x0A, struct.pack("<i", int(id)))

    def spawnables(self):
        self.ask(0x0B)
        return self.texts()

    def send_obj_zip(self, name, data):
        return self.request(0x0C, text(name) + struct.pack("<i", len(data)) + data)

    def clear_flags(self, *color):
        return self.request(0x0D, struct.pack("<3i", *color))

    def light(self, command, name, kind):
        status = self.request(command, text(name))
        return getattr(self, kind)() if status == "ok" else status

    def set_light(self, command, name, form, *values):
        return self.request(command, text(name) + struct.pack(form, *values))

    def light_type(self, name):
        return self.request(0x18, text(name))

    def light_names(self):
        self.ask(0x19)
        return self.texts()

    def ambient(self):
        assert self.request(0x1A) == "ok"
        return self.ints()

    def set_ambient(self, *color):
        return self.request(0x1B, struct.pack("<3i", *color))

    def spawn_view_frustum(self):
        self.ask(0x1C)

    def load_scenario(self, scenario):
        """Return the ids, after the queries that SAILenv's own client sends next."""
        self.ask(0x1D, text(json.dumps(scenario.asdict())))
        ids = [self.text() for _ in scenario.objects]
        self.categories(), self.spawnables(), self.light_names()
        return ids

    def move(self, id, position, rotation=(0, 0, 0)):
        return self.request(0x1E, struct.pack("<i6f", int(id), *position, *rotation))


def text(value):
    data = value.encode()
    return struct.pack("<i", len(data)) + data
