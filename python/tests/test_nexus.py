"""A recording becomes a NeXus file that is whole, or says what is missing, whatever ended it."""

import contextlib
import fcntl
import resource
import signal
import subprocess
import sys

import h5py
import numpy
import pytest
from pmac_dpram import nexus
from pmac_dpram._nexus_file import NexusFile
from pmac_dpram._tables import Column

COMMAND = [sys.executable, "-m", "pmac_dpram.nexus"]
LOG = """\
update,time_s,unix_s,missed,lost,1.actual_position [count],"X:$0033,u"
7,0,1000,0,0,1.5,8388608
8,0.001,1000.001,0,0,2.5,0
8,0.001,1000.001,3,0,NaN,NaN
9,0.005,1000.005,0,0,NaN,1
9,0.005,1000.005,0,0,NaN,NaN
1,9,1009,0,0,-3,2
2,9.1,1009.1,0,4,NaN,NaN
2,9.1,1009.1,0,0,-4,3
"""


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(LOG)
    return path


def rows(path, **options):
    """The names that lead to what is drawn, and the recording's end."""
    with h5py.File(path, **options) as file:
        entry = file[file.attrs["default"]]
        data = entry[entry.attrs["default"]]
        recording = {name: value[()] for name, value in entry["recording"].items()}
        return data[data.attrs["signal"]][:], recording


def test_a_log_has_units_gaps_and_counts(log, tmp_path):
    path = tmp_path / "log.nxs"
    counts = nexus.write(path, log)
    assert counts == nexus.Counts(samples=5, missed=3, lost=4)
    with h5py.File(path) as file:
        entry = file["entry"]
        assert (file.attrs["default"], entry.attrs["default"]) == ("entry", "actual_position")
        assert entry["start_time"][()] == b"1970-01-01T00:16:40+00:00"
        data = entry["actual_position"]
        assert (data.attrs["NX_class"], data.attrs["signal"], *data.attrs["axes"]) == ("NXdata", "motor1", "time")
        numpy.testing.assert_array_equal(data["motor1"], [1.5, 2.5, numpy.nan, -3, -4])
        attributes = data["motor1"].attrs
        assert (attributes["units"], attributes["long_name"]) == ("count", "1.actual_position [count]")
        assert data["time"] == entry["update/time"] and data["time"].attrs["units"] == "s"
        assert list(data["time"]) == [0, 0.001, 0.005, 9, 9.1]
        assert list(entry["update/update"]) == [7, 8, 9, 1, 2] and entry["update/update"].dtype == "int64"
        assert list(entry["X_0033_u/X_0033_u"]) == [8388608, 0, 1, 2, 3]
        gaps = entry["gaps"]
        assert gaps.attrs["signal"] == "missed"
        assert [list(gaps[name]) for name in ("index", "time", "missed", "lost")] == [
            [2, 3, 4],
            [0.001, 0.005, 9.1],
            [3, 0, 0],
            [0, 0, 4],
        ]
        assert {name: value[()] for name, value in entry["recording"].items()} == {
            "samples": 5,
            "missed": 3,
            "lost": 4,
            "ended": b"complete",
        }


def test_a_pause_at_the_end_is_a_gap(log, tmp_path, monkeypatch):
    log.write_text(LOG + "2,13.1,1013.1,0,0,NaN,NaN\n")
    for name, size in (("whole", None), ("small", 1)):
        if size:
            monkeypatch.setattr("pmac_dpram._tables.ROWS", size)
        path = tmp_path / f"{name}.nxs"
        assert nexus.write(path, log) == nexus.Counts(samples=5, missed=3, lost=4), name
        with h5py.File(path) as file:
            gaps = file["entry/gaps"]
            assert (gaps["index"][-1], gaps["time"][-1]) == (5, 13.1), name


def test_a_gathers_samples_that_are_missing_are_lost(tmp_path):
    source = tmp_path / "gather.csv"
    source.write_text("sample,servo_cycle,servo_timer [servo cycles]\n0,0,5\n1,2,7\n5,10,15\n")
    assert nexus.write(tmp_path / "gather.nxs", source) == nexus.Counts(samples=3, lost=3)
    with h5py.File(tmp_path / "gather.nxs") as file:
        assert list(file["entry/gaps/index"]) == [2] and list(file["entry/gaps/lost"]) == [3]
        assert file["entry/servo_timer/time"].attrs["units"] == "servo cycles"


