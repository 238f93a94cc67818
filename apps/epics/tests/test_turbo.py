"""A Turbo board, whose report has one status word a motor."""

import tempfile

import pytest
from conftest import Ioc, addresses
from site_of_processes import Site


@pytest.fixture(scope="module")
def ioc():
    from p4p.client.thread import Context

    environment = addresses()
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        site = Site(directory, simulator=["--family", "turbo2"], configuration='family = "turbo2"\n')
        try:
            site.connect().command("#1J/ #1J=3000")
            site.until(
                lambda: abs(site.connect().snapshot(stale_ok=True).motor[1].position - 3000) < 1, "the motor at 3000"
            )
            with Context("pva", nt=False, conf=environment, useenv=False) as context:
                yield Ioc(site, context, "TURBO:", environment=environment)
        finally:
            site.close()


def test_a_motor_moves_and_stands(ioc):
    assert ioc.value("M1:VAL") == pytest.approx(3000, abs=1), "no target of 0 that nobody has set"
    ioc.site.until(lambda: ioc.value("M1:STAT") == "Standing", "the motor to stand")
    ioc.put("M1:VAL", 4000.0)
    assert ioc.value("M1:MSG") == "" and ioc.value("M1:DMOV") == "Moving"
    ioc.site.until(lambda: ioc.value("M1:DMOV") == "Done", "the end of the move")
    assert ioc.value("M1:RBV") == pytest.approx(4000, abs=16)


def test_a_killed_motor_is_told_and_takes_no_target(ioc):
    ioc.site.connect().command("#2K")
    ioc.site.until(lambda: ioc.value("M2:STAT") == "Open loop", "the open loop")
    ioc.put("M2:VAL", 100.0)
    assert "open loop" in ioc.value("M2:MSG")
