"""Programs written from the page of the segment alone, in C and in plain Python, read what the Rust client reads."""

import json
import pathlib
import subprocess
import sys

from board_of_processes import PROGRAMS

ROOT = pathlib.Path(__file__).parents[2]


def test_c_python_and_rust_read_the_same_positions(site, tmp_path):
    program = tmp_path / "positions"
    strict = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", *strict, "-o", program, ROOT / "examples/positions.c"], check=True)
    board = site.connect()
    board.command("#1J=2000 #2J=-1234 #3J=7")

    def stand():
        motors = board.snapshot().motor
        return all(motors[number].status.in_position for number in (1, 2, 3)) and abs(motors[1].position - 2000) < 1

    site.until(stand, "the motors to arrive")
    # What stands still is killed, so that all read one position.
    board.control("^K")
    site.until(lambda: board.snapshot().motor[1].status.open_loop, "open loops")
    path = f"/dev/shm/{site.name}"
    in_c = subprocess.run([program, path], check=True, capture_output=True, text=True).stdout
    in_c = {int(number): float(counts) for number, counts in map(str.split, in_c.splitlines())}
    reader = [sys.executable, ROOT / "examples/segment_reader.py", path, "servo", "10"]
    in_python = json.loads(subprocess.run(reader, check=True, capture_output=True).stdout)["actual_positions"]
    motors = json.loads(
        subprocess.run(
            [PROGRAMS / "pmacctl", "--name", site.name, "--socket", site.socket, "motors", "--json"],
            check=True,
            capture_output=True,
        ).stdout
    )["motors"]
    here = board.snapshot().motor
    assert len(in_c) == len(in_python) == len(motors) == len(here) == 8
    for motor in motors:
        number, counts = motor["motor"], motor["actual_position"]["value"]
        assert counts == here[number].position == in_python[str(number)]
        assert abs(in_c[number] - counts) < 1e-4
    # Killed, they are told to be old.
    site.kill_daemon()
    site.until(lambda: subprocess.run([program, path], capture_output=True).returncode == 1, "old data")
