"""A client of Foxglove's WebSocket protocol by its public specification: subscribes to all channels, prints what came.

view_client.py ws://HOST:PORT

Prints "subscribed", then "daemon STATE" at each change of the state of rivetd, and at the end of its input one JSON object.
"""

import json
import struct
import sys
import threading

from websockets.sync.client import connect

# Messages that are kept of a topic.
KEPT = 200


def bits(values):
    """Each number as the 64 bits of its double, in hexadecimal."""
    return [struct.pack(">d", float(value)).hex() for value in values]


def check(schema):
    """Fails where Foxglove's parser of JSON Schema would: each place has one type, and nothing refers to another place."""
    kind = schema["type"]
    if kind == "object":
        for field in schema["properties"].values():
            check(field)
    elif kind == "array":
        check(schema["items"])
    else:
        assert kind in ("boolean", "string", "number", "integer"), schema


def main():
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    with connect(sys.argv[1], subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        info = json.loads(socket.recv())
        assert info["op"] == "serverInfo", info
        advertised = json.loads(socket.recv())
        assert advertised["op"] == "advertise", advertised
        channels = advertised["channels"]
        for channel in channels:
            schema = json.loads(channel["schema"])
            assert channel["schemaEncoding"] == "jsonschema" and schema["type"] == "object", channel
            check(schema)
        # Ids of subscriptions are the client's: not those of the channels.
        topics = {100 + channel["id"]: channel["topic"] for channel in channels}
        wanted = [{"id": 100 + channel["id"], "channelId": channel["id"]} for channel in channels]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        print("subscribed", flush=True)

        states, sets, messages, daemon = {}, {}, {}, None
        while not over.is_set():
            try:
                data = socket.recv(timeout=0.1)
            except TimeoutError:
                continue
            assert isinstance(data, bytes), data
            opcode, subscription, time_ns = struct.unpack_from("<BIQ", data)
            assert opcode == 1 and time_ns > 1_600_000_000_000_000_000, (opcode, time_ns)
            topic, message = topics[subscription], json.loads(data[13:])
            kept = messages.setdefault(topic, [])
            kept.append(message)
            del kept[:-KEPT]
            kind = topic.rsplit("/", 1)[1]
            if kind == "joint-state":
                states[message["seq"]] = bits(message["q"] + message["tau"])
            elif kind == "parameters":
                sets[message["epoch"]] = bits(message["values"] + message["std"])
            elif kind == "state" and message["daemon"] != daemon:
                daemon = message["daemon"]
                print("daemon", daemon, flush=True)
        result = {"subprotocol": socket.subprotocol, "info": info, "channels": channels, "joint_states": states,
                  "parameters": sets, "messages": messages}
    print(json.dumps(result), flush=True)


main()
