"""Sardana's own controllers for PMACs, as they come from PyPI, on the device server."""

import pytest
import tango
from sardana_pmac.ctrl.AlbaLtpTurboPmacCtrl import LtpTurboPmacController
from sardana_pmac.ctrl.PmacCtrl import PmacController
from sardana_pmac.ctrl.PmacLTPCtrl import PmacLTPController
from sardana_pmac.ctrl.TurboPmacCtrl import TurboPmacController

ON, MOVING, ALARM, FAULT = tango.DevState.ON, tango.DevState.MOVING, tango.DevState.ALARM, tango.DevState.FAULT


@pytest.fixture
def controller(site, device):
    kind = PmacController if site.family == "classic" else TurboPmacController
    return with_axes(kind("pmac", {"PmacEthDevName": site.device}))


def with_axes(controller):
    for axis in (1, 2):
        controller.AddDevice(axis)
    state(controller, 1)
    # The classic controller forgets its axes' parameters at each PreStateAll; Sardana sets them anew.
    for axis in (1, 2):
        controller.SetAxisPar(axis, "step_per_unit", 1.0)
    return controller


def state(controller, axis):
    """As Sardana's pool asks for it."""
    controller.PreStateAll()
    controller.StateAll()
    return controller.StateOne(axis)[0]


def position(controller, axis):
    controller.PreReadAll()
    controller.ReadAll()
    controller.SetAxisPar(axis, "step_per_unit", 1.0)
    return controller.ReadOne(axis)


def start(controller, targets):
    controller.PreStartAll()
    for axis, target in targets.items():
        controller.SetAxisPar(axis, "step_per_unit", 1.0)
        assert controller.PreStartOne(axis, target)
        controller.StartOne(axis, target)
    controller.StartAll()


def test_state_and_position_at_rest(controller):
    assert [state(controller, axis) for axis in (1, 2)] == [ON, ON]
    assert [position(controller, axis) for axis in (1, 2)] == [0, 0]


def test_two_motors_are_started_and_arrive(site, controller):
    start(controller, {1: 20000, 2: -15000})
    site.until(lambda: state(controller, 1) == MOVING, "a state of motion", 10)
    site.until(lambda: {state(controller, axis) for axis in (1, 2)} == {ON}, "the end of the motion")
    assert [position(controller, axis) for axis in (1, 2)] == pytest.approx([20000, -15000], abs=1)


def test_a_motion_is_aborted(site, controller):
    start(controller, {1: 1000000})
    site.until(lambda: state(controller, 1) == MOVING, "a state of motion", 10)
    controller.AbortOne(1)
    site.until(lambda: state(controller, 1) == ON, "the end of the motion")
    assert 0 < position(controller, 1) < 900000


def test_a_motor_of_a_running_program_is_aborted_by_its_coordinate_system(site, device, controller):
    device.OnlineCmd("CLOSE")
    for line in ("&2", "#2->X", "OPEN PROG 9 CLEAR", "LINEAR INC TM1000", "WHILE(1>0)", "X100", "ENDWHILE", "CLOSE"):
        device.OnlineCmd(line)
    device.OnlineCmd("&2B9R")
    try:
        site.until(lambda: state(controller, 2) == MOVING, "a running program", 10)
        assert "program" in controller.StateOne(2)[1]
        controller.AbortOne(2)
        site.until(lambda: state(controller, 2) == ON, "the end of the program")
    finally:
        device.OnlineCmd("&2A")
        device.OnlineCmd("&2#2->0")


def test_velocity_and_acceleration(controller):
    for name, value in (("velocity", 12500.0), ("acceleration", 0.25)):
        before = controller.GetAxisPar(1, name)
        controller.SetAxisPar(1, name, value)
        assert controller.GetAxisPar(1, name) == pytest.approx(value)
        controller.SetAxisPar(1, name, before)


def test_a_killed_motor_is_in_alarm_and_an_inactive_one_in_fault(site, device, controller):
    device.KillMotor([1])
    site.until(lambda: state(controller, 1) == ALARM, "the alarm", 10)
    device.OnlineCmd("#1J/")
    site.until(lambda: state(controller, 1) == ON, "the end of the alarm", 10)
    device.SetIVariable((200, 0))
    site.until(lambda: state(controller, 2) == FAULT, "the fault", 10)
    device.SetIVariable((200, 1))
    site.until(lambda: state(controller, 2) != FAULT, "the end of the fault", 10)


def test_extra_attributes_and_lines(site, device, controller):
    for name in ("InPosition", "MotorActivated", "AmplifierEnabled"):
        assert controller.GetAxisExtraPar(1, name.lower() if site.family == "classic" else name) is True
    controller.SendToCtrl("setpvariable 5 2.5")
    assert device.GetPVariable(5) == 2.5
    device.OnlineCmd("M900->*")
    device.SetMVariable([900, 7])
    assert float(controller.SendToCtrl("getmvariable 900")) == 7
    controller.SendToCtrl("enableplc 3")


def test_the_classic_controller_switches_the_amplifier_off_and_on(site, device, controller):
    if site.family != "classic":
        pytest.skip("the Turbo controller looks for another name than it is given, and sends nothing")
    controller.SetAxisExtraPar(1, "AmplifierEnabled", False)
    site.until(lambda: state(controller, 1) == ALARM, "the alarm", 10)
    with pytest.raises(tango.DevFailed, match="JogStopClosesLoop"):
        controller.SetAxisExtraPar(1, "AmplifierEnabled", True)
    assert state(controller, 1) == ALARM


def test_the_controllers_of_a_site_read_variables(site, device):
    where = {"PmacEthDevName": site.device}
    if site.family == "turbo":
        ltp = LtpTurboPmacController("ltp", where)
        assert ltp.GetAxisExtraPar(1, "FeedbackMode") == 1
        ltp.SetAxisExtraPar(1, "FeedbackMode", 2)
        assert ltp.GetAxisExtraPar(1, "FeedbackMode") == 2
        ltp.SetAxisExtraPar(1, "FeedbackMode", 1)
    else:
        ltp = PmacLTPController("ltp", where)
        ltp.AddDevice(1)
        for number, value in ((140, 1), (121, 0), (122, 0), (139, 1)):
            device.OnlineCmd(f"M{number}->*")
            device.SetMVariable([number, value])
        assert ltp.StateOne(1)[0] == ON
        device.SetMVariable([140, 0])
        assert ltp.StateOne(1)[0] == MOVING


def test_without_the_daemon_no_old_state_is_told(site, controller):
    site.kill_daemon()
    try:
        if site.family == "turbo":
            assert state(controller, 1) == ALARM
        else:
            with pytest.raises(tango.DevFailed):
                state(controller, 1)
        with pytest.raises(tango.DevFailed):
            position(controller, 1)
    finally:
        site.start_daemon()
    site.until(lambda: state(controller, 1) == ON, "the state of the new daemon", 10)
