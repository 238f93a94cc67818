"""symetrie-hexapod: the module with which it speaks to its PMAC, alone. By GETRESPONSE, one reception a reply."""

import egse.hexapod.symetrie.pmac as symetrie
import pytest


@pytest.fixture
def pmac(site):
    pmac = symetrie.PmacEthernetInterface()
    pmac.setConnectionParameters(*site.address)
    pmac.connect()
    # The longest that it waits for a reply, on a machine that may be busy.
    pmac.sock.settimeout(20)
    yield pmac
    pmac.disconnect()


def test_it_connects_and_knows_the_board(pmac):
    assert pmac.isConnected()
    assert pmac.getPmacModel() == "Turbo PMAC2-VME"
    assert (pmac.getVersion(), pmac.getCID()) == (1.947, 602413)
    assert (pmac.getCPU(), pmac.getType(), pmac.getVID()) == ("DSP56303", "TURBO2, X4", "1")
    assert (pmac.getDate(), pmac.getTime(), pmac.getToday()) == ("07/17/1999", "00:00:00", "SAT 01/01/2000")


def test_it_reads_lists_of_variables(site, pmac):
    site.send("&1 Q20=7 Q21=-2.5 M5282->*")
    site.send("M5282=1")
    pmac.getResponse("&1")
    assert pmac.getQVars(20, [0, 1], float) == [7, -2.5]
    assert pmac.getMVars(5282, [0], int) == [1]
    assert pmac.getIVars(122, [0, 100], float) == [float(value) for value in site.send("I122 I222")]


def test_a_command_is_told_done_when_the_board_says_so(site, pmac):
    # The hexapod's own program takes the number of a command from Q20 and puts 0 there: here, a PLC.
    plc = ["OPEN PLC 6 CLEAR", "ADDRESS&2", "IF(Q20>0)", "Q80=Q20", "Q20=0", "ENDIF", "CLOSE"]
    for line in [*plc, "I5=2", "ENABLE PLC 6"]:
        site.send(line)
    assert pmac.sendCommand(symetrie.CMD_CONTROLON) == 0
    assert site.send("&2 Q80") == ["3"]
    move = {"cm": 0, "tx": 1.5, "ty": -2, "tz": 3, "rx": 0, "ry": 0, "rz": 0.25}
    assert pmac.sendCommand(symetrie.CMD_MOVE, **move) == 0
    assert [float(value) for value in site.send("&2 Q71..76")] == [1.5, -2, 3, 0, 0, 0.25]
    assert site.send("&2 Q80") == ["11"]
    assert pmac.sendCommand(symetrie.CMD_POSUSER_GET) == [float(value) for value in site.send("&2 Q53..58")]


def test_an_error_and_what_is_left_unfetched_do_not_mix(pmac):
    assert pmac.getResponse("nonsense") == b"\x07ERR003\r"
    assert pmac.getBuffer() == b"\x00"
    assert pmac.getResponse("p0") == b"0\r\x06"


def test_a_classic_board_is_refused_as_at_any_such_board(new_site):
    pmac = symetrie.PmacEthernetInterface()
    pmac.setConnectionParameters(*new_site("pmac").address)
    with pytest.raises(symetrie.PMACError):
        pmac.connect()
