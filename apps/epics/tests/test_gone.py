"""What the records say when daemon or board is gone, and when it is there again."""

import os
import signal
import sys

from conftest import MOTOR_2, WORDS, addresses

READINGS = ("M1:RBV", "M1:FERR", "M1:STAT", "M1:DMOV", "M2:RBV", "UPDATE", "M1:POS", "TABLE", "MISSED", "CONN", "USER:pair:of")


def test_a_killed_daemon_makes_everything_invalid_and_a_new_one_live(site, ioc):
    kept = ioc.value("M2:RBV")
    site.kill_daemon()
    site.until(lambda: ioc.value("CONN") == "Gone" and ioc.is_invalid(*READINGS), "INVALID")
    site.until(lambda: "pmacd" in ioc.value("WHY"), "the reason")
    assert ioc.value("M2:RBV") == kept
    ioc.put("M1:VAL", 5.0)
    assert "pmacd" in ioc.value("M1:MSG")
    assert ioc.is_invalid("M1:DMOV") and ioc.value("M1:DMOV") == "Done"
    ioc.put("CMD", "P1")
    assert "pmacd" in ioc.value("MSG")
    ioc.put("GATHER:START", 1)
    site.until(lambda: ioc.value("GATHER:STATE") == "Failed", "the refusal")
    before = ioc.value("BLOCK")
    site.start_daemon()
    ioc.until_live()
    site.until(lambda: ioc.value("BLOCK") > before and not ioc.is_invalid("TABLE"), "blocks")
    # Servo and background reports, blocks and the text come each in its own time.
    site.until(lambda: ioc.value("WHY") == "" and not any(map(ioc.is_invalid, READINGS)), "valid records")
    ioc.put("CMD", "P1=3 P1")
    assert (ioc.value("REPLY"), ioc.value("MSG")) == ("3", "")
    ioc.put("M1:VAL", 50.0)
    site.until(lambda: abs(ioc.value("M1:RBV") - 50) < 1, "the motor to arrive")


def test_a_board_that_stands_still_makes_everything_invalid(site, ioc):
    site.simulator.send_signal(signal.SIGSTOP)
    try:
        site.until(lambda: ioc.value("CONN") == "Stale" and ioc.is_invalid(*READINGS) and ioc.value("WHY"), "INVALID")
        ioc.put("M1:VAL", 0.0)
        assert ioc.value("M1:MSG") and ioc.is_invalid("M1:DMOV")
    finally:
        site.simulator.send_signal(signal.SIGCONT)
    ioc.until_live()


def test_without_background_reports_the_state_is_not_guessed(site, ioc):
    board = site.connect()
    board.command("I49=0")
    try:
        site.until(lambda: ioc.is_invalid("M1:STAT", "M1:FLAGS", "M1:DMOV"), "no state")
        assert not ioc.is_invalid("M1:RBV", "M1:FERR", "TABLE")
    finally:
        board.command("I49=1")
    site.until(lambda: ioc.value("M1:STAT") == "In position" and not ioc.is_invalid("M1:STAT"), "the state")


def test_a_daemon_with_other_units_is_not_believed(site, ioc):
    site.kill_daemon()
    site.configure(MOTOR_2.replace("1000", "2000") + WORDS)
    try:
        site.start_daemon()
        site.until(lambda: "units" in ioc.value("WHY") and ioc.is_invalid("M2:RBV", "TABLE"), "the refusal")
    finally:
        site.kill_daemon()
        site.configure(MOTOR_2 + WORDS)
        site.start_daemon()
    ioc.until_live()


def test_a_server_waits_for_a_daemon_that_is_not_there_yet(site, ioc):
    site.kill_daemon()
    environment = addresses()
    place = ("--name", site.name, "--socket", site.socket, "--prefix", "LATER:")
    waiting = site.run(sys.executable, "-m", "pmac_epics", *place, env={**os.environ, **environment})
    try:
        site.until(lambda: "waiting for the board: " in site.log(), "the server to say that it waits")
        site.start_daemon()
        site.until(lambda: " as LATER:*" in site.log(), "the server to serve")
        assert waiting.poll() is None
    finally:
        waiting.terminate()
        waiting.wait(30)
    ioc.until_live()
