"""The scalar records of a motor, as the clients that sites have see them."""

import asyncio
import math
import time

import aioca
import epics
import pytest
from conftest import PREFIX, with_aioca


def moves(ioc, motor):
    return ioc.value(f"M{motor}:STAT") == "Moving"


def test_pyepics_moves_a_motor_and_reads_it_in_its_unit(ioc):
    target, readback = epics.PV(f"{PREFIX}M2:VAL"), epics.PV(f"{PREFIX}M2:RBV", form="ctrl")
    assert target.wait_for_connection(10) and readback.wait_for_connection(10)
    assert (readback.units, readback.precision, readback.severity) == ("deg", 4, 0)
    assert epics.caget(f"{PREFIX}M2:RBV.DESC") == "azimuth"
    assert epics.caget(f"{PREFIX}M1:FERR.EGU") == "counts"
    target.put(1.25, wait=True, timeout=30)
    assert epics.caget(f"{PREFIX}M2:MSG", as_string=True) == ""
    assert epics.caget(f"{PREFIX}M2:DMOV") == 0, "the put has begun a move"
    ioc.site.until(lambda: epics.caget(f"{PREFIX}M2:DMOV") == 1, "the end of the move")
    assert epics.caget(f"{PREFIX}M2:RBV") == pytest.approx(1.25, abs=0.02)
    assert abs(epics.caget(f"{PREFIX}M2:FERR")) < 0.02
    assert epics.caget(f"{PREFIX}M2:STAT", as_string=True) == "In position"
    assert "in_position" in epics.caget(f"{PREFIX}M2:FLAGS", as_string=True).split()


def test_aioca_monitors_ten_a_second_with_the_boards_time(ioc):
    updates = []

    async def follow():
        name = f"{PREFIX}M1:RBV"
        monitor = aioca.camonitor(name, updates.append, format=aioca.FORMAT_TIME, all_updates=True)
        end = time.monotonic() + 60
        while len({update.timestamp for update in updates}) < 21:
            assert time.monotonic() < end, f"{len(updates)} updates"
            await asyncio.sleep(0.02)
        monitor.close()

    with_aioca(follow())
    # While a busy machine holds the board up, the same report comes again.
    times = list(dict.fromkeys(update.timestamp for update in updates))
    assert times == sorted(times) and 1.8 < times[20] - times[0], "ten a second, not more"
    reports, _ = ioc.site.connect().history(1, 1 << 20)
    known = {report.realtime_ns // 1000 for report in reports}
    latest = round(times[-1] * 1e6)
    assert any(latest + off in known for off in (-1, 0, 1)), "the time of a report that the board made"


def test_the_state_says_what_the_flags_mean(ioc):
    board = ioc.site.connect()

    def state_after(line):
        board.command(line)
        return lambda text: ioc.site.until(lambda: ioc.value("M3:STAT") == text, f"{text} after {line}")

    state_after("#3K")("Open loop")
    assert (ioc.get("M3:STAT").alarm.severity, ioc.get("M3:RBV").alarm.severity) == (1, 0)
    state_after("I300=0")("Disabled")
    state_after("I300=1 #3J/")("In position")
    state_after("#3J=50000")("Moving")
    assert ioc.value("M3:DMOV") == "Moving"
    state_after("#3J/")("In position")


def test_a_following_error_is_a_major_alarm(ioc):
    board = ioc.site.connect()
    limit = board.command("I411")[0]
    try:
        board.command("I411=16 #4J=100000")
        ioc.site.until(lambda: ioc.value("M4:STAT") == "Following error", "a fatal following error")
        assert [ioc.get(f"M4:{name}").alarm.severity for name in ("STAT", "RBV", "FERR")] == [2, 2, 2]
    finally:
        board.command(f"I411={limit} #4J/")
    ioc.site.until(lambda: ioc.get("M4:RBV").alarm.severity == 0, "no alarm")


def test_stop_stops_and_what_waits_before_it_is_not_begun(ioc):
    ioc.put("M1:VAL", 1e6)
    ioc.site.until(lambda: moves(ioc, 1), "the motor to move")
    ioc.put("M1:STOP", 1)
    ioc.site.until(lambda: ioc.value("M1:DMOV") == "Done", "the motor to stand")
    assert 0 < ioc.value("M1:RBV") < 1e6
    assert ioc.value("M1:MSG") == ""


def test_neither_stop_nor_target_closes_the_loop_of_a_killed_motor(ioc):
    board = ioc.site.connect()
    board.command("#5K")
    ioc.site.until(lambda: board.snapshot(stale_ok=True).motor[5].status.open_loop, "the open loop")
    ioc.put("M5:STOP", 1)
    ioc.site.until(lambda: "J/ was not sent" in ioc.value("M5:MSG"), "the reason")
    assert ioc.get("M5:MSG").alarm.severity == 2
    ioc.put("M5:VAL", 100.0)
    assert "the move to 100.0 was not sent" in ioc.value("M5:MSG")
    assert board.snapshot(stale_ok=True).motor[5].status.open_loop is True


def test_a_target_that_is_refused_says_why(ioc):
    for target, why in ((math.nan, "is no position"), (1e30, "")):
        ioc.put("M1:VAL", target)
        message = ioc.value("M1:MSG")
        assert message and why in message
        ioc.site.until(lambda: ioc.value("M1:DMOV") == "Done", "done")
    assert abs(ioc.value("M1:RBV")) < 1
    ioc.put("M1:VAL", 0)
    assert ioc.value("M1:MSG") == "", "the next move clears it"
