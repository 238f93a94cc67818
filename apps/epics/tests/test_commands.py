"""Command lines and gathering, and who may put what."""

import os
import subprocess
import sys

import aioca
import numpy
import pytest
from conftest import PREFIX, Ioc, addresses, with_aioca


def test_a_put_with_completion_has_its_reply(ioc):
    ioc.put("CMD", "P1=25 P1 P2=7 P2")
    assert (ioc.value("REPLY"), ioc.value("MSG")) == ("25\n7", "")
    ioc.put("CMD", "P1 #99")
    assert ioc.value("REPLY") == "25"
    assert "ERR003" in ioc.value("MSG") and ioc.get("MSG").alarm.severity == 2


def test_no_line_enters_a_program_that_somebody_else_has_open(ioc):
    ioc.put("CMD", "P1=3")
    for line in ("OPEN PROG 9 CLEAR", "X2"):
        ioc.site.pmacctl("send", line)
    for line in ("P1=5", "I122"):
        ioc.put("CMD", line)
        assert "not sent" in ioc.value("MSG") and "PROG 9 open" in ioc.value("MSG")
        assert ioc.get("MSG").alarm.severity == 2 and ioc.value("REPLY") == ""
    ioc.put("CMD", "CLOSE")
    for line, reply in (("LIST PROG 9", "X2\nRET"), ("P1", "3"), ("OPEN PROG 9 CLEAR", ""), ("X1", "")):
        ioc.put("CMD", line)
        assert (ioc.value("REPLY"), ioc.value("MSG")) == (reply, "")
    ioc.site.pmacctl("send", "CLOSE")
    ioc.put("CMD", "P1=7")
    assert "carried out at once" in ioc.value("MSG")
    for line, reply in (("CLOSE", ""), ("P1", "3"), ("LIST PROG 9", "X1\nRET")):
        ioc.put("CMD", line)
        assert (ioc.value("REPLY"), ioc.value("MSG")) == (reply, "")


def test_aioca_sends_a_line_longer_than_a_dbr_string(ioc):
    line = " ".join(f"P{number}={number}" for number in range(20, 30)) + " P29"
    assert len(line) > 40

    async def send():
        await aioca.caput(f"{PREFIX}CMD", line, datatype=aioca.DBR_CHAR_STR, wait=True, timeout=30)
        return await aioca.caget(f"{PREFIX}REPLY", datatype=aioca.DBR_CHAR_STR)

    assert with_aioca(send()) == "29"


def test_each_put_is_logged_with_who_asked(ioc):
    ioc.put("CMD", "P3=1234")
    ioc.site.until(lambda: f"{PREFIX}CMD" in ioc.site.log(), "the put in the log")


def test_gather_fills_its_columns(ioc):
    ioc.put("GATHER:SOURCES", "servo_timer, 1.actual_position")
    ioc.put("GATHER:SECONDS", 0.2)
    ioc.put("GATHER:PERIOD", 2)
    ioc.put("GATHER:START", 1)
    ioc.site.until(lambda: ioc.value("GATHER:STATE") in ("Done", "Failed"), "the end of the gather")
    assert (ioc.value("GATHER:STATE"), ioc.value("GATHER:MSG")) == ("Done", "")
    times, timer = ioc.value("GATHER:TIME"), ioc.value("GATHER:DATA1")
    assert len(times) == len(timer) == len(ioc.value("GATHER:DATA2")) == pytest.approx(226, abs=1)
    assert set(numpy.diff(timer)) == {2}
    assert list(ioc.value("GATHER:COLUMNS")) == ["servo_timer [servo cycles]", "1.actual_position [count]"]
    assert len(ioc.value("GATHER:DATA3")) == 0


@pytest.mark.parametrize(
    "record, value, why",
    [
        ("SOURCES", "nonsense", "nonsense"),
        ("SECONDS", 3600.0, "samples"),
        ("SECONDS", -1.0, "-1"),
        ("PERIOD", 0, "PERIOD is 0"),
    ],
)
def test_a_gather_that_cannot_be_says_why_at_once(ioc, record, value, why):
    for name, good in (("SOURCES", "1.actual_position"), ("SECONDS", 0.1), ("PERIOD", 1)):
        ioc.put(f"GATHER:{name}", value if name == record else good)
    ioc.put("GATHER:START", 1)
    ioc.site.until(lambda: why in ioc.value("GATHER:MSG") and ioc.value("GATHER:STATE") == "Failed", "the refusal")


PUTS = """
import epics, sys
for line in sys.argv[1:]:
    name, value = line.split()
    pv = epics.PV(name)
    assert pv.wait_for_connection(10), name
    try:
        pv.put(value, wait=True, timeout=10)
        print(pv.write_access, "taken")
    except epics.ca.CASeverityException as error:
        print(pv.write_access, "refused")
"""


def puts(environment, *lines):
    """What becomes of puts by Channel Access."""
    done = subprocess.run(
        [sys.executable, "-c", PUTS, *lines],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_only_values_that_are_for_it_can_be_put(ioc):
    from p4p.client.thread import RemoteError

    lines = [f"{PREFIX}M1:{field} 1" for field in ("RBV", "RBV.DISP", "VAL.DISP", "VAL.EGU", "VAL")]
    assert puts({}, *lines) == ["False refused"] * 4 + ["True taken"]
    for record in ("M1:RBV", "M1:STAT", "TABLE"):
        with pytest.raises(RemoteError):
            ioc.put(record, {"value": {"time": [1.0]}} if record == "TABLE" else 1)


def test_read_only_refuses_every_put(site, ioc):
    from p4p.client.thread import Context, RemoteError

    environment = addresses()
    with Context("pva", nt=False, conf=environment, useenv=False) as context:
        reading = Ioc(site, context, "READING:", ["--read-only"], environment)
        assert abs(reading.value("M1:RBV")) < 1
        for record, value in (("M1:VAL", 5.0), ("M1:STOP", 1), ("CMD", "P1=99"), ("GATHER:START", 1)):
            with pytest.raises(RemoteError):
                reading.put(record, value)
        lines = [f"READING:M1:{field} 1" for field in ("VAL", "VAL.DISP", "VAL.ASG", "STOP")]
        assert puts(environment, *lines) == ["False refused"] * 4
        reading.process.terminate()
        assert reading.process.wait(30) == 0
    assert site.connect().command("P1") != ["99"]
