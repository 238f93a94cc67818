"""pmac-motorhome: the homing programs that it generates run to their end, for each of its kinds of homing."""

import pytest
from board_of_processes import until
from dls_pmaclib.dls_pmacremote import PmacEthernetInterface
from dls_pmaclib.dls_pmcpreprocessor import ClsPmacParser
from pmac_motorhome import sequences
from pmac_motorhome.commands import group, motor, plc
from pmac_motorhome.constants import ControllerType, HomingState, PostHomeMove

PLC, GROUP = 11, 2
STATE, STATUS, ASKED = f"P{PLC}00", f"P{PLC}01", f"P{PLC}02"
# What the generated programs say in their status variable.
DONE, HOMING, ABORTED, ON_LIMIT = "0", "1", "2", "5"
# The M-variables that they use: "stopped on a limit", "in position", "fatal following error", "home complete", the
# actual position and the jog register (Turbo Software Reference, suggested M-variables).
DEFINITIONS = ["M{0}30->Y:${1:X},11", "M{0}40->Y:${1:X},0", "M{0}42->Y:${1:X},2", "M{0}45->Y:${1:X},10"]
REGISTERS = ["M{0}62->D:${1:X}", "M{0}72->L:${2:X}"]
# Capture at the index, at the flag on, at the flag off: values of I7mn2. The flags: values of I7mn3.
INDEX, ON, OFF = 1, 2, 10
HOME, MINUS = 0, 2
FAR = 10**7
ENDS = {"minus": (-FAR, -6000), "plus": (6000, FAR)}


def generate(path, sequence, motors, kind=ControllerType.brick, post=PostHomeMove.initial_position, jdist=0):
    file = path / "homing.pmc"
    with plc(PLC, kind, file, timeout=60_000):
        with group(GROUP, post_home=post):
            for number in motors:
                motor(number, jdist)
            sequence()
    return file


def prepare(site, number, start, *, direction, capture, flag=HOME, **places):
    """Puts a motor's switches in their places, sets its channel, and jogs the motor to ``start``."""
    for name, (first, last) in (ENDS | places).items():
        site.control(f"place {number} {name} {first} {last}")
    for line in [
        *(text.format(number, 0x40 + 0x80 * number) for text in DEFINITIONS),
        *(text.format(number, 0x0B + 0x80 * number, 0x57 + 0x80 * number) for text in REGISTERS),
        f"I{number}00=1 I{number}13={FAR} I{number}14={-FAR} I{number}23={8 * direction}",
        # It stops soon, and on the hard stop before the following error is fatal.
        f"I{number}11=320000 I{number}15=100 I{number}19=1",
        f"I70{number}2={capture} I70{number}3={flag}",
        f"#{number}J={start}",
    ]:
        site.send(line)


def download(site, file):
    ran = site.pmacctl("download", file)
    assert ran.returncode == 0, ran.stderr


def begin(site, starts):
    for number, start in starts.items():
        until(lambda: abs(site.position(number) - start) < 0.5, "the motor at its place")
    for line in ["I5=2", f"{ASKED}={GROUP}", f"{STATE}=0", f"ENABLE PLC{PLC}"]:
        site.send(line)
    until(lambda: site.send(STATE) != ["0"], "the program to begin")


def end(site):
    """The status at the program's end, which has then put back the limit that it has cleared."""
    status = lambda: site.send(STATUS)[0]  # noqa: E731
    until(lambda: status() != HOMING and site.send("I113") == [str(FAR)], "the program's end", patience=120)
    return status()


def homes(site, starts, homes_at, tolerance=1.5):
    """Runs the program and looks where it leaves the motors, which it sends back to where they were."""
    begin(site, starts)
    assert end(site) == DONE, site.log()
    assert site.send(STATE) == [str(HomingState.StateDone.value)]
    for number, start in starts.items():
        assert site.send(f"M{number}45") == ["1"]
        until(lambda: site.send(f"#{number}V") == ["0"], "the motor to stand")
        assert abs(site.position(number) - (start - homes_at[number])) < tolerance, number


def test_rlim_homes_where_the_limit_switch_lets_go(site, tmp_path):
    prepare(site, 1, 700, direction=1, capture=OFF, flag=MINUS)
    prepare(site, 2, -300, direction=1, capture=OFF, flag=MINUS, minus=(-FAR, -4500))
    download(site, generate(tmp_path, sequences.home_rlim, [1, 2]))
    homes(site, {1: 700, 2: -300}, {1: -6000, 2: -4500})
    assert site.send("I7012 I7013 I124") == ["10", "2", "$1"], "the program puts the channel back"


# An index mark is left in the direction from which it is found.
@pytest.mark.parametrize("capture, at, jdist", [(ON, 1500, 0), (INDEX, 0, -500)])
def test_hsw_homes_on_a_home_switch_or_an_index_mark(site, tmp_path, capture, at, jdist):
    prepare(site, 1, 700, direction=1, capture=capture, home=(1500, 2500))
    prepare(site, 2, -300, direction=1, capture=capture, home=(1500, 2500))
    download(site, generate(tmp_path, sequences.home_hsw, [1, 2], jdist=jdist))
    homes(site, {1: 700, 2: -300}, {1: at, 2: at})


