"""A motor as an ophyd device, in bluesky's plans."""

import threading

import pytest
from bluesky import RunEngine
from bluesky.plan_stubs import mv
from bluesky.plans import scan
from conftest import PREFIX
from ophyd.utils import StatusTimeoutError
from pmac_epics.device import PmacMotor


@pytest.fixture(scope="module")
def azimuth():
    return PmacMotor(f"{PREFIX}M2", name="azimuth", tolerance=0.05)


@pytest.fixture
def motor(ioc, azimuth):
    azimuth.wait_for_connection(timeout=30)
    return azimuth


def test_bluesky_scans_a_motor(motor):
    documents = []
    engine = RunEngine({})
    engine(scan([motor], motor, 0, 2, 5), lambda name, document: documents.append((name, document)))
    events = [document["data"] for name, document in documents if name == "event"]
    assert [event["azimuth"] for event in events] == pytest.approx([0, 0.5, 1, 1.5, 2], abs=0.05)
    assert [event["azimuth_setpoint"] for event in events] == [0, 0.5, 1, 1.5, 2]
    assert documents[-1][1]["exit_status"] == "success"
    configuration = next(document for name, document in documents if name == "descriptor")
    assert configuration["data_keys"]["azimuth"]["units"] == "deg"
    assert configuration["hints"]["azimuth"]["fields"] == ["azimuth"]


def test_set_read_and_monitor(motor):
    seen = []
    motor.readback.subscribe(lambda value, **_: seen.append(value))
    motor.set(20.0).wait(60)
    assert motor.position == pytest.approx(20.0, abs=0.05)
    assert motor.read()["azimuth"]["value"] == pytest.approx(20.0, abs=0.05)
    assert any(0.1 < value < 19.9 for value in seen), "the way there is seen"
    motor.set(20.0).wait(60)


def test_a_new_target_on_the_way_is_reached(ioc, motor):
    first = motor.set(500.0)
    ioc.site.until(lambda: motor.position > 1, "the motor to move")
    second = motor.set(0.5)
    second.wait(60)
    assert motor.position == pytest.approx(0.5, abs=0.05)
    with pytest.raises(RuntimeError, match="stands at"):
        first.wait(60)


def test_stop_ends_a_move_as_failed(ioc, motor):
    status = motor.set(1000.0)
    ioc.site.until(lambda: motor.position > 1, "the motor to move")
    motor.stop()
    with pytest.raises(RuntimeError, match="stands at .* not at 1000"):
        status.wait(60)


def test_a_move_that_takes_too_long_is_stopped(ioc, motor):
    with pytest.raises(StatusTimeoutError):
        motor.set(1000.0, timeout=1.0).wait(60)
    ioc.site.until(lambda: ioc.value("M2:DMOV") == "Done", "the motor to stand")
    assert motor.position < 1000


def test_a_refused_move_fails_with_the_reason(motor):
    with pytest.raises(RuntimeError, match="no position"):
        motor.set(float("nan")).wait(60)
    motor.set(0.25).wait(60)


def test_a_move_fails_when_the_daemon_dies(ioc, motor):
    status = motor.set(1000.0)
    ioc.site.until(lambda: motor.position > 1, "the motor to move")
    ioc.site.kill_daemon()
    try:
        with pytest.raises(RuntimeError, match="gone"):
            status.wait(30)
    finally:
        ioc.site.start_daemon()
        ioc.until_live()
    ioc.put("M2:STOP", 1)


def test_an_aborted_plan_stops_the_motor(ioc, motor):
    engine = RunEngine({})
    ended = []

    def run():
        try:
            engine(mv(motor, 1000.0))
        except Exception as error:
            ended.append(error)

    # A run engine in another thread than the main one takes no signals.
    engine.context_managers = []
    thread = threading.Thread(target=run)
    thread.start()
    ioc.site.until(lambda: motor.position > 1, "the motor to move")
    engine.request_pause()
    thread.join(30)
    engine.abort()
    ioc.site.until(lambda: ioc.value("M2:DMOV") == "Done", "the motor to stand")
    assert motor.position < 1000
