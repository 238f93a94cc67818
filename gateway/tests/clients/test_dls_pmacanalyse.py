"""dls-pmacanalyse: its backup of a whole board, downloaded to another board, makes that board the same to it, also where
the stored file spells the board's M-variables otherwise."""

import re
import subprocess
import sys

# Something of every kind that the tool reads.
MACHINE = """
&1
#1->1000X+5
#2->1000Y
#3->I
&2
#4->-500.5Z
&1%75
I122=12.5 I5=2
P7=1.25 P8191=-3
&2Q17=4.5
M1->Y:$78402,8
M102->X:$1234,0,24,S
M103->L:$12345
M104->D:$88
M105->*
I6841=$3
MS0,I910=5
&1 OPEN FORWARD CLEAR
Q7=P1/1000
Q8=P2/1000
CLOSE
&1 OPEN INVERSE CLEAR
P3=SQRT(Q7*Q7+Q8*Q8)
CLOSE
OPEN PROG 12 CLEAR
LINEAR ABS
TA100 TS20 F5000
P1=0
WHILE(P1<10)
X(P1*10)Y20
P1=P1+1
ENDWHILE
IF(P1=10 AND M1=0)
DWELL100
ELSE
CMD"#1J/"
ENDIF
CLOSE
OPEN PLC 5 CLEAR
IF(P7>1)
P8=P8+1
ENDIF
CLOSE
DISABLE PLC 5
"""


LISTINGS = ["LIST PLC5", "&1 LIST INVERSE"]
# How a board and the tool spell definitions, and how people do.
SPELLINGS = {
    "m1->y:$78402,8": "M1->Y:$078402,8,1",
    "m102->x:$1234,24,s": "M102->X:$001234,0,24,S",
    "m103->l:$12345": "M103->L:$012345",
    "m104->d:$88": "M104->D:$000088",
}


def backup(site, directory, *more):
    """The file that the tool writes."""
    host, port = site.address
    tool = [sys.executable, "-W", "ignore", "-m", "dls_pmacanalyse.dls_pmacanalyse"]
    options = [f"--resultsdir={directory}/results", f"--backup={directory}", "--pmac=board", f"--tcpip={host}:{port}"]
    ran = subprocess.run([*tool, *options, *more], capture_output=True, text=True, timeout=400)
    assert ran.returncode == 0, ran.stderr
    for trouble in ["Traceback", "Warning", "FAILED"]:
        assert trouble not in ran.stderr, ran.stderr
    return directory / "board.pmc"


def download(site, file):
    ran = site.pmacctl("download", file, timeout=400)
    assert ran.returncode == 0, ran.stderr


def without_timers(path):
    """The text without Isx11 and Isx12, which count down."""
    return re.sub(r"(?m)^;?i[56]\d1[12]=.*\n", "", path.read_text())


def test_a_board_is_backed_up_and_another_made_the_same(new_site, tmp_path):
    site = new_site(simulator=["--macro"])
    machine = tmp_path / "machine.pmc"
    machine.write_text(MACHINE)
    download(site, machine)
    saved = backup(site, tmp_path / "one")
    lines = set(saved.read_text().lower().splitlines())
    expected = {"&1#1->1000x+5", "&1#3->i", "i122=12.5", "p8191=-3", "ms0,i910=5", "m104->d:$88", "p8=p8+1"}
    assert expected <= lines, expected - lines

    texts = [site.send(line) for line in LISTINGS]
    # The tool waits 3 s for an answer; one board less keeps the machine quicker.
    site.close()

    other = new_site(simulator=["--macro"])
    download(other, saved)
    # One definition is another one in truth.
    text = saved.read_text().lower()
    for own, other_spelling in {**SPELLINGS, "m105->*": "M105->L:$12346"}.items():
        assert f"{own}\n" in text, own
        text = text.replace(f"{own}\n", f"{other_spelling}\n")
    reference, mend = tmp_path / "stored.pmc", tmp_path / "mend.pmc"
    reference.write_text(text)
    again = backup(other, tmp_path / "other", f"--reference={reference}", f"--fixfile={mend}")
    assert [line for line in mend.read_text().lower().splitlines() if "->" in line and line[0] == "m"] == ["m105->l:$12346"]
    assert without_timers(again) == without_timers(saved)
    assert [other.send(line) for line in LISTINGS] == texts
