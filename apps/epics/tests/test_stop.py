"""A stop that comes while a move is on its way to the board."""

import asyncio
import types

from pmac_epics.motors import Acting, Motor


class Pmacd:
    """Takes lines, and tells ``on_jog`` while it carries out a jog."""

    def __init__(self, lines, on_jog):
        self._lines, self._on_jog = lines, on_jog

    def wait(self, _):
        return True

    def snapshot(self, **_):
        return types.SimpleNamespace(motor={1: types.SimpleNamespace(status=types.SimpleNamespace(open_loop=False))})

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
