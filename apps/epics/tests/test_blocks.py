"""Every servo report in waveforms and in one table: none is lost, and what is missing is counted."""

import asyncio
import itertools
import os
import queue
import signal
import time
import types

import aioca
import numpy
import pytest
from conftest import PREFIX, with_aioca

SECONDS = float(os.environ.get("PMAC_EPICS_SECONDS", "6"))
INVALID = 3


def cpu_seconds(process):
    """What ``process`` has used of processors by now."""
    with open(f"/proc/{process.pid}/stat") as stat:
        fields = stat.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def tables(context, blocks):
    """A monitor that puts each table to the queue ``blocks``; the server drops none for a client that keeps up."""
    return context.monitor(f"{PREFIX}TABLE", blocks.put, request="record[queueSize=100]", notify_disconnect=False)


def followed(context, seconds):
    """The tables of so many seconds, each once."""
    came, blocks = queue.Queue(), []
    monitor = tables(context, came)
    end = time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            block = came.get(timeout=60)
            # INVALID is the last block again: on a busy machine the board may not live for a moment. What the monitor begins
            # with may be none yet, or have been read between two blocks.
            if block.alarm.severity != INVALID and (blocks or block.first == block.block > 0):
                blocks.append(block)
    finally:
        monitor.close()
    assert [block.first for block in blocks] == [block.block for block in blocks], "whole blocks"
    numbers = [int(block.block) for block in blocks]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "each block, once"
    return blocks


def followed_by_channel_access(board, seconds):
    """Blocks as a client of the waveforms has them: what came with one time. On a busy machine some are not whole, or not there.
    And the last reports, of ``board`` itself.
    """
    columns = {"update": "UPDATE", "timer": "TIMER", "time": "TIME", "pos1": "M1:POS"}
    came = {name: {} for name in (*columns.values(), "BLOCK", "MISSED", "LOST")}

    def keep(name):
        def of(value):
            if value.severity != INVALID:
                came[name][value.timestamp] = value

        return of

    async def follow():
        monitors = [
            aioca.camonitor(f"{PREFIX}{name}", keep(name), format=aioca.FORMAT_TIME, all_updates=True) for name in came
        ]
        await asyncio.sleep(seconds)
        end, (reports, _) = time.time(), board.history(1)
        # The counts of the last blocks may be on their way.
        await asyncio.sleep(1)
        for monitor in monitors:
            monitor.close()
        return end, reports

    end, reports = with_aioca(follow())

    def count(name, at):
        # A count that has not changed is not sent again.
        return came[name][max(stamp for stamp in came[name] if stamp <= at)]

    begin = max(min(came["MISSED"]), min(came["LOST"]))
    blocks = [
        types.SimpleNamespace(
            block=came["BLOCK"][at],
            missed=count("MISSED", at),
            lost=count("LOST", at),
            value={column: came[name][at] for column, name in columns.items()},
        )
        for at in sorted(came["UPDATE"])
        if begin <= at <= end and all(at in came[name] for name in ("BLOCK", *columns.values()))
    ]
    return blocks, reports


def absent(before, block):
    """How many of the board's reports pmacd has not read before each one in ``block``, which follows ``before``, and the time
    since the one before it.
    """
    assert len({len(column) for _, column in block.value.items()}) == 1
    numbers, cycles, seconds = (
        numpy.diff(numpy.concatenate(([before.value[name][-1]], block.value[name])))
        for name in ("update", "timer", "time")
    )
    assert min(numbers) >= 1, "none comes twice"
    assert sum(numbers - 1) == block.lost - before.lost, "each report that pmacd has read, once, or counted as lost"
    for index in numpy.flatnonzero(numbers > 1):
        # The segment holds 4096. Only who is later than that loses any, and goes on with the latest half, which comes at once.
        assert len(numbers) - index > 1500, f"block {block.block}: {numbers[index] - 1} lost, with room in the segment"
    return (cycles - numbers).astype(int), seconds


def accounted(blocks):
    """Demands of ``blocks`` that just what is missing is counted; tells how often that was compared, and how many pauses there were.

    What lies between two that do not follow each other is not known.
    """
    first, compared, pauses = None, 0, 0
    for before, block in itertools.pairwise(blocks):
        if block.block != before.block + 1:
            first = None
            continue
        reports, seconds = absent(before, block)
        # pmacd counts a gap after it has published the report behind it: a count is exact where no gap comes last.
        is_exact = reports[-1] == 0
        if first is None:
            first, missing, counted, paused = (block if is_exact else None), 0, 0, 0
            continue
        # A pause that a busy machine makes may be the board's; pmacd counts what is not: nothing, a part or all of it.
        pause = seconds >= 0.1
        missing += reports[~pause].sum()
        paused += reports[pause].sum()
        pauses += pause.sum()
        if is_exact:
            of_pauses = block.missed - first.missed - missing
            assert counted <= of_pauses <= counted + paused, f"block {block.block}: {missing} are missing"
            counted, paused, compared = of_pauses, 0, compared + 1
    assert compared > 0
    return compared, pauses