def test_blocks_follow_each_other_without_a_seam(tmp_path, monkeypatch):
    source = tmp_path / "log.csv"
    lines = LOG.splitlines()
    source.write_text("\n".join(lines) + "\n")
    whole = nexus.write(tmp_path / "whole.nxs", source)
    monkeypatch.setattr("pmac_dpram._tables.ROWS", 1)
    assert nexus.write(tmp_path / "small.nxs", source) == whole
    with h5py.File(tmp_path / "whole.nxs") as one, h5py.File(tmp_path / "small.nxs") as other:
        for name in ("actual_position/motor1", "update/time", "gaps/index", "gaps/time", "gaps/missed", "gaps/lost"):
            numpy.testing.assert_array_equal(one["entry"][name], other["entry"][name])


def test_a_series_of_files_goes_into_one(log, tmp_path):
    second = tmp_path / "log-2.csv"
    second.write_text(LOG.splitlines()[0] + "\n3,9.2,1009.2,0,0,-5,4\n4,9.3,1009.3,0,0,-6")
    assert nexus.write(tmp_path / "both.nxs", log, second).samples == 6, "the last line was cut off"
    assert rows(tmp_path / "both.nxs")[0][-1] == -5
    second.write_text("update,time_s,unix_s,missed,lost\n3,9.2,1009.2,0,0\n")
    with pytest.raises(ValueError, match="log-2.csv has other columns"):
        nexus.write(tmp_path / "mixed.nxs", log, second)
    found, recording = rows(tmp_path / "mixed.nxs")
    assert len(found) == 5 and recording["ended"].startswith(b"cut short: ")


def test_what_is_no_recording_leaves_no_file(log, tmp_path):
    path = tmp_path / "out.nxs"
    for text in ("", "a,b\n1,2\n", LOG.splitlines()[0] + "\n", "time_s,x\n1\n"):
        log.write_text(text)
        with pytest.raises(ValueError):
            nexus.write(path, log)
    numpy.save(tmp_path / "plain.npy", numpy.zeros(3))
    with pytest.raises(ValueError, match="named fields"):
        nexus.write(path, tmp_path / "plain.npy")
    (tmp_path / "text.npy").write_text("no array")
    with pytest.raises(ValueError, match="text.npy is no .npy file"):
        nexus.write(path, tmp_path / "text.npy")
    assert not path.exists()


def test_a_file_that_exists_stays(log, tmp_path):
    path = tmp_path / "out.nxs"
    path.write_text("precious")
    done = subprocess.run([*COMMAND, log, path], capture_output=True, text=True)
    assert done.returncode == 1 and "exists already" in done.stderr and path.read_text() == "precious"
    done = subprocess.run([*COMMAND, path, log], capture_output=True, text=True)
    assert done.returncode == 1 and log.read_text() == LOG


def test_a_full_disk_leaves_a_file_that_says_so(tmp_path):
    source, path = tmp_path / "long.csv", tmp_path / "long.nxs"
    numbers = numpy.random.default_rng(1).random(100_000).tolist()
    source.write_text("sample,time_s,x [V]\n" + "".join(f"{n},{n},{x}\n" for n, x in enumerate(numbers)))
    limit = 1_500_000

    def little_room():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    done = subprocess.run([*COMMAND, source, path], capture_output=True, text=True, preexec_fn=little_room)
    found, recording = rows(path)
    assert done.returncode == 1 and "cut short: [Errno 27] File too large" in done.stderr
    assert done.stdout == f"samples={len(found)} lost=0 missed=0\n"
    assert 0 < len(found) < 100_000 and list(found) == numbers[: len(found)]
    assert recording["samples"] == len(found) and b"File too large" in recording["ended"]
    assert path.stat().st_size < limit
    path.unlink()
    limit = 100
    done = subprocess.run([*COMMAND, source, path], capture_output=True, text=True, preexec_fn=little_room)
    assert done.returncode == 1 and "File too large" in done.stderr and not path.exists()


def test_what_pmacctl_logs_is_whole_and_tells_the_board(site, tmp_path):
    source, path = tmp_path / "log.npy", tmp_path / "log.nxs"
    logged = site.pmacctl("log", "-o", source, "--seconds", "0.5", "--motors", "1,3").stdout
    done = subprocess.run([*COMMAND, source, path, "--socket", site.socket], capture_output=True, text=True)
    counts = dict(pair.split("=") for pair in done.stdout.split())
    assert logged == f"updates={counts['samples']} lost={counts['lost']} missed={counts['missed']}\n", done.stderr
    with h5py.File(path) as file:
        board = {name: value[()] for name, value in file["entry/instrument/board"].items()}
        assert board["family"] == b"pmac" and board["firmware"] == b"1.16D" and board["name"].decode() == site.name
        assert board["servo_period_ns"] == pytest.approx(442708.373)
        assert list(file["entry/velocity"]) == ["motor1", "motor3", "time"]
        assert file["entry/velocity/motor3"].attrs["units"] == "count/s"
        update, missed = file["entry/update/update"], file["entry/recording/missed"][()]
        assert (numpy.diff(update) == 1).all()
        # By the board's own clock nothing is missing but what is counted. What was missed before the first row counts, too.
        assert 0 <= round(file["entry/update/time"][-1] / 442708.373e-9) - (len(update) - 1) <= missed


