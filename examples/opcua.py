"""Serves a board's positions by OPC UA, for SCADA programs. The program is yours to change.

It needs the Python package (python/README.md), `pip install asyncua`, and no right but to read the segment.

* A client finds `Objects/Motors/Position 1` and so on, in counts, and may subscribe to them. The source's time is when
  pmacd read them.
* A position that is not live has the status `BadNoCommunication` and no value.
* Clients cannot write: whoever may write a motion moves the machine.
* The server listens on this machine only and asks for no password. Before other machines may connect, give the server
  certificates and users (asyncua's documentation: Security).
"""

import asyncio
from datetime import UTC, datetime

import pmac_dpram
from asyncua import Server, ua


async def show(board, nodes):
    """Every node's value with the time of its reading; or, when there are none, a status that says so."""
    try:
        snapshot = board.snapshot()
        time, values = datetime.fromtimestamp(snapshot.realtime_ns / 1e9, UTC), snapshot.motor
    except pmac_dpram.PmacError:                                              # old data, or no pmacd
        time, values = datetime.now(UTC), {}
    for number, node in nodes.items():
        position = values[number].position if number in values.keys() else None
        status = ua.StatusCodes.BadNoCommunication if position is None else ua.StatusCodes.Good
        value = ua.Variant(position, ua.VariantType.Double if position is not None else ua.VariantType.Null)
        await node.write_value(ua.DataValue(value, ua.StatusCode(status), SourceTimestamp=time))


async def main():
    board, server = pmac_dpram.connect("pmac0"), Server()
    await server.init()
    server.set_endpoint("opc.tcp://127.0.0.1:4840/")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    space = await server.register_namespace("pmac0")
    motors = await server.nodes.objects.add_object(space, "Motors")
    nodes = {number: await motors.add_variable(space, f"Position {number}", 0.0) for number in board.snapshot().motor}
    await show(board, nodes)
    async with server:
        while True:
            await show(board, nodes)
            await asyncio.sleep(0.1)


asyncio.run(main())
