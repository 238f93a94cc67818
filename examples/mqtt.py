"""Publishes a board's positions at an MQTT broker. The program is yours to change.

It needs the Python package (python/README.md), `pip install paho-mqtt`, a broker, and no right but to read the segment.
MQTT delivers late and in bursts, so use it for displays and logs.

* While positions are live, the program publishes them with the time at which pmacd read them (seconds since 1970). The
  broker does not retain them, so no client gets an old position as a new one.
* The broker retains `state`: `live`, or why there are no positions. When pmacd comes back, the program goes on.
* The program takes nothing from the broker. Whoever may publish a motion moves the machine. If you must allow that,
  give the program a user with the role it needs and no more (docs/security.md), and the broker TLS and passwords.
"""

import json
import time

import paho.mqtt.client as mqtt
import pmac_dpram

client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
client.will_set("pmac/pmac0/state", "this program has ended", retain=True)    # the broker's word if it dies
client.connect("127.0.0.1", 1883)
client.loop_start()

board, told = pmac_dpram.connect("pmac0"), None
while True:
    try:
        snapshot, state = board.snapshot(), "live"
        positions = {number: snapshot.motor[number].position for number in snapshot.motor}
        client.publish("pmac/pmac0/position", json.dumps({"time": snapshot.realtime_ns / 1e9, "counts": positions}))
    except pmac_dpram.PmacError as error:                                     # old data, or no pmacd
        state = str(error)
    if state != told:
        told = state
        client.publish("pmac/pmac0/state", state, retain=True)
    time.sleep(0.1)