def test_at_full_rate_gaps_are_what_the_daemon_missed_and_the_server_lost(ioc, context):
    processes = {"server": ioc.process, "pmacd": ioc.site.daemon}
    began, used = time.monotonic(), {name: cpu_seconds(process) for name, process in processes.items()}
    blocks = followed(context, SECONDS)
    seconds = time.monotonic() - began
    load = ", ".join(
        f"{name} {100 * (cpu_seconds(process) - used[name]) / seconds:.1f} %" for name, process in processes.items()
    )
    compared, pauses = accounted(blocks)
    first, last = blocks[0], blocks[-1]
    reports = last.value.update[-1] - first.value.update[-1]
    print(
        f"\n{reports:.0f} reports of {seconds:.1f} s in {len(blocks) - 1} blocks: {reports / seconds:.0f}/s, "
        f"missed {last.missed - first.missed} (compared {compared} times, {pauses} pauses), "
        f"lost {last.lost - first.lost}; of a processor: {load}"
    )


def test_channel_access_has_every_report_and_its_position(ioc):
    ioc.put("M1:VAL", 20000.0)
    blocks, reports = followed_by_channel_access(ioc.site.connect(), SECONDS)
    compared, _ = accounted(blocks)
    print(f"\n{len(blocks)} blocks by Channel Access, compared {compared} times")
    positions = {report.sequence: report.motor[1].position for report in reports}
    known = [
        (position, positions[number])
        for block in blocks
        for number, position in zip(block.value["update"], block.value["pos1"], strict=True)
        if number in positions
    ]
    assert len(known) > 100 and all(position == reported for position, reported in known)
    assert max(block.value["pos1"].max() for block in blocks) > 1000, "the motor has moved"


def test_what_a_stopped_server_could_not_take_is_counted_as_lost(ioc, context):
    came = queue.Queue()
    monitor = tables(context, came)

    def following():
        while (block := came.get(timeout=60)).alarm.severity == INVALID or block.first != block.block:
            pass
        return block

    try:
        before, block = following(), following()
        ioc.process.send_signal(signal.SIGSTOP)
        # The segment holds 1.8 s.
        time.sleep(3)
        ioc.process.send_signal(signal.SIGCONT)
        end = time.monotonic() + 60
        while block.lost == before.lost:
            assert time.monotonic() < end, "nothing is counted as lost"
            before, block = block, following()
    finally:
        ioc.process.send_signal(signal.SIGCONT)
        monitor.close()
    assert block.block == before.block + 1 and block.lost - before.lost > 500
    absent(before, block)


def a_block(context):
    """A block of now. What a monitor begins with may be older, and read between two blocks."""
    blocks = queue.Queue()
    monitor = tables(context, blocks)
    try:
        return [blocks.get(timeout=30) for _ in range(3)][-1]
    finally:
        monitor.close()


def test_a_table_is_the_waveforms_and_has_the_time_of_its_last_report(ioc, context):
    block = a_block(context)
    assert block.getID() == "epics:nt/NTTable:1.0"
    assert list(block.labels) == list(block.value.keys())
    motors = [f"{kind}{number}" for kind in ("pos", "fe") for number in range(1, 9)]
    assert list(block.labels) == ["update", "timer", "time", *motors]
    stamp = block.timeStamp.secondsPastEpoch + block.timeStamp.nanoseconds * 1e-9
    assert stamp == pytest.approx(block.value.time[-1], abs=1e-5)
    assert block.alarm.severity == 0
    assert all(abs(position) < 1 for position in block.value.pos1)
    assert ioc.get("M2:POS").display.units == "deg"


def test_positions_at_full_rate_are_in_the_motors_unit(ioc, context):
    ioc.put("M2:VAL", 3.0)
    ioc.site.until(lambda: ioc.value("M2:DMOV") == "Done", "the end of the move")
    block = a_block(context)
    assert block.value.pos2 == pytest.approx(3.0, abs=0.02)
    assert len(block.value.fe2) == len(block.value.update)
