"""The device's commands and attributes, on a simulated board of each generation."""

import threading

import pytest
import tango
from pmac_tango.device import PmacEth
from pmac_tango.text import integer, read, written
from site_of_processes import LOOPBACK
from tango.test_context import DeviceTestContext


def refused(proxy, command, *argument):
    """The reason and the text with which ``command`` fails."""
    with pytest.raises(tango.DevFailed) as failed:
        proxy.command_inout(command, *argument)
    return failed.value.args[0].reason, failed.value.args[0].desc


def spectrum(site, proxy, name):
    """The attribute, once its data are live: on a busy machine the board may be late."""

    def live():
        try:
            return proxy.read_attribute(name)
        except tango.DevFailed as error:
            assert error.args[0].reason == "StaleData"
            return None

    return site.until(live, "live data")


def is_on(proxy):
    return proxy.state() == tango.DevState.ON


def test_live_positions_carry_the_boards_time(site, device):
    device.JogToPos([2, 1500])
    site.until(lambda: abs(spectrum(site, device, "Positions").value[1] - 1500) < 1, "motor 2 at 1500")
    first = spectrum(site, device, "Positions")
    between = site.snapshot()
    last = spectrum(site, device, "FollowingErrors")
    assert len(first.value) == len(last.value) == 8
    assert first.quality == tango.AttrQuality.ATTR_VALID
    # Of Tango's times, whole microseconds.
    assert first.time.totime() - 1e-6 <= between.realtime_ns / 1e9 <= last.time.totime() + 1e-6


def test_lines_and_control_characters_are_answered_as_by_the_board(device):
    assert device.OnlineCmd("I122") == "32"
    assert device.OnlineCmd("I122 I120") == "32\n200"
    assert device.SendCtrlChar("P") == "0 0 0 0 0 0 0 0"
    assert len(device.SendCtrlChar("b").split()) == len(device.SendCtrlChar("^C").split()) == 8


def test_variables(device):
    device.SetIVariable((122.0, 12.5))
    assert device.GetIVariable(122) == 12.5
    device.SetIVariable([122, 32])
    assert device.GetIVariable(122) == 32
    device.command_inout("setpvariable", [7.0, -0.25])
    assert device.GetPVariable(7) == -0.25
    # An address, which the board writes as $… .
    assert device.GetIVariable(103) == int(device.OnlineCmd("I103").removeprefix("$"), 16)
    device.OnlineCmd("M900->*")
    device.SetMVariable([900, 3])
    assert device.command_inout("getmvariable", 900) == 3


def test_nothing_enters_a_program_that_somebody_else_has_open(site, device):
    """Neither one of the server's user, nor, but for OnlineCmd, one of another client."""
    device.SetPVariable([1, 3])
    own = [("SetPVariable", [1, 9]), ("GetPVariable", 1), ("EnablePLC", 1), ("DisablePLC", 1)]
    for opener, others in ((lambda line: site.pmacctl("send", line), [("OnlineCmd", "I122"), *own]), (device.OnlineCmd, own)):
        opener("OPEN PROG 9 CLEAR")
        opener("X1")
        for command in others:
            reason, text = refused(device, *command)
            assert reason == "PmacError" and "not sent" in text and "PROG 9 open" in text, command
        device.KillMotor([5])
        opener("CLOSE")
        assert (device.OnlineCmd("LIST PROG 9"), device.GetPVariable(1)) == ("X1\nRET", 3)
    for line in ("OPEN PROG 9 CLEAR", "X1"):
        device.OnlineCmd(line)
    site.pmacctl("send", "CLOSE")
    assert "carried out at once" in refused(device, "OnlineCmd", "P1=7")[1]
    assert device.OnlineCmd("CLOSE") == "" and device.OnlineCmd("P1") == "3"


def test_plc_programs_are_switched(site, device):
    for line in ("I5=2", "OPEN PLC 3 CLEAR", "P8=P8+1", "CLOSE", "DISABLE PLC 3", "P8=0"):
        device.OnlineCmd(line)
    device.command_inout("enableplc", 3)
    site.until(lambda: device.GetPVariable(8) > 0, "a run of PLC 3")
    device.DisablePLC(3)
    stands = device.GetPVariable(8)
    site.connect().wait()
    assert device.GetPVariable(8) == stands


def test_what_the_board_refuses_has_its_number_as_reason(device):
    reason, text = refused(device, "OnlineCmd", "NONSENSE")
    assert reason == "ERR003" and "unrecognized command" in text


