"""Reads a recording with the mcap package and the descriptions in the file alone; prints what it found as JSON.

    recording.py FILE          through the index at its end
    recording.py FILE --stream from its beginning, however it ends
"""

import json
import sys

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader


def message_class(schema):
    """The class of a schema's messages, made of nothing but the schema."""
    descriptors = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in descriptors.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def numbers(data):
    """LEB128."""
    value = shift = 0
    for byte in data:
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            yield value
            value = shift = 0


def area(silhouette):
    """Foreground pixels; every run lies on the image."""
    found, runs = 0, numbers(silhouette.runs)
    for _ in range(silhouette.height):
        after = 0
        for index in range(next(runs)):
            start = after + next(runs) + (index > 0)
            after = start + next(runs) + 1
            assert after <= silhouette.width, "a run leaves the image"
            found += after - start
    assert next(runs, None) is None, "bytes are left over"
    return found


def read(messages):
    classes, found = {}, {"channels": {}, "area": 0, "frames": 0, "digest": None, "inside_samples": 0}
    frames, before_ns = set(), 0
    try:
        for schema, channel, message in messages:
            assert schema.encoding == "protobuf" and channel.message_encoding == "protobuf"
            if schema.id not in classes:
                classes[schema.id] = message_class(schema)
            decoded = classes[schema.id].FromString(message.data)
            found["channels"][channel.topic] = found["channels"].get(channel.topic, 0) + 1
            if schema.name.endswith(".Silhouette"):
                found["area"] += area(decoded)
                frames.add(decoded.frame)
            elif schema.name.endswith(".Step"):
                assert message.log_time > before_ns, "steps are in order"
                before_ns = message.log_time
                found["digest"] = decoded.digest
                found["inside_samples"] += sum(response.inside_samples for response in decoded.responses)
            elif schema.name.endswith(".Header"):
                found["scene"] = decoded.scene.name
                found["cameras"] = decoded.rig_toml.count("name =")
    except EndOfFile:
        found["cut_off"] = True
    found["frames"] = len(frames)
    return found


def main():
    with open(sys.argv[1], "rb") as file:
        if "--stream" in sys.argv:
            reader = NonSeekingReader(file)
            messages = reader.iter_messages(log_time_order=False)
        else:
            reader = make_reader(file, validate_crcs=True)
            messages = reader.iter_messages()
        print(json.dumps(read(messages)))


main()
