"""Every servo report in waveforms and in one table: none is lost, and what is missing is counted."""

import os
import queue
import time

import numpy
import pytest
from conftest import PREFIX

SECONDS = float(os.environ.get("PMAC_EPICS_SECONDS", "6"))


def cpu_seconds(process):
    """What ``process`` has used of processors by now."""
    with open(f"/proc/{process.pid}/stat") as stat:
        fields = stat.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def tables(context, blocks):
    """A monitor that puts each table to the queue ``blocks``; the server drops none for a client that keeps up."""
    return context.monitor(f"{PREFIX}TABLE", blocks.put, request="record[queueSize=100]", notify_disconnect=False)


def absent(before, block):
    """How many of the board's reports pmacd has not read before each one in ``block``, which follows ``before``, and the time
    since the one before it.
    """
    assert block.first == block.block == before.block + 1, "whole blocks, each once"
    assert len({len(column) for _, column in block.value.items()}) == 1
    numbers, cycles, seconds = (
        numpy.diff(numpy.concatenate(([before.value[name][-1]], block.value[name])))
        for name in ("update", "timer", "time")
    )
    assert sum(numbers - 1) == block.lost - before.lost, "each report that pmacd has read, once, or counted as lost"
    return (cycles - numbers).astype(int), seconds


def test_at_full_rate_gaps_are_what_the_daemon_missed_and_none_is_lost(ioc, context):
    blocks = queue.Queue()
    monitor = tables(context, blocks)
    processes = {"server": ioc.process, "pmacd": ioc.site.daemon}

    def following():
        while (block := blocks.get(timeout=60)).alarm.severity == 3:
            # The last block again: on a busy machine the board may not live for a moment.
            pass
        return block

    try:
        # What the monitor begins with may be none yet, or have been read between two blocks.
        before, first = following(), following()
        while before.first == 0 or before.first != before.block:
            before, first = first, following()
        # pmacd counts a gap after it has published the report behind it: a count is exact where no gap comes last.
        while absent(before, first)[0][-1]:
            before, first = first, following()
        began, used = time.monotonic(), {name: cpu_seconds(process) for name, process in processes.items()}
        last = first
        missing = compared = counted = paused = pauses = longest = 0
        while time.monotonic() < began + SECONDS:
            before, last = last, following()
            reports, seconds = absent(before, last)
            # A pause that a busy machine makes may be the board's; pmacd counts what is not: nothing, a part or all of it.
            pause = seconds >= 0.1
            missing += reports[~pause].sum()
            paused += reports[pause].sum()
            pauses += pause.sum()
            longest = max(longest, seconds.sum())
            if reports[-1] == 0:
                of_pauses = last.missed - first.missed - missing
                assert counted <= of_pauses <= counted + paused, f"block {last.block}: {missing} are missing"
                counted, paused, compared = of_pauses, 0, compared + 1
    finally:
        monitor.close()
    seconds = time.monotonic() - began
    load = ", ".join(
        f"{name} {100 * (cpu_seconds(process) - used[name]) / seconds:.1f} %" for name, process in processes.items()
    )
    reports = last.value.update[-1] - first.value.update[-1]
    print(
        f"\n{reports:.0f} reports of {seconds:.1f} s in {last.block - first.block} blocks, the longest {longest:.2f} s: "
        f"{reports / seconds:.0f}/s, missed {last.missed - first.missed} (compared {compared} times, {pauses} pauses), "
        f"lost {last.lost - first.lost}; of a processor: {load}"
    )
    assert compared > 0
    # The segment holds 4096 reports: a machine that stops the server for longer than them takes some.
    assert last.lost == first.lost or longest > 1.5


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