def test_hsw_hstop_homes_from_a_hard_stop(site, tmp_path):
    for number, start in [(1, 700), (2, -300)]:
        prepare(site, number, start, direction=1, capture=ON, home=(1500, 2500), stop=(-FAR, -3000), minus=(0, 0))
    download(site, generate(tmp_path, sequences.home_hsw_hstop, [1, 2]))
    homes(site, {1: 700, 2: -300}, {1: 1500, 2: 1500})
    assert site.send("I197 I297") == ["0", "0"]


def test_hsw_dir_homes_at_the_edge_of_a_switch_that_tells_the_side(site, tmp_path):
    prepare(site, 1, 700, direction=-1, capture=ON, home=(-FAR, -1000))
    prepare(site, 2, -1800, direction=-1, capture=ON, home=(-FAR, -1000))
    download(site, generate(tmp_path, sequences.home_hsw_dir, [1, 2]))
    homes(site, {1: 700, 2: -1800}, {1: -1000, 2: -1000})


def test_limit_homes_on_a_limit_switch(site, tmp_path):
    prepare(site, 1, 700, direction=-1, capture=ON, flag=MINUS)
    prepare(site, 2, -300, direction=-1, capture=ON, flag=MINUS, minus=(-FAR, -4500))
    download(site, generate(tmp_path, sequences.home_limit, [1, 2]))
    # The limit stops the fast search: the program sends the motors back from there, not from where they are homed.
    homes(site, {1: 700, 2: -300}, {1: -6000, 2: -4500}, tolerance=150)
    assert site.send("I124 I224") == ["$1", "$1"]


def test_hsw_hlim_homes_on_a_switch_before_or_behind_the_start(site, tmp_path):
    prepare(site, 1, 700, direction=-1, capture=ON, home=(-3000, -2980))
    prepare(site, 2, -300, direction=-1, capture=ON, home=(1500, 1520))
    download(site, generate(tmp_path, sequences.home_hsw_hlim, [1, 2]))
    # Motor 2 finds its switch from the other side, and is homed on this one.
    homes(site, {1: 700, 2: -300}, {1: -2980, 2: 1520}, tolerance=22)


def test_home_only_searches_and_nothing_only_ends(site, tmp_path):
    prepare(site, 1, 700, direction=-1, capture=INDEX)
    download(site, generate(tmp_path, sequences.home_nothing, [1], post=PostHomeMove.none))
    begin(site, {1: 700})
    assert (end(site), site.send("M145"), site.position(1)) == (DONE, ["0"], 700)
    download(site, generate(tmp_path, sequences.home_home, [1], post=PostHomeMove.none))
    begin(site, {1: 700})
    assert end(site) == DONE
    assert (site.send("M145"), site.position(1)) == (["1"], 0)


def test_slits_home_in_turn(site, tmp_path):
    starts = {1: 700, 2: -300, 3: 0, 4: 100}
    for number, start in starts.items():
        prepare(site, number, start, direction=1, capture=ON, home=(1500, 2500))
    slits = lambda: sequences.home_slits_hsw(1, 2, 3, 4)  # noqa: E731
    download(site, generate(tmp_path, slits, starts, post=PostHomeMove.none))
    begin(site, starts)
    assert end(site) == DONE
    assert site.send("M145 M245 M345 M445") == ["1"] * 4
    # They end on the limit away from home.
    assert all(site.position(number) < -6000 - 1500 for number in starts)


def test_motors_on_macro_stations_home_by_the_stations_flags_loaded_through_the_gateway(new_site, tmp_path):
    site = new_site(simulator=["--macro"])
    for number, station in [(1, 0), (2, 1)]:
        prepare(site, number, 700, direction=1, capture=0, home=(1500, 2500))
        site.send(f"I{number}25=$344{station}")
        site.send(f"MS{station},I912={ON}")
        site.send(f"MS{station},I913={HOME}")
    pmac = PmacEthernetInterface(timeout=20)
    pmac.setConnectionParams(*site.address)
    assert pmac.connect() is None
    parsed = ClsPmacParser().parse(str(generate(tmp_path, sequences.home_hsw, [1, 2], ControllerType.pmac)))
    lines = [(number, line) for number, line in enumerate(parsed, 1) if line.strip()]
    assert [told for told in pmac.sendSeries(lines) if not told[0]] == []
    pmac.disconnect()
    homes(site, {1: 700, 2: 700}, {1: 1500, 2: 1500})


def test_a_search_without_its_switch_ends_on_the_limit_and_another_when_told(site, tmp_path):
    prepare(site, 1, 700, direction=1, capture=ON)
    download(site, generate(tmp_path, sequences.home_hsw, [1]))
    begin(site, {1: 700})
    assert (end(site), site.send("M145")) == (ON_LIMIT, ["0"])
    site.send("#1J=0")
    begin(site, {1: 0})
    until(lambda: site.position(1) < -500, "motion")
    site.send(f"{STATUS}={ABORTED}")
    until(lambda: site.send("#1V") == ["0"], "the motor to stand")
    assert (site.send(STATUS), site.send("M145")) == ([ABORTED], ["0"])
