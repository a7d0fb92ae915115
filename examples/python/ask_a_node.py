#!/usr/bin/env python3
"""Asks a camera node directly, as the coordinator does: is it well, which samples of a cube are inside the person by its
cameras, where is the nearest edge, and where does the way out along the edge's normal leave?

    pip install -r examples/python/requirements.txt
    python3 examples/python/ask_a_node.py --address 192.168.7.11:7345 \\
        --certs /etc/hulltouch/certs --name left.node.room-a.hulltouch

Without --certs it speaks in clear text. It leads the node while it runs: a node that a coordinator leads refuses it. The
numbers are packed as docs/wire.md says.
"""

import argparse
import importlib
import pathlib
import queue
import random
import sys
import tempfile
import time

import blake3
import grpc
import lz4.block
import numpy as np
from grpc_health.v1 import health_pb2, health_pb2_grpc
from grpc_tools import protoc

PROTO = pathlib.Path(__file__).resolve().parents[2] / "proto" / "proto"
SERVICE = "hulltouch.v1.CameraNode"


def generated(folder):
    """The protocol's modules, generated into a folder."""
    arguments = ["protoc", f"-I{PROTO}", f"--python_out={folder}", f"--grpc_python_out={folder}"]
    if protoc.main([*arguments, "hulltouch/v1/node.proto"]) != 0:
        sys.exit(f"no client can be generated from {PROTO}/hulltouch/v1/node.proto")
    sys.path.insert(0, folder)
    module = "hulltouch.v1.node_pb2"
    return importlib.import_module(module), importlib.import_module(f"{module}_grpc")


def channel(address, certs, name):
    """A channel; with certificates, to the very node of that name, whatever its address."""
    if certs is None:
        return grpc.insecure_channel(address)
    folder = pathlib.Path(certs)
    authority, key, certificate = (
        (folder / file).read_bytes() for file in ("ca.crt", "tls.key", "tls.crt")
    )
    return grpc.secure_channel(
        address,
        grpc.ssl_channel_credentials(authority, key, certificate),
        [("grpc.ssl_target_name_override", name)],
    )


def numbers(data):
    """LEB128."""
    value = shift = 0
    for byte in data:
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            yield value
            value = shift = 0


