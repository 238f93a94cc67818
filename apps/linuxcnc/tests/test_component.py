"""The component's pins as halcmd sees and sets them, on a simulated board."""

import math
import signal
import subprocess
import sys

from pmac_hal.hand import Hand


def test_pins_follow_the_board(site):
    site.connect().jog_to(1, 1500)
    site.until(lambda: abs(site.position(1) - 1500) < 1, "the pin at 1500")
    site.until(lambda: site.get("motor.1.in-position") == "TRUE", "in position")
    assert abs(float(site.get("motor.1.ferror"))) < 1
    assert site.get("motor.1.fault") == "FALSE"


def test_a_motor_with_a_unit_is_shown_in_it(site):
    site.connect().jog_to(2, 1500)
    site.until(lambda: abs(site.position(2) - 1.5) < 0.001, "the pin at 1.5 deg")


def test_a_moving_motor_is_not_in_position(site):
    site.set("motor.3.jog", 1)
    site.until(lambda: site.get("motor.3.in-position") == "FALSE", "not in position")
    site.set("motor.3.jog", 0)
    site.until(lambda: site.get("motor.3.in-position") == "TRUE", "in position")


def test_a_fatal_following_error_is_a_fault(site):
    board = site.connect()
    (limit,) = board.command("I411")
    board.command("I411=1")
    try:
        board.jog_to(4, 100000)
        site.until(lambda: site.get("motor.4.fault") == "TRUE", "the fault")
    finally:
        board.command(f"I411={limit}")
        board.command("#4J/")
    site.until(lambda: site.get("motor.4.fault") == "FALSE", "the end of the fault")


def test_a_jog_lasts_as_long_as_its_pin_is_not_0(site):
    site.set("motor.1.jog", 1)
    site.until(lambda: site.position(1) > 100, "motion forward")
    assert site.get("motor.1.jogging") == "TRUE"
    site.set("motor.1.jog", -1)
    site.until(lambda: site.velocity(1) < 0, "motion backward")
    site.set("motor.1.jog", 0)
    site.until(lambda: site.stands(1), "standstill", 10)
    site.until(lambda: site.get("motor.1.jogging") == "FALSE", "the pin")


def test_a_component_that_is_killed_jogs_no_longer(site):
    site.set("motor.1.jog", 1)
    site.until(lambda: site.moves(1), "motion")
    site.process.kill()
    site.process.wait()
    site.until(lambda: site.stands(1), "standstill", 10)


def test_a_component_that_hangs_jogs_no_longer(site):
    site.set("motor.1.jog", 1)
    site.until(lambda: site.moves(1), "motion")
    site.process.send_signal(signal.SIGSTOP)
    try:
        site.until(lambda: site.stands(1), "standstill", 10)
    finally:
        site.process.send_signal(signal.SIGCONT)
    # The pin is still 1. Nothing begins by itself.
    site.wait_for_a_look()
    assert site.stands(1) and site.get("motor.1.jogging") == "FALSE"


def test_a_jog_ends_when_nobody_looks_at_its_pin(site):
    """As when the component's loop hangs while its threads go on."""
    hand = Hand(1, site.connect, print)

    def moves():
        hand.see(1, False)
        return site.moves(1)

    site.until(moves, "motion")
    site.until(lambda: site.stands(1), "standstill", 10)
    hand.see(1, False)
    assert not hand.holds, "the pin has not been 0"
    hand.close()


def test_a_component_that_is_unloaded_stops_its_jogs(site):
    site.set("motor.2.jog", -1)
    site.until(lambda: site.moves(2), "motion")
    subprocess.run(["halcmd", "unload", site.component], check=True, timeout=60)
    assert site.process.wait(10) == 0
    site.until(lambda: site.stands(2), "standstill", 10)


def test_a_killed_motor_is_not_jogged_again_before_its_pin_was_0(site):
    site.set("motor.1.jog", 1)
    site.until(lambda: site.moves(1), "motion")
    site.connect().command("#1K")
    site.until(lambda: site.get("motor.1.jogging") == "FALSE", "the end of the jog")
    site.connect().command("#1J/")
    site.until(lambda: site.stands(1), "standstill", 10)
    assert site.get("motor.1.jogging") == "FALSE"
    site.set("motor.1.jog", 0)
    site.wait_for_a_look()
    site.set("motor.1.jog", 1)
    site.until(lambda: site.get("motor.1.jogging") == "TRUE", "the next jog")


