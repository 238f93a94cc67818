"""The program of examples/opcua.py, with a client of its nodes."""

import asyncio
import time

from asyncua import Client, ua
from site_of_processes import LOOPBACK, free_ports

PATIENCE_S = 60


class Seen:
    """What a subscription brings."""

    def __init__(self):
        self.values = []

    def datachange_notification(self, _node, value, _data):
        self.values.append(value)


async def until(condition, what):
    end = time.monotonic() + PATIENCE_S
    while not (found := await condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        await asyncio.sleep(0.02)
    return found


async def connected(address):
    client = Client(address)
    try:
        await client.connect()
        return client
    except (OSError, TimeoutError):
        return None


def test_positions_are_served_with_their_status(site, example):
    (port,) = free_ports(1)
    program = example("opcua", {"4840": str(port)})
    asyncio.run(look(site, program, f"opc.tcp://{LOOPBACK}:{port}/"))


async def look(site, program, address):
    client = await until(lambda: connected(address), "the server")
    try:
        space = await client.get_namespace_index("pmac0")
        node = await client.nodes.objects.get_child([f"{space}:Motors", f"{space}:Position 2"])
        seen = Seen()
        subscription = await client.create_subscription(50, seen)
        await subscription.subscribe_data_change(node)

        async def has(status, position=None):
            value = await node.read_data_value(raise_on_bad_status=False)
            return value.StatusCode.value == status and (position is None or abs(value.Value.Value - position) < 1)

        site.connect().jog_to(2, 1500)
        await until(lambda: has(ua.StatusCodes.Good, 1500), "motor 2 at 1500")
        written = await node.read_data_value()
        assert abs(written.SourceTimestamp.timestamp() - time.time()) < PATIENCE_S
        site.kill_daemon()
        await until(lambda: has(ua.StatusCodes.BadNoCommunication), "a status that says so")
        site.start_daemon()
        await until(lambda: has(ua.StatusCodes.Good, 1500), "live data of the new daemon")
        assert any(value is not None and abs(value - 1500) < 1 for value in seen.values)
        assert program.poll() is None
    finally:
        await client.disconnect()
