#!/usr/bin/env python3
"""Follows a run over gRPC, drops a ball into it, and kicks the ball up whenever it has come to rest.

    pip install -r examples/python/requirements.txt
    HULLTOUCH_TOKEN=my-own-token hulltouch demo &
    python3 examples/python/follow_and_push.py --token my-own-token

Without a token it only follows. The client's code is generated from the .proto when the program starts, so there
is nothing to build.
"""

import argparse
import importlib
import math
import pathlib
import sys
import tempfile

import grpc
from grpc_tools import protoc

PROTO = pathlib.Path(__file__).resolve().parents[2] / "proto" / "proto"


def generated(folder):
    """The protocol's modules, generated into a folder."""
    arguments = ["protoc", f"-I{PROTO}", f"--python_out={folder}", f"--grpc_python_out={folder}"]
    if protoc.main([*arguments, "hulltouch/v1/world.proto"]) != 0:
        sys.exit(f"no client can be generated from {PROTO}/hulltouch/v1/world.proto")
    sys.path.insert(0, folder)
    module = "hulltouch.v1.world_pb2"
    return importlib.import_module(module), importlib.import_module(f"{module}_grpc")


def length(vector):
    return math.sqrt(vector.x**2 + vector.y**2 + vector.z**2)


def follow(world, messages, token, seconds, rate_hz):
    """Prints where the ball is, and kicks it; returns how many states came and how many kicks were given."""
    steers = [("authorization", f"Bearer {token}")] if token else []
    description = world.Describe(messages.DescribeWorldRequest(), metadata=steers)
    names = {body.id: body.name for body in description.bodies}
    print(f"scene {description.scene}: {', '.join(names.values())}")
    ball = None
    if token:
        ball = world.Spawn(
            messages.SpawnRequest(
                shape=messages.BodyShape(ball=messages.BodyShape.Ball(radius=0.1)),
                position=messages.Vector(x=0.6, y=1.5, z=0.6),
                mass=0.5,
                restitution=0.6,
            ),
            metadata=steers,
        ).body
        print(f"the ball is body {ball}")
    states = kicks = 0
    first_s = None
    for state in world.Follow(messages.FollowRequest(rate_hz=rate_hz)):
        states += 1
        first_s = state.film_s if first_s is None else first_s
        for body in state.bodies:
            if body.inside_samples:
                print(f"{state.film_s:7.2f} s  {names.get(body.id, body.id)} touches the person")
            if body.id == ball and length(body.velocity) < 0.05 and body.position.y < 0.2:
                # 0.5 kg get 4 m/s.
                impulse = messages.Vector(x=0.0, y=2.0, z=0.0)
                world.Push(messages.PushRequest(body=ball, impulse=impulse), metadata=steers)
                kicks += 1
                print(f"{state.film_s:7.2f} s  kicked the ball at {body.position.x:.2f} {body.position.z:.2f}")
        if state.film_s - first_s >= seconds:
            break
    return states, kicks


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--address", default="127.0.0.1:8470", help="where the run's page is [%(default)s]")
    parser.add_argument("--token", help="the run's token: with it the ball is spawned and kicked")
    parser.add_argument("--seconds", type=float, default=20.0, help="of film [%(default)s]")
    parser.add_argument("--rate", type=float, default=20.0, help="states a second [%(default)s]")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, grpc.insecure_channel(arguments.address) as channel:
        messages, services = generated(folder)
        world = services.WorldStub(channel)
        try:
            states, kicks = follow(world, messages, arguments.token, arguments.seconds, arguments.rate)
        except grpc.RpcError as error:
            sys.exit(f"{arguments.address}: {error.details()}")
    print(f"{states} states, {kicks} kicks")


if __name__ == "__main__":
    main()