def test_abort_ends_a_jog_which_does_not_begin_again_by_itself(site):
    site.set("motor.1.jog", 1)
    site.until(lambda: site.moves(1), "motion")
    site.set("motor.1.abort", 1)
    site.until(lambda: site.stands(1), "standstill", 10)
    site.set("motor.1.abort", 0)
    site.until(lambda: site.get("motor.1.jogging") == "FALSE", "the end of the jog")
    site.wait_for_a_look()
    assert site.stands(1) and site.get("motor.1.jogging") == "FALSE"


def test_abort_stops_what_others_have_begun(site):
    site.connect().command("#5J+")
    site.until(lambda: site.moves(5), "motion")
    site.set("motor.5.abort", 1)
    site.until(lambda: site.stands(5), "standstill", 10)


def test_abort_ends_the_program_that_moves_the_motor_and_no_other(site):
    run_programs(site, {1: 6, 2: 7})
    site.set("motor.6.abort", 1)
    site.until(lambda: not runs(site, 1), "the end of the program", 10)
    assert runs(site, 2), "motor 7 is moved by another"
    site.set("motor.7.abort", 1)
    site.until(lambda: not runs(site, 2), "the end of the other program", 10)


def test_abort_does_not_switch_a_killed_motor_on(site):
    site.connect().command("#8K")
    site.until(lambda: site.snapshot().motor[8].status.open_loop, "open loop")
    site.set("motor.8.abort", 1)
    site.until(lambda: "motor 8: abort: it is in open loop already" in site.log(), "the message")
    assert site.snapshot().motor[8].status.open_loop


def test_without_the_daemon_nothing_passes_for_live(site):
    site.set("motor.1.jog", 1)
    site.until(lambda: site.moves(1), "motion")
    site.kill_daemon()
    site.until(lambda: site.get("live") == "FALSE", "not live", 10)
    assert math.isnan(site.position(1)) and math.isnan(float(site.get("motor.1.ferror")))
    assert site.get("motor.1.in-position") == "FALSE" and site.get("motor.1.fault") == "TRUE"
    site.start_daemon()
    site.until(lambda: site.get("live") == "TRUE" and site.get("motor.1.fault") == "FALSE", "live again")
    # The daemon that knew of the jog is gone: docs/operations.md. A stop stops it; the pin begins no other one.
    site.set("motor.1.abort", 1)
    site.until(lambda: site.stands(1), "standstill", 10)
    assert site.get("motor.1.jogging") == "FALSE"


def test_without_a_board_it_says_why(site):
    done = subprocess.run(
        [sys.executable, "-m", "pmac_hal", "--name", "nobody"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1 and "pmac-hal: " in done.stderr and "nobody" in done.stderr


def test_a_turbo_board_has_no_pins_for_what_it_does_not_report(turbo_site):
    own = {f"motor.{motor}.{pin}" for motor in (1, 2) for pin in ("position", "ferror", "jog", "jogging", "abort")}
    assert turbo_site.pins() == own | {"live", "heartbeat"}
    turbo_site.connect().command("#1J/")
    turbo_site.set("motor.1.jog", 1)
    turbo_site.until(lambda: turbo_site.get("motor.1.jogging") == "TRUE" and not turbo_site.stands(1), "the jog")
    turbo_site.set("motor.1.jog", 0)
    turbo_site.until(lambda: turbo_site.get("motor.1.jogging") == "FALSE" and turbo_site.stands(1), "the stop")
    run_programs(turbo_site, {1: 2})
    turbo_site.set("motor.2.abort", 1)
    turbo_site.until(lambda: not runs(turbo_site, 1), "the end of the program", 10)


def run_programs(site, motors):
    """Runs an endless program in each coordinate system, which moves its motor."""
    board = site.connect()
    for system, motor in motors.items():
        for line in (f"&{system}#{motor}->X", f"OPEN PROG {system} CLEAR", "LINEAR INC TM1000", "WHILE(1>0)", "X100"):
            board.command(line)
        for line in ("ENDWHILE", "CLOSE"):
            board.command(line)
    for system in motors:
        board.command(f"&{system}B{system}R")
        site.until(lambda system=system: runs(site, system), "the program")


def runs(site, system):
    return site.snapshot().system[system].status.running_program
