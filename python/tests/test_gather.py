"""What the board gathers comes whole, and less is an error."""

import struct
import threading

import numpy
import pmac_dpram
import pytest


def test_samples_come_whole_with_their_times(site):
    board = site.connect()
    board.command("#1J+")
    gathered = board.gather(["servo_timer", "1.actual_position"], 0.5)
    assert len(gathered) == pytest.approx(0.5 * 2259, abs=2) and gathered.lost == 0
    timers = gathered.column(0)
    assert all(later - earlier == 1 for earlier, later in zip(timers, timers[1:]))
    positions = gathered.column(1)
    assert positions[-1] > positions[0] and gathered.columns[1].startswith("1.actual_position")
    values = struct.unpack(f"={2 * len(gathered)}d", gathered.data)
    assert list(values[1::2]) == positions
    assert gathered.times[0] == 0 and gathered.times[-1] == pytest.approx(0.5, abs=0.01)
    with pytest.raises(pmac_dpram.PmacError, match="no column 2"):
        gathered.column(2)


def test_numpy_reads_the_samples(site):
    gathered = site.connect().gather(["servo_timer"], 0.2, period=2)
    table = numpy.frombuffer(gathered.data).reshape(-1, len(gathered.columns))
    assert (numpy.diff(table[:, 0]) == 2).all()


def test_what_cannot_be_gathered_is_refused(site):
    board = site.connect()
    with pytest.raises(pmac_dpram.PmacError, match="nonsense"):
        board.gather(["1.nonsense"], 0.1)
    errors = []

    def other():
        try:
            site.connect().gather(["servo_timer"], 2.0)
        except pmac_dpram.PmacError as error:
            errors.append(error)

    for ending in ["", "ENDGATHER"]:
        began = site.log().count("begins a gather")
        thread = threading.Thread(target=other)
        thread.start()
        site.until(lambda: site.log().count("begins a gather") > began, "the other one's gather")
        with pytest.raises(pmac_dpram.PmacError, match="one gather at a time: uid"):
            board.gather(["1.actual_position"], 0.1)
        if ending:
            board.command(ending)
        thread.join()
        assert len(errors) == bool(ending), errors
    assert "gathering ended early" in str(errors[0])