def test_sigterm_ends_a_recording_with_all_that_came(site, tmp_path):
    for options, status, ended in ([], 0, b"complete"), (["--seconds", "60"], 1, b"cut short: SIGTERM"):
        path = tmp_path / f"{status}.nxs"
        child = subprocess.Popen([*COMMAND, "--live", *options, "--socket", site.socket, path], stdout=subprocess.PIPE)
        site.until(lambda: path.exists() and path.stat().st_size > 2**20, "the first block")
        child.send_signal(signal.SIGTERM)
        told = child.communicate()[0].decode()
        found, recording = rows(path)
        assert child.returncode == status and recording["ended"] == ended
        assert told == f"samples={len(found)} lost=0 missed={recording['missed']}\n"
        with h5py.File(path) as file:
            steps = numpy.diff(file["entry/servo_timer/servo_timer"])
            gaps = file["entry/gaps"]
            assert list(gaps["index"]) == list(numpy.flatnonzero(steps > 1) + 1)
            # A pause counts nothing.
            assert all(missed in (step - 1, 0) for missed, step in zip(gaps["missed"], steps[steps > 1], strict=True))


def test_what_was_flushed_outlives_a_kill(site, tmp_path):
    path = tmp_path / "killed.nxs"
    child = subprocess.Popen([*COMMAND, "--live", "--socket", site.socket, path])

    def flushed():
        try:
            return rows(path, swmr=True)[1]["samples"]
        except OSError:
            return 0

    site.until(flushed, "a block, read beside the writer")
    child.kill()
    child.wait()
    found, recording = rows(path, swmr=True)
    assert len(found) >= recording["samples"] > 0
    assert recording["ended"].startswith(b"cut short without notice")


def test_a_reader_that_looks_in_early_does_not_hold_the_recording_up(tmp_path, monkeypatch):
    path = tmp_path / "early.nxs"
    take_room = NexusFile._take_room
    with contextlib.ExitStack() as readers:

        def looked_at(recording, size):
            take_room(recording, size)
            fcntl.flock(readers.enter_context(path.open("rb")), fcntl.LOCK_SH | fcntl.LOCK_NB)

        monkeypatch.setattr(NexusFile, "_take_room", looked_at)
        recording = NexusFile(path, [Column("time_s"), Column("position")], "time_s", {}, None)
        recording.append(numpy.array([[0.0, 7.0]]), numpy.empty((0, 4)), missed=0, lost=0)
        recording.end("complete")
        recording.close()
    found, totals = rows(path)
    assert list(found) == [7] and totals["ended"] == b"complete"


def test_a_daemon_that_is_restarted_is_a_gap(site, tmp_path):
    path = tmp_path / "restarted.nxs"
    child = subprocess.Popen([*COMMAND, "--live", "--socket", site.socket, path], stderr=subprocess.PIPE, text=True)
    site.until(lambda: path.exists() and path.stat().st_size > 2**20, "the first block")
    site.kill_daemon()
    assert "waiting for updates" in child.stderr.readline()
    site.start_daemon()
    began = site.connect().snapshot().sequence
    site.until(lambda: site.connect().snapshot().sequence > began + 1000, "updates of the new daemon")
    child.send_signal(signal.SIGTERM)
    child.communicate()
    assert child.returncode == 0
    with h5py.File(path) as file:
        update, time = file["entry/update/update"][:], file["entry/update/time"][:]
        restarts = numpy.flatnonzero(numpy.diff(update) < 0) + 1
        assert len(restarts) == 1 and restarts[0] in file["entry/gaps/index"]
        assert (numpy.diff(time) > 0).all()


def test_without_h5py_it_says_what_to_install(log, tmp_path):
    (tmp_path / "h5py.py").write_text("raise ModuleNotFoundError(\"No module named 'h5py'\")")
    without = {"PYTHONPATH": ":".join([str(tmp_path), *sys.path])}
    done = subprocess.run([*COMMAND, log, "out.nxs"], capture_output=True, text=True, env=without)
    assert done.returncode == 1
    assert done.stderr == "pmac_dpram.nexus needs h5py and NumPy (No module named 'h5py'): pip install h5py\n"
