"""The program of examples/mqtt.py, with a broker and a client of its topics."""

import json
import sys

import paho.mqtt.client as mqtt
import pytest
from site_of_processes import LOOPBACK, free_ports

BROKER = """\
listeners:
  default:
    type: tcp
    bind: {address}
plugins:
  amqtt.plugins.authentication.AnonymousAuthPlugin:
    allow_anonymous: true
"""


@pytest.fixture
def port(site):
    """That of a broker."""
    (port,) = free_ports(1)
    configuration = site.directory / "broker.yaml"
    configuration.write_text(BROKER.format(address=f"{LOOPBACK}:{port}"))
    site.run(sys.executable, "-m", "amqtt.scripts.broker_script", "-c", configuration)
    return port


@pytest.fixture
def messages(site, port):
    """The last message of each topic."""
    found = {}
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    client.on_message = lambda _client, _data, message: found.update({message.topic: message.payload.decode()})
    client.on_connect = lambda *_: client.subscribe("pmac/#")

    def is_connected():
        try:
            client.connect(LOOPBACK, port)
            return True
        except OSError:
            return False

    site.until(is_connected, "the broker")
    client.loop_start()
    yield found
    client.disconnect()
    client.loop_stop()


def test_positions_and_state_are_at_the_broker(site, example, port, messages):
    program = example("mqtt", {"1883": str(port)})
    state, position = "pmac/pmac0/state", "pmac/pmac0/position"
    site.until(lambda: messages.get(state) == "live" and position in messages, "the first message")
    site.connect().jog_to(2, 1500)
    site.until(lambda: abs(json.loads(messages[position])["counts"]["2"] - 1500) < 1, "motor 2 at 1500")
    site.kill_daemon()
    site.until(lambda: "pmacd" in messages[state], "a state that says why")
    messages.pop(position)
    site.start_daemon()
    site.until(lambda: messages[state] == "live" and position in messages, "live data of the new daemon")
    program.kill()
    site.until(lambda: messages[state] == "this program has ended", "the program's will")
