"""A motion program goes through a rotary buffer whole, or tells how far it came."""

import signal
import threading

import pmac_dpram
import pytest

ZIGZAG = ["LINEAR INC TM50 TA20 TS5", "X100 Y50", "X-100 Y50"]


@pytest.fixture
def board(site):
    board = site.connect()
    board.command("&1 #1->X #2->Y")
    return board


def stands_at(motor, position):
    return abs(motor.position - position) < 1 and motor.status.desired_velocity_zero


def test_a_file_and_lines_run_one_after_the_other(site, board, tmp_path):
    path = tmp_path / "zigzag.pmc"
    path.write_text("\n".join(ZIGZAG) + "\n")
    streamed = board.rotary(path, define=1000, run=True)
    assert (streamed.lines, streamed.found_lines, streamed.warnings) == (3, 0, [])
    site.until(lambda: stands_at(board.snapshot().motor[2], 100), "the end of the program")
    site.until(lambda: board.snapshot().motor[1].status.desired_velocity_zero, "the end of its other axis")
    # It waits for more lines, and the next program begins anew.
    board.command("&1Q")
    site.until(lambda: not board.snapshot().system[1].status.running_program, "its end")
    assert board.rotary((line for line in [*ZIGZAG, "X25"]), run=True).lines == 4
    site.until(lambda: stands_at(board.snapshot().motor[1], 25), "the end of the second")
    site.until(lambda: stands_at(board.snapshot().motor[2], 200), "the end of its other axis")
    assert "rotary" in site.log()


def test_what_was_left_needs_a_decision(site, board):
    board.rotary(["INC", "X10"], define=1000)
    site.until(lambda: board.command("PR") == ["1"], "its line in the board's buffer")
    with pytest.raises(pmac_dpram.PmacError, match="left"):
        board.rotary(["X5"])
    with pytest.raises(pmac_dpram.PmacError, match="exclude"):
        board.rotary(["X5"], clear=True, continue_=True)
    streamed = board.rotary(["X5"], continue_=True, run=True)
    assert streamed.found_lines == 1
    site.until(lambda: abs(board.snapshot().motor[1].position - 15) < 1, "all of them")


def test_what_cannot_be_sent_is_refused_with_its_place(site, board, tmp_path):
    path = tmp_path / "wrong.pmc"
    path.write_text("X1\nIF (P1>2)\n")
    with pytest.raises(pmac_dpram.PmacError, match=f"{path}:2:1: "):
        board.rotary(path)
    with pytest.raises(pmac_dpram.PmacError, match="no program lines"):
        board.rotary([])
    with pytest.raises(pmac_dpram.PmacError, match="cs=9: the board has 1 to 8"):
        board.rotary(["X1"], cs=9)
    with pytest.raises(FileNotFoundError):
        board.rotary(tmp_path / "nothing.pmc")
    board.command("I13=0")
    warnings = board.rotary(["NORMAL K-1", "CIRCLE1 X10 Y0 I5 J0"], define=1000).warnings
    assert ["I13 is 0" in warning for warning in warnings] == [True]


def test_a_board_that_takes_nothing_is_told(site, board):
    # The board's own buffer is small, and nothing runs.
    with pytest.raises(pmac_dpram.PmacError, match=r"program:\d+: the board has taken nothing for 0.5 s.*left in"):
        board.rotary((f"X{number} Y{number}" for number in range(5000)), define=100, timeout=0.5)
    assert board.command("P1=1") == []


def test_a_signal_ends_the_stream_and_its_program(site, board):
    class Enough(Exception):
        pass

    def enough(*_):
        raise Enough

    before = signal.signal(signal.SIGUSR1, enough)
    threading.Timer(1.0, lambda: signal.raise_signal(signal.SIGUSR1)).start()
    try:
        with pytest.raises(Enough):
            board.rotary((f"X{number % 100}" for number in range(5000)), define=100, run=True)
    finally:
        signal.signal(signal.SIGUSR1, before)
    site.until(lambda: not board.snapshot().system[1].status.running_program, "the end of the program")


def test_a_signal_whose_stop_fails_tells_that_the_program_may_run_on(site, board):
    class Enough(Exception):
        pass

    def enough(*_):
        site.kill_daemon()
        raise Enough

    before = signal.signal(signal.SIGUSR1, enough)
    threading.Timer(1.0, lambda: signal.raise_signal(signal.SIGUSR1)).start()
    try:
        with pytest.raises(Enough) as raised:
            board.rotary((f"X{number % 100}" for number in range(5000)), define=100, run=True)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert isinstance(raised.value.__cause__, pmac_dpram.PmacError)
    assert "the program may run on" in str(raised.value.__cause__)
