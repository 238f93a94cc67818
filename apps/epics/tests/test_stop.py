"""Stops: one that comes while a move is on its way to the board, and those of motors in open loop."""

import asyncio
import concurrent.futures
import time
import types

import pytest
from pmac_epics.motors import KNOWN_NS, Acting, Motor


class Pmacd:
    """Takes lines, and tells ``on_jog`` while it carries out a jog."""

    def __init__(self, lines, on_jog, *, open_loop=False, age_ns=0):
        self._lines, self._on_jog = lines, on_jog
        self._open_loop, self._age_ns = open_loop, age_ns

    def wait(self, _):
        return True

    def snapshot(self, **_):
        motor = types.SimpleNamespace(status=types.SimpleNamespace(open_loop=self._open_loop))
        return types.SimpleNamespace(motor={1: motor, 2: motor}, time_ns=time.monotonic_ns() - self._age_ns)

    def jog_to(self, motor, position):
        self._on_jog()
        self._lines.append(f"#{motor}J={position:.0f}")

    def command(self, line):
        self._lines.append(line)


def test_a_stop_that_overtakes_a_move_is_sent_again():
    lines = []

    async def both():
        loop = asyncio.get_running_loop()

        def stop_comes():
            asyncio.run_coroutine_threadsafe(motor._stop(1), loop).result(10)

        acting = Acting(lambda: Pmacd(lines, stop_comes), {"moves": None, "stops": None})
        motor = Motor("STOP:", 1, "motor 1", "counts", 1.0, acting, True)
        await motor._move(500.0)

    asyncio.run(both())
    assert lines == ["#1J/", "#1J=500", "#1J/"]


@pytest.mark.parametrize(("name", "age_ns", "sent"), [("RECENT:", 0, []), ("OLD:", 10 * KNOWN_NS, ["#1J/"])])
def test_a_stop_leaves_a_motor_alone_that_is_known_to_be_in_open_loop(name, age_ns, sent):
    lines = []
    acting = Acting(lambda: Pmacd(lines, None, open_loop=True, age_ns=age_ns), {"moves": None, "stops": None})
    motor = Motor(name, 1, "motor 1", "counts", 1.0, acting, True)
    asyncio.run(motor._stop(1))
    assert lines == sent


def test_a_stop_waits_for_no_crowd_of_stops_of_another_motor():
    lines = []

    class Slow(Pmacd):
        def command(self, line):
            time.sleep(0.02)
            super().command(line)

    async def stop():
        before = len(lines)
        await motor._stop(1)
        # It is over when it was sent. One was under way, one waited.
        assert lines.index("#1J/") <= before + 2

    async def asked_again():
        await other._stop(1)
        assert "#2J/" in lines, "a stop that joins another is over when that was sent"

    async def crowd():
        await asyncio.gather(*(other._stop(1) for _ in range(3000)), asked_again(), stop())
        await other._stop(1)

    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        acting = Acting(lambda: Slow(lines, None), {"moves": None, "stops": pool})
        other, motor = (Motor("CROWD:", number, f"motor {number}", "counts", 1.0, acting, True) for number in (2, 1))
        asyncio.run(crowd())
    assert lines[-1] == "#2J/", "a later one is sent again"
