"""What a program reads of a live board, and what it is told when there is none."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time

import numpy
import pmac_dpram
import pytest


def test_a_snapshot_has_every_motor_in_counts(site):
    board = site.connect()
    board.command("#1J=2000")
    site.until(lambda: abs((board.snapshot().motor[1].position or 0) - 2000) < 1, "the motor to arrive")
    snapshot = board.snapshot()
    assert list(snapshot.motor) == list(range(1, 9)) and len(snapshot.motor) == 8
    motor = snapshot.motor[1]
    assert (motor.number, snapshot.stale) == (1, None)
    assert abs(motor.following_error) < 1 and abs(motor.commanded_position - 2000) < 1
    assert motor.raw_position == pytest.approx(motor.position * 96 * 32, abs=96 * 32)
    site.until(lambda: board.snapshot().motor[1].status.in_position, "in position")
    assert motor.status.open_loop is False and "motor_activated" in motor.status.names()
    with pytest.raises(AttributeError, match="no flag nonsense"):
        motor.status.nonsense
    for number in (33, 0, -1):
        with pytest.raises(KeyError, match=f"motor {number} is not reported"):
            snapshot.motor[number]
    with pytest.raises(KeyError, match="coordinate system -1 is not reported"):
        snapshot.system[-1]
    assert snapshot.system[1].status.running_program is False


def test_a_board_tells_what_it_is(site):
    identity = site.connect().identity()
    assert (identity.family, identity.firmware) == ("pmac", "1.16D") and identity.type.startswith("PMAC1, ISA")
    assert identity.servo_period_ns == pytest.approx(442708.373) and identity.servo_report_cycles == 1


def test_a_motor_tells_its_coordinate_system(site):
    board = site.connect()
    assert board.snapshot().motor[3].coordinate_system is None
    board.command("&2#3->X")
    site.until(lambda: board.snapshot().motor[3].coordinate_system == 2, "the assignment")


def test_positions_agree_with_the_boards_own_words(site):
    board = site.connect()
    board.command("#2J=-500")
    site.until(lambda: board.snapshot().motor[2].status.in_position and board.command("#2V") == ["0"], "standstill")
    # The board writes one decimal, and the motor may move a little between the two.
    agree = lambda: float(board.command("#2P")[0]) == pytest.approx(board.snapshot().motor[2].position, abs=0.1)
    site.until(agree, "the same position from both")


def test_errors_carry_the_boards_number(site):
    board = site.connect()
    assert board.command("P1=25") == []
    with pytest.raises(pmac_dpram.PmacError, match="ERR003") as error:
        board.command("P1 #99")
    assert (error.value.code, error.value.lines) == (3, ("25",))
    with pytest.raises(pmac_dpram.PmacError, match="no control character") as error:
        board.control("nonsense")
    assert error.value.code == 0
    assert len(board.control("^F")) >= 1
    for character in ("^K", "^k", "\x0b", "^A", "^D"):
        assert board.control(character) == []
    with pytest.raises(pmac_dpram.PmacError, match="confirm|--yes"):
        board.control("^Z")
    assert board.control("^Z", confirmed=True) == []
    with pytest.raises(pmac_dpram.PmacError, match="no time"):
        board.wait(-1)


def test_lines_enter_ones_own_program_buffer_and_no_other(site):
    board, other = site.connect(), site.connect()
    for line in ("OPEN PROG 7 CLEAR", "X1", "P1=2"):
        assert board.command(line) == []
    for line in ("P1=5", "I122"):
        with pytest.raises(pmac_dpram.PmacError, match="not sent.*PROG 7 open"):
            other.command(line)
    assert other.command("#1J/") == [] and len(other.command("#1P")) == 1
    assert board.command("CLOSE") == [] and board.command("LIST PROG 7") == ["X1", "P1=2", "RET"]
    assert board.command("P1=1") == []

    board.command("OPEN PROG 8 CLEAR")
    other.command("CLOSE")
    for _ in range(2):
        with pytest.raises(pmac_dpram.PmacError, match="carried out at once.*CLOSE, or another OPEN"):
            board.command("P1=7")
    other.command("P2=1")
    assert other.command("P1") == ["1"]
    assert board.command("CLOSE") == [] and board.command("P1") == ["1"]

    # Another process, which opens one by hand where this one's was.
    board.command("OPEN PROG 9 CLEAR")
    for line in ("CLOSE", "OPEN PROG 10 CLEAR", "X3"):
        site.pmacctl("send", line)
    for line in ("P1=7", "P1=7 OPEN PROG 11"):
        with pytest.raises(pmac_dpram.PmacError, match="not sent.*PROG 10 open"):
            board.command(line)
    site.pmacctl("send", "CLOSE")
    assert other.command("LIST PROG 10") == ["X3", "RET"]


def test_a_name_and_a_socket_must_be_of_one_board(site, new_site):
    other = new_site()
    assert pmac_dpram.connect(socket=site.socket).name == site.name
    with pytest.raises(pmac_dpram.PmacError, match="not of"):
        pmac_dpram.connect(site.name, other.socket)
    with pytest.raises(pmac_dpram.DaemonGone):
        pmac_dpram.connect("no-such-board")


def test_an_update_has_no_background_data(site):
    update = next(site.connect().updates())
    assert update.motor[1].status.in_position is None and update.motor[1].status.open_loop is not None
    assert update.motor[1].target_position is None and len(update.system) == 0


def test_waiting_ends_with_a_report_or_with_its_time(site):
    board = site.connect()
    assert board.wait(5.0)
    assert board.wait(5.0, after=board.snapshot().sequence)
    began = time.monotonic()
    assert not board.wait(0.2, after=2**62)
    assert 0.2 <= time.monotonic() - began < 5


def test_updates_come_one_by_one_and_none_is_lost(site):
    updates = site.connect().updates()
    numbers = [update.sequence for update, _ in zip(updates, range(2000))]
    assert numbers == list(range(numbers[0], numbers[0] + 2000))
    assert updates.lost == 0 and updates.missed >= 0


def test_updates_can_be_awaited_beside_other_work(site):
    async def both():
        ticks = 0

        async def tick():
            nonlocal ticks
            while True:
                ticks += 1
                await asyncio.sleep(0)

        task = asyncio.create_task(tick())
        numbers = []
        async for update in site.connect().updates():
            numbers.append(update.sequence)
            if len(numbers) == 200:
                task.cancel()
                return numbers, ticks

    numbers, ticks = asyncio.run(both())
    assert numbers == list(range(numbers[0], numbers[0] + 200)) and ticks > 10


def test_a_cancelled_wait_takes_no_update(site):
    updates = site.connect().updates()

    async def follow():
        before, cancelled = await anext(updates), 0
        while cancelled < 300:
            try:
                # Less than from one update to the next: most waits end before there is one.
                async with asyncio.timeout(0.0002):
                    update = await anext(updates)
            except TimeoutError:
                cancelled += 1
                continue
            lost = update.gap[1] if update.gap else 0
            assert update.sequence == before.sequence + 1 + lost, f"after {cancelled} cancelled waits"
            before = update

    asyncio.run(follow())
    # Another event loop does not wait for what the first has left.
    asyncio.run(asyncio.wait_for(anext(updates), 60))


def test_cancelled_waits_for_a_silent_board_hold_up_neither_each_other_nor_the_end(site):
    updates = site.connect().updates(timeout=1.0)
    site.simulator.send_signal(signal.SIGSTOP)

    async def wait():
        # What has come before is taken first.
        with pytest.raises(TimeoutError):
            while True:
                await asyncio.wait_for(anext(updates), 0.1)
        threads = threading.active_count()
        for _ in range(50):
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(anext(updates), 0.005)
        assert threading.active_count() <= threads + 1
        with pytest.raises(pmac_dpram.StaleData):
            await anext(updates)

    try:
        asyncio.run(wait())
    finally:
        site.simulator.send_signal(signal.SIGCONT)


def sequence_of_at_least(count, board):
    """The number of the latest update, once there have been so many."""
    deadline = time.monotonic() + 10
    while (last := board.snapshot().sequence) < count:
        assert time.monotonic() < deadline, last
        time.sleep(0.01)
    return last


def test_history_is_what_is_still_there(site):
    board = site.connect()
    last = sequence_of_at_least(100, board)
    samples, lost = board.history(last - 99, 100)
    assert [sample.sequence for sample in samples] == list(range(last - 99, last + 1)) and lost == 0
    assert samples[0].servo_timer < samples[-1].servo_timer


COLUMNS = ["sequence", "realtime_ns", "servo_timer", "1.position", "2.following_error", "9.position"]


def test_columns_are_what_the_objects_are(site):
    board = site.connect()
    board.command("#1J=2000")
    since = sequence_of_at_least(501, board) - 500
    (samples, _), found = board.history(since, 400), board.history_columns(COLUMNS, since, 400)
    table = numpy.frombuffer(found.data, found.dtype)
    assert len(table) == len(found) == 400 and found.lost == 0
    assert table.dtype.names == tuple(COLUMNS) and table["realtime_ns"].dtype == numpy.int64
    for row, sample in zip(table, samples, strict=True):
        assert row["sequence"] == sample.sequence
        # The daemon may renew the offset of the real time between the two calls.
        assert abs(row["realtime_ns"] - sample.realtime_ns) < 1_000_000
        assert (row["servo_timer"], row["1.position"]) == (sample.servo_timer, sample.motor[1].position)
        assert row["2.following_error"] == sample.motor[2].following_error and numpy.isnan(row["9.position"])
    for wrong in ("nonsense", "1.nonsense", "0.position", "x.position", "1"):
        with pytest.raises(pmac_dpram.PmacError, match="no column.*1.position"):
            board.history_columns([wrong])


def test_columns_are_taken_once_and_count_what_is_lost(site):
    updates = site.connect().updates()
    last = next(updates).sequence
    for pause, most in ((0.1, 50), (0.1, 65536), (2.5, 65536)):
        time.sleep(pause)
        found = updates.take_columns(["sequence"], most)
        numbers = numpy.frombuffer(found.data, found.dtype)["sequence"]
        assert 0 < len(found) <= most and numpy.all(numpy.diff(numbers, prepend=last) >= 1)
        assert numbers[-1] - last == len(found) + found.lost
        last = numbers[-1]
    assert found.lost > 0, "the segment holds 1.8 s"
    assert last + 1 == next(updates).sequence


def test_who_waits_holds_nobody_up(site):
    board = site.connect()
    done = []

    def wait():
        board.wait(0.5, after=2**62)
        done.append(True)

    thread = threading.Thread(target=wait)
    thread.start()
    count = 0
    while not done:
        count += 1
    thread.join()
    assert count > 1000


def test_a_killed_daemon_is_told_and_a_new_one_is_found(site):
    board = site.connect()
    updates = board.updates(timeout=0.3)
    next(updates)
    site.kill_daemon()
    with pytest.raises(pmac_dpram.DaemonGone, match="start it"):
        board.snapshot()
    old = board.snapshot(stale_ok=True)
    assert "pmacd is gone" in old.stale and old.motor[1].position is not None
    with pytest.raises(pmac_dpram.DaemonGone):
        for _ in updates:
            pass
    with pytest.raises(pmac_dpram.DaemonGone, match="pmacd"):
        board.command("P1")
    site.start_daemon()
    assert board.snapshot().stale is None
    assert board.command("P1=1") == []
    assert next(updates).sequence >= 1


def test_a_daemon_that_was_restarted_gets_the_next_command(site):
    board = site.connect()
    board.command("P1=7")
    site.kill_daemon()
    site.start_daemon()
    assert board.command("P1") == ["7"], "the old connection's end is nothing that the user has to know"


def test_a_board_that_stands_still_gives_stale_data(site):
    board = site.connect()
    simulator = site.simulator
    simulator.send_signal(signal.SIGSTOP)

    def is_stale():
        try:
            board.snapshot()
        except pmac_dpram.StaleData:
            return True
        return False

    try:
        site.until(is_stale, "stale data")
        with pytest.raises(pmac_dpram.StaleData):
            for _ in board.updates(timeout=0.2):
                pass
    finally:
        simulator.send_signal(signal.SIGCONT)
    site.until(lambda: not is_stale(), "live data")


def test_a_jog_lasts_as_long_as_its_block(site):
    board = site.connect()
    board.command("I2=3")
    with board.jog(1, "+") as jog:
        site.until(lambda: board.snapshot().motor[1].velocity > 100, "the motor to move")
        assert jog.is_held
        time.sleep(0.5)
        assert jog.is_held, "it is renewed"
    site.until(lambda: abs(board.snapshot().motor[1].velocity) < 1, "the motor to stand")
    assert not jog.is_held
    with pytest.raises(ZeroDivisionError), board.jog(1, "-"):
        1 / 0
    site.until(lambda: abs(board.snapshot().motor[1].velocity) < 1, "the motor to stand")
    with pytest.raises(pmac_dpram.PmacError, match="no direction"):
        board.jog(1, "up")


WITHOUT_PANEL = [
    {"simulator": ("--family", "turbo2"), "configuration": 'family = "turbo2"\n'},
    {"configuration": 'functions = ["servo", "background", "ascii"]\n'},
]

# Jogs, says so, and goes on until it is killed.
JOGS = """
import sys, time, pmac_dpram
with pmac_dpram.connect(*sys.argv[1:]).jog(2, "-"):
    print("jogs", flush=True)
    time.sleep(600)
