"""Connects to a policy bus as a stranger: listens to everything, asks for everything, writes to foreign keys.

Prints what it received as JSON once its standard input is closed.
"""

import json
import sys
import threading

import zenoh

endpoint = sys.argv[1]
config = zenoh.Config()
config.insert_json5("mode", json.dumps("client"))
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("scouting/multicast/enabled", "false")
received = []
done = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), done.set()), daemon=True).start()

session = None
while session is None and not done.is_set():
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        done.wait(0.05)

if session is not None:
    print("connected", file=sys.stderr, flush=True)
    keys = ["**", "dreamstream/**", "dreamstream-policy/**", "dreamstream-policy/v1/other/*/observation", "dreamstream/v1/*/world"]
    subscribers = [session.declare_subscriber(key, lambda sample: received.append(str(sample.key_expr)), allowed_origin=zenoh.Locality.REMOTE) for key in keys]
    targets = ["dreamstream/v1/any/advance", "dreamstream-policy/v1/mine/0123456789abcdef/plan", "dreamstream/v1/any/plan"]
    while not done.is_set():
        for key in targets:
            session.put(key, b"\x0a\x00nonsense")
        for key in ["**", "dreamstream/**", "dreamstream-policy/**"]:
            for reply in session.get(key, timeout=0.2):
                if reply.ok is not None:
                    received.append(str(reply.ok.key_expr))
        done.wait(0.05)
    session.close()
print(json.dumps({"connected": session is not None, "received": received}))