@pytest.mark.parametrize(
    "command, argument, text",
    [
        ("JogToPos", [1], "1 values: give two, [motor, value]"),
        ("JogToPos", [0, 5], "motor 0: give an integer from 1 to 32"),
        ("JogToPos", [1.5, 5], "motor 1.5: give an integer from 1 to 32"),
        ("JogStop", [1, 2], "2 values: give one, [motor]"),
        ("KillMotor", [33], "motor 33: give an integer from 1 to 32"),
        ("SetIVariable", [9000, 1], "I 9000: give an integer from 0 to 8191"),
        ("SetIVariable", [122, float("nan")], "nan: the board takes finite numbers only"),
        ("EnablePLC", 32, "PLC 32: give an integer from 0 to 31"),
    ],
)
def test_a_wrong_argument_reaches_no_board(device, command, argument, text):
    assert refused(device, command, argument) == ("WrongArgument", text)


def test_numbers_as_the_board_writes_them():
    assert [written(value) for value in (32.0, -0.5, 1e-7, 123456789.125)] == ["32", "-0.5", "0.0000001", "123456789.125"]
    assert [read(text) for text in ("32", "-0.5", "$3501", " 7")] == [32, -0.5, 0x3501, 7]
    with pytest.raises(ValueError, match="too small"):
        written(1e-12)
    with pytest.raises(ValueError):
        integer(float("inf"), "motor", 1, 32)


def test_a_jog_stops(site, device):
    device.OnlineCmd("#3J+")
    site.until(lambda: not site.status(3).desired_velocity_zero, "motor 3 to move")
    device.JogStop([3])
    site.until(lambda: site.status(3).desired_velocity_zero, "motor 3 to stand")


def test_neither_a_jog_nor_a_stop_switches_a_killed_motor_on(site, device):
    device.KillMotor([4])
    site.until(lambda: site.status(4).open_loop, "motor 4 in open loop")
    for command, argument in (("JogToPos", [4, 100]), ("JogStop", [4])):
        reason, text = refused(device, command, argument)
        assert reason == "WrongArgument" and "nothing was sent" in text
    assert "JogStopClosesLoop" in text and site.status(4).open_loop
    device.OnlineCmd("#4J/")
    site.until(lambda: site.status(4).open_loop is False, "a closed loop")


def test_a_site_that_switches_motors_on_by_jog_stop_says_so(site, device):
    """Also where the board does not act on the control panel."""
    panel = device.OnlineCmd("I2")
    device.OnlineCmd("I2=0")
    properties = {"Board": site.name, "Socket": site.socket, "JogStopClosesLoop": True}
    with DeviceTestContext(PmacEth, host=LOOPBACK, properties=properties, process=True, timeout=60) as other:
        other.KillMotor([4])
        site.until(lambda: site.status(4).open_loop, "motor 4 in open loop")
        other.JogStop([4])
        site.until(lambda: site.status(4).open_loop is False, "a closed loop", 10)
    device.OnlineCmd(f"I2={panel}")


def test_who_asks_for_data_waits_for_no_line_of_others(site, device):
    """SAVE holds the board's port for command lines, for longer than the server waits."""
    slow = tango.DeviceProxy(site.device)
    slow.set_timeout_millis(60_000)
    answers = []

    def save():
        try:
            answers.append(slow.OnlineCmd("SAVE"))
        except tango.DevFailed as error:
            answers.append(error)

    saving = threading.Thread(target=save)
    saving.start()
    try:
        site.until(lambda: '"SAVE"' in site.log(), "the line")
        device.state()
        assert not answers
    finally:
        saving.join(60)
    assert answers

    def answers_again():
        try:
            return device.OnlineCmd("I122")
        except tango.DevFailed:
            return None

    site.until(answers_again, "a free port")


def test_a_motion_is_logged_with_the_client(site, device):
    device.JogToPos([1, 10])
    logged = [line for line in site.log().splitlines() if "#1J=10.0" in line]
    assert logged and "127.0.0.1" in logged[-1] and " pid " in logged[-1]


def test_without_the_daemon_it_is_in_fault_and_comes_back(site, device):
    site.until(lambda: is_on(device), "the state")
    site.kill_daemon()
    assert device.state() == tango.DevState.FAULT
    assert "pmacd is gone" in device.status()
    for command, argument in (("SendCtrlChar", "P"), ("OnlineCmd", "I122"), ("JogToPos", [1, 100]), ("JogStop", [1])):
        assert refused(device, command, argument)[0] == "DaemonGone"
    with pytest.raises(tango.DevFailed, match="pmacd is gone"):
        _ = device.Positions
    site.start_daemon()
    site.until(lambda: is_on(device), "the state")
    assert device.OnlineCmd("I122") == "32"


def test_on_a_turbo_board_another_group_of_motors_is_not_taken_for_the_first(site, device):
    if site.family != "turbo":
        pytest.skip("other boards have one group")
    device.OnlineCmd("##1")
    reason, text = refused(device, "SendCtrlChar", "P")
    assert reason == "WrongArgument" and "motors 9 to 16" in text
    device.OnlineCmd("##0")
    assert device.SendCtrlChar("P") == "0 0 0 0 0 0 0 0"