"""


def motor_of(board, number):
    return board.snapshot(stale_ok=True).motor[number]


def stands(board, number):
    # A Turbo board reports no velocity.
    return motor_of(board, number).status.desired_velocity_zero


def has_passed(board, number, position):
    return (motor_of(board, number).position - position) * (1 if position > 0 else -1) > 0


@pytest.mark.parametrize("settings", WITHOUT_PANEL, ids=["turbo", "switched-off"])
def test_without_a_panel_a_jog_is_held_by_command_line(new_site, settings):
    site = new_site(**settings)
    board = site.connect()
    board.command("#1J/#2J/")
    with board.jog(1, "+") as jog:
        site.until(lambda: has_passed(board, 1, 50), "the motor to move")
        time.sleep(0.5)
        assert jog.is_held and not stands(board, 1), "it is renewed"
    site.until(lambda: stands(board, 1), "the motor to stand")
    assert not jog.is_held
    with board.jog(1, "-"):
        site.until(lambda: has_passed(board, 1, -50), "the motor to move the other way")
        for line in ("OPEN PROG 1 CLEAR", "X1"):
            board.command(line)
    site.until(lambda: stands(board, 1), "the motor to stand, whatever buffer is open")
    # A jog is on-line only: the board carries it out whatever buffer is open.
    with board.jog(1, "+"):
        site.until(lambda: has_passed(board, 1, 50), "the motor to move beside the buffer")
    site.until(lambda: stands(board, 1), "the motor to stand again")
    board.command("CLOSE")
    assert board.command("LIST PROG 1") == ["X1", "RET"], "neither jog nor stop has become a line of the program"


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_jog_by_command_line_ends_with_its_process(new_site, end):
    site = new_site(**WITHOUT_PANEL[0])
    board = site.connect()
    board.command("#2J/")
    child = subprocess.Popen([sys.executable, "-c", JOGS, site.name, site.socket], stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout.readline() == "jogs\n"
        site.until(lambda: has_passed(board, 2, -50), "the motor to move")
        child.send_signal(end)
        site.until(lambda: stands(board, 2), "the motor to stand", patience=10)
    finally:
        child.kill()
        child.wait()
        child.stdout.close()


def test_a_jog_by_command_line_that_somebody_else_ends_sends_no_stop(new_site):
    site = new_site(**WITHOUT_PANEL[0])
    board = site.connect()
    board.command("#1J/")
    with pytest.raises(pmac_dpram.PmacError, match="that motor gets no stop"):
        with board.jog(1, "+") as jog:
            site.until(lambda: has_passed(board, 1, 50), "the motor to move")
            board.command("#1K")
            site.until(lambda: not jog.is_held, "the end of the hold")
    assert motor_of(board, 1).status.open_loop


def test_a_jog_whose_daemon_is_gone_says_that_the_motor_may_be_moving(new_site):
    site = new_site()
    with pytest.raises(pmac_dpram.DaemonGone, match="motor 1 may be moving: pmacd did not confirm the stop"):
        with site.connect().jog(1, "+"):
            site.kill_daemon()


def test_at_9_khz_none_is_lost(new_site):
    seconds = int(os.environ.get("PMAC_UPDATES_SECONDS", "3"))
    updates = new_site(simulator=("--servo-hz", "9000")).connect().updates()
    before, cpu = next(updates), time.process_time()
    first, count = before, 0
    while before.time_ns - first.time_ns < seconds * 1e9:
        update = next(updates)
        count += 1
        assert update.sequence == before.sequence + 1 and update.motor[8].position is not None
        before = update
    taken, cpu = (before.time_ns - first.time_ns) / 1e9, time.process_time() - cpu
    print(f"{count} updates in {taken:.1f} s, {count / taken:.0f}/s: lost {updates.lost}, missed by pmacd {updates.missed}, "
          f"{100 * cpu / taken:.0f} % of a processor")
    assert updates.lost == 0


def test_variables_are_read_and_watched(site):
    board = site.connect()
    board.command("P1=1.5 P2=-3")
    assert board.read("P1", "P2", "I122") == [1.5, -3, 32]
    values = board.watch("P2", period=0.01)
    assert [next(values) for _ in range(3)] == [[-3]] * 3
    with pytest.raises(pmac_dpram.PmacError):
        board.read("NONSENSE")
    assert board.snapshot().user == {}


def test_words_of_the_sites_programs_have_values_by_name(new_site):
    words = [("count", "DP", "unit = 'part'"), ("pair", "Y", "count = 2"), ("held", "DP", "guard = 'Y:$DA0F'")]
    places = zip(words, ("$DA10", "$DA11", "$DA13"))
    table = "[[user]]\nname = '{}'\nformat = '{}'\n{}\naddress = '{}'\n"
    site = new_site(configuration="".join(table.format(*word, place) for word, place in places))
    board = site.connect()
    assert board.words() == {"count": ("part", 1), "pair": ("", 2), "held": ("", 1)}
    board.command("M200->DP:$DA10 M201->Y:$DA11,0,16 M202->Y:$DA12,0,16 M203->DP:$DA13 M204->Y:$DA0F,0,16")
    board.command("M200=-70000 M201=5 M202=6 M203=3 M204=0")
    site.until(lambda: board.snapshot().user == {"count": -70000, "pair": [5, 6], "held": 3}, "the words")
    board.command("M204=1")
    site.until(lambda: board.snapshot().user["held"] is None, "a word that is not whole")
    assert board.snapshot().user["count"] == -70000