def chosen(choice, count):
    """Which of so many things a choice takes."""
    tag, data = choice[0], choice[1:]
    if tag in (1, 3):
        # What is packed is never longer than a bit a thing.
        data = lz4.block.decompress(data, uncompressed_size=(count + 7) // 8)
    if tag in (0, 1):
        return np.flatnonzero(np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")[:count])
    taken, at, runs = [], 0, numbers(data)
    for left_out in runs:
        start = at + left_out
        at = start + next(runs)
        taken.append(np.arange(start, at))
    return np.concatenate(taken) if taken else np.empty(0, int)


def all_of(count):
    """The choice of all things: a run of none that are left out, and one of all."""
    data = bytearray([2, 0])
    while count >= 0x80:
        data.append(count & 0x7F | 0x80)
        count >>= 7
    return bytes(data + bytes([count]))


def cube(edge_m, a_side):
    """Samples all through a cube, body frame, float32 x 3."""
    line = np.linspace(-edge_m / 2, edge_m / 2, a_side, dtype="<f4")
    return np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3)


class Node:
    """A node that this program leads."""

    def __init__(self, messages, stub):
        self.messages, self.stub = messages, stub
        self.holder = random.getrandbits(63) + 1
        self.questions = queue.SimpleQueue()
        self.credits = queue.SimpleQueue()

    def lead(self):
        described = self.stub.Describe(self.messages.DescribeRequest())
        self.stub.Hold(
            self.messages.HoldRequest(holder=self.holder, term=described.term, name="ask_a_node.py")
        )
        return described

    def credit(self, up_to_frame, in_use=None):
        """Lets film go on up to a frame."""
        credit = self.messages.FrameCredit(up_to_frame=up_to_frame, in_use=in_use, holder=self.holder)
        self.credits.put(credit)

    def film(self):
        """The number of the first frame."""
        frames = self.stub.WatchFrames(iter(self.credits.get, None))
        self.credit(0)
        now = self.stub.KeepTime(self.messages.KeepTimeRequest(holder=self.holder))
        clock = self.messages.ClockLine(node_s=now.node_s, film_s=0, rate=1, bound_s=0.01)
        self.stub.Start(
            self.messages.StartRequest(
                epoch_unix_s=time.time(), lock_step=True, run=self.holder, holder=self.holder, clock=clock
            )
        )
        for info in frames:
            if info.failure:
                sys.exit(f"film failed: {info.failure}")
            if info.cameras:
                # The one that is in use stays.
                self.credit(info.frame, in_use=info.frame)
                return info.frame

    def register(self, samples):
        """Registers a shape; its key."""
        digest = blake3.blake3(b"hulltouch shape 1" + samples.tobytes()).digest()
        shape = self.messages.Shape(digest=digest, samples=samples.tobytes())
        self.stub.RegisterShapes(self.messages.RegisterShapesRequest(shapes=[shape], holder=self.holder))
        return digest[:8]

    def ask(self, replies, **question):
        self.questions.put(self.messages.ProbeRequest(holder=self.holder, **question))
        reply = next(replies)
        if reply.WhichOneof("answer") == "refusal":
            sys.exit(f"the node refuses: {reply.refusal.message}")
        return getattr(reply, reply.WhichOneof("answer"))

    def one_pass(self, frame, key, at_m, count):
        """Classes, edges and exits of a registered body: its samples inside, depths and ways out in metres."""
        kinds = self.messages.ProbeRequest.Kind
        replies = self.stub.Probe(iter(self.questions.get, None))
        pose = np.array([*at_m, 0, 0, 0, 1], "<f8").tobytes()
        bodies = self.messages.Bodies(shapes=b"\0" + key, poses=pose)
        classes = self.ask(replies, id=1, frame=frame, kind=kinds.Value("CLASSES"), bodies=bodies)
        inside = chosen(classes.not_outside, count)
        depths, ways = np.empty(0), np.empty(0)
        if len(inside):
            # What is not outside is kept, and all of that is asked about.
            points = self.messages.Points(kept=classes.not_outside, picked=all_of(len(inside)))
            edges = self.ask(replies, id=2, frame=frame, kind=kinds.Value("EDGES"), points=points)
            depths = np.frombuffer(edges.distances, "<f4")
            if len(depths):
                points = self.messages.Points(picked=edges.present)
                exits = self.ask(
                    replies,
                    id=3,
                    frame=frame,
                    kind=kinds.Value("EXITS"),
                    points=points,
                    directions=edges.normals,
                )
                ways = np.frombuffer(exits.outside, "<f4")
        self.questions.put(None)
        self.credits.put(None)
        return inside, depths, ways


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--address", required=True, metavar="HOST:PORT")
    parser.add_argument("--certs", metavar="FOLDER", help="ca.crt, tls.crt and tls.key of a coordinator")
    parser.add_argument("--name", help="the node's certificate: NODE.node.ROOM.hulltouch")
    parser.add_argument("--at", nargs=3, type=float, default=[0.0, 1.0, 0.0], metavar=("X", "Y", "Z"))
    parser.add_argument("--edge", type=float, default=0.5, help="of the cube, metres")
    options = parser.parse_args()
    if options.certs and not options.name:
        parser.error("--certs needs --name")
    with tempfile.TemporaryDirectory() as folder, channel(options.address, options.certs, options.name) as wire:
        messages, services = generated(folder)
        try:
            health = health_pb2_grpc.HealthStub(wire).Check(health_pb2.HealthCheckRequest(service=SERVICE))
            print(f"health: {health_pb2.HealthCheckResponse.ServingStatus.Name(health.status)}")
            node = Node(messages, services.CameraNodeStub(wire))
            described = node.lead()
            print(f"version {described.version}: {', '.join(camera.name for camera in described.cameras)}")
            samples = cube(options.edge, 11)
            frame, key = node.film(), node.register(samples)
            inside, depths, ways = node.one_pass(frame, key, options.at, len(samples))
        except grpc.RpcError as error:
            sys.exit(f"{options.address}: {error.code().name}: {error.details()}")
        print(f"frame {frame}: {len(inside)} of {len(samples)} samples inside")
        if len(depths):
            print(f"deepest {1e3 * depths.max():.1f} mm; {len(ways)} leave, at most after {1e3 * ways.max():.1f} mm")


if __name__ == "__main__":
    main()
