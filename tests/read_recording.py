"""Reads a recording with the independent `mcap` package and its embedded schemas; prints messages per topic as JSON."""

import json
import sys
from collections import Counter

from mcap_protobuf.reader import read_protobuf_messages

counts: Counter = Counter()
with open(sys.argv[1], "rb") as stream:
    for message in read_protobuf_messages(stream):
        topic = message.topic.strip("/").split("/")
        kind = next(part for part in topic if not part.startswith("dreamstream") and part not in ("v1",))
        assert message.proto_msg.header.episode, message.topic
        counts[kind] += 1
print(json.dumps(counts))
