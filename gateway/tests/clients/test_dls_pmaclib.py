"""dls-pmaclib: it connects, asks, sets, loads, jogs and tells errors. All by GETRESPONSE and GETBUFFER."""

import pytest
from dls_pmaclib.dls_pmacremote import PmacEthernetInterface
from dls_pmaclib.dls_pmcpreprocessor import ClsPmacParser
from board_of_processes import until


def connected(site):
    pmac = PmacEthernetInterface(timeout=20)
    pmac.setConnectionParams(*site.address)
    assert pmac.connect() is None
    return pmac


@pytest.fixture
def pmac(site):
    pmac = connected(site)
    yield pmac
    pmac.disconnect()


def test_it_connects_and_knows_the_board(site, pmac):
    assert pmac.getPmacModel() == "Turbo PMAC2-VME"
    assert pmac.getShortModelName() == "Pmac"
    assert pmac.getNumberOfAxes() == 8
    assert [pmac.getAxisMacroStationNumber(axis) for axis in (1, 2, 3)] == [0, 1, 4]
    assert pmac.sendCommand("ver") == ("1.947\r\x06", True)


def test_it_reads_and_sets_variables(site, pmac):
    assert pmac.getIVars(0, [20, 21, 22, 23]) == site.send("I20..23")
    pmac.setAxisSetupIVar(3, 22, 12.5)
    assert site.send("I322") == ["12.5"]
    assert pmac.getAxisSetupIVars(3, [22]) == ["12.5"]
    command, reply, done = pmac.disableLimits(1, True)
    assert (command, reply, done) == ("i124=$20001", "\x06", True)
    assert site.send("I124") == ["$20001"]
    pmac.disableLimits(1, False)
    assert site.send("I124") == ["$1"]


def test_its_handshake_is_its_own(site, pmac):
    before = site.send("I3 I6")
    assert pmac.sendCommand("i3 i6") == ("2\r1\r\x06", True)
    assert site.send("I3 I6") == before


# 13 characters a line: no part of 1400 bytes ends in CR, which this client takes for the end of an error.
@pytest.mark.parametrize("last", [99, 499, 1299])
def test_long_replies_come_whole(site, pmac, last):
    site.send(f"P0..{last}=-1234567.125 P{last}=7")
    reply, done = pmac.sendCommand(f"p0..{last}")
    assert done and reply.endswith("\r\x06")
    values = reply.removesuffix("\x06").split("\r")[:-1]
    assert values == ["-1234567.125"] * last + ["7"]


def test_errors_have_the_boards_numbers_and_end_nothing(pmac):
    assert pmac.sendCommand("nonsense") == ("\x07ERR003\r", True)
    assert pmac.sendCommand("p1 #99") == ("0\r\x07ERR003\r", True)
    # No motor is assigned to coordinate system 1, and there is no program 999.
    assert pmac.sendCommand("&1b999r")[0].strip("\x07\r") in pmac.PMAC_errors
    assert pmac.sendCommand("") == ("\x06", True)
    assert pmac.sendCommand("p0") == ("0\r\x06", True)


FILE = """#define speed P10
CLOSE                  ; whatever is open
speed = 20
OPEN PROG 7 CLEAR
LINEAR
IF (speed > 10)
X(speed) Y-5
ENDIF
CLOSE
nonsense
speed = 30
"""


def test_it_loads_a_file_line_by_line_and_saves(site, pmac, tmp_path):
    file = tmp_path / "moves.pmc"
    file.write_text(FILE)
    parsed = ClsPmacParser().parse(str(file))
    lines = [(number, line) for number, line in enumerate(parsed, 1) if line.strip()]
    refused = [(line.strip(), reply) for done, _, line, reply in pmac.sendSeries(lines) if not done]
    assert refused == [("nonsense", "\x07ERR003\r")]
    assert site.send("P10") == ["30"]
    assert site.send("LIST PROG7") == ["LIN", "IF(P10>10)", "X(P10) Y-5", "ENDI", "RET"]
    assert pmac.sendCommand("SAVE") == ("\x06", True)


def test_it_jogs(site, pmac):
    start = site.position(2)
    assert pmac.jogInc(2, "pos", 2000)[1:] == ("\x06", True)
    until(lambda: abs(site.position(2) - start - 2000) < 2, "the end of the jog")
    assert pmac.jogInc(2, "neg", 500)[1:] == ("\x06", True)
    until(lambda: abs(site.position(2) - start - 1500) < 2, "the end of the jog back")
    assert pmac.jogTo(2, 100)[1:] == ("\x06", True)
    until(lambda: abs(site.position(2) - 100) < 2, "the absolute jog's end")
    assert pmac.jogContinous(2, "pos")[1:] == ("\x06", True)
    until(lambda: site.position(2) > 200, "motion")
    assert pmac.jogStop(2)[1:] == ("\x06", True)
    until(lambda: site.send("#2V") == ["0"], "the motor to stand")
    for line in ["#2J^2000", "#2J=100", "#2J+", "#2J/"]:
        assert site.has_told(line), site.log()


def test_it_homes(site, pmac):
    assert pmac.homeCommand(1)[1:] == ("\x06", True)
    # Bit 10 of the second word of `#1?`: home complete.
    until(lambda: int(site.send("#1?")[0][6:], 16) & 0x400, "the home search's end")


def test_who_only_reads_connects_and_moves_nothing(new_site):
    site = new_site(gateway=["--read-only"])
    pmac = connected(site)
    assert pmac.getPmacModel() == "Turbo PMAC2-VME"
    assert pmac.jogContinous(1, "pos")[1:] == ("\x07ERR002\r", True)
    assert site.send("#1V") == ["0"]
    pmac.disconnect()


def test_two_of_them_at_once(site):
    one, two = connected(site), connected(site)
    for number in range(20):
        assert one.sendCommand(f"p1={number}") == ("\x06", True)
        assert two.sendCommand("p1") == (f"{number}\r\x06", True)
    one.disconnect()
    assert two.sendCommand("p1") == ("19\r\x06", True)
    two.disconnect()


def test_a_classic_board_is_refused_as_at_any_such_board(new_site):
    pmac = PmacEthernetInterface(timeout=20)
    pmac.setConnectionParams(*new_site("pmac").address)
    assert pmac.connect() == 'Device did not respond correctly to a "ver" command'
    pmac.setConnectionParams(*new_site("pmac", gateway=["--version-as", "1.94"]).address)
    assert pmac.connect() is None
    assert pmac.sendCommand("#1p") == ("0\r\x06", True)
    pmac.disconnect()
