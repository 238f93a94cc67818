"""What is answered to programs, and to those who mean no good."""

import json
import pathlib
import re
import shutil
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.parse

import pytest
from board_of_processes import PROGRAMS, until
from site_of_processes import LOOPBACK

DASHBOARD = pathlib.Path(__file__).parents[1] / "grafana.json"
CAPTURE = pathlib.Path(__file__).parents[2] / "tests" / "captures" / "simulator-pmac"


def connect(own):
    port = urllib.parse.urlparse(own.url).port
    return socket.create_connection((LOOPBACK, port), timeout=30)


def resident(process):
    """Memory in KiB."""
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", status).group(1))


def test_metrics_begin_with_pmac_and_are_well_formed(moving):
    text = moving.get("/metrics")
    names = {re.match(r"[a-z_]+", line).group() for line in text.splitlines() if not line.startswith("#")}
    assert names and all(name.startswith("pmac_") for name in names)
    assert 'pmac_motor_position_counts{motor="1",name="AZ"}' in text
    assert "pmac_up 1" in text.splitlines() and "pmac_live 1" in text.splitlines()
    if promtool := shutil.which("promtool"):
        checked = subprocess.run([promtool, "check", "metrics"], input=text, text=True, capture_output=True)
        assert (checked.returncode, checked.stdout, checked.stderr) == (0, "", "")


def test_words_of_the_sites_programs_have_names_units_and_numbers(moving):
    until(lambda: 'pmac_user{index="",name="count",unit="part"} -7' in moving.get("/metrics"), "the words")
    text = moving.get("/metrics")
    assert 'pmac_user{index="1",name="pair",unit=""} 5\npmac_user{index="2",name="pair",unit=""} 6\n' in text


def test_the_state_has_the_words_of_the_sites_programs(moving):
    words = [("count", -7, "part"), ("pair", [5, 6], None)]

    def state():
        return json.loads(moving.get("/state"))

    until(lambda: [(word["name"], word["value"], word["unit"]) for word in state()["words"]] == words, "the words")
    assert state()["user"]["fresh"]


def test_the_state_has_the_variables_of_the_command_line_until_nobody_answers(watching):
    def state():
        # pmac-web may not have looked at the board yet.
        return json.loads(watching.get("/state")).get("watched", {"values": [], "reason": None})

    values = [{"name": "P1", "value": "12.5"}, {"name": "P2", "value": "-7"}]
    until(lambda: state()["values"][:2] == values and state()["reason"] is None, "the variables")
    watching.send("P1=13")
    until(lambda: state()["values"][:1] == [{"name": "P1", "value": "13"}], "the new value")
    # The board takes no question while a program buffer is open.
    board = watching.site.connect()
    board.command("OPEN PLC 9 CLEAR")
    until(lambda: "PLC 9" in (state()["reason"] or ""), "the reason")
    assert [value["value"] for value in state()["values"]] == [None] * 3
    board.command("CLOSE")
    until(lambda: state()["reason"] is None, "the variables again")


def test_an_m_variable_is_refused_at_the_start(moving):
    place = ["--name", moving.site.name, "--socket", moving.site.socket, "--listen", "127.0.0.1:0"]
    refused = subprocess.run([PROGRAMS / "pmac-web", *place, "--watch", "M1"], capture_output=True, text=True, timeout=30)
    assert refused.returncode == 2 and "[[user]]" in refused.stderr, refused.stderr


def test_an_escape_sequence_in_the_boards_type_is_seen_in_its_label(board):
    site = board.site
    recording = site.directory / "recording"
    shutil.copytree(CAPTURE, recording)
    answers = recording / "answers.ndjson"
    answers.write_text(answers.read_text().replace("PMAC1, ISA", "PMAC1\\u001b[2J, ISA"))
    site.kill_daemon()
    place = ("--name", site.name, "--socket", site.socket)
    site.daemon = site.run(PROGRAMS / "pmacd", "--board", f"replay:{recording}", *place)
    until(lambda: "[2J" in board.get("/metrics"), "the type of the recording's board")
    text = board.get("/metrics")
    assert "\x1b" not in text and r'type="PMAC1\\x1b[2J, ISA' in text


def test_every_metric_of_the_dashboard_is_there(moving):
    names = set(re.findall(r"pmac_[a-z_]+", DASHBOARD.read_text()))
    text = moving.get("/metrics")
    assert names and {name for name in names if f"\n{name}" not in text} == set()
    assert json.loads(DASHBOARD.read_text())["panels"]


def test_without_a_daemon_nothing_is_live(board):
    board.site.kill_daemon()
    def metrics():
        return board.get("/metrics").splitlines()
    until(lambda: "pmac_up 0" in metrics(), "a board that is not up")
    assert "pmac_live 0" in metrics()
    assert not [line for line in metrics() if line.startswith("pmac_motor_position")], "no old position"
    until(lambda: json.loads(board.get("/state"))["condition"] != "live", "a state that is not live")


@pytest.mark.parametrize("path", ["/nothing", "/../etc/passwd", "/scope", "/scope?traces=1", "/scope?traces=" + "1.velocity," * 99])
def test_what_is_not_there_is_refused(moving, path):
    with pytest.raises(urllib.error.HTTPError) as refused:
        moving.get(path)
    assert refused.value.code in (400, 404)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE"])
def test_nothing_can_be_written(moving, method):
    with connect(moving) as client:
        client.sendall(f"{method} /state HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n".encode())
        assert client.recv(100).startswith(b"HTTP/1.1 405")


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "localhost@evil.example"])
def test_by_a_name_that_others_can_have_nothing_is_told(moving, host):
    for path in ("/", "/state", "/events", "/metrics", "/nothing"):
        with connect(moving) as client:
            client.sendall(f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
            assert client.recv(100).startswith(b"HTTP/1.1 421"), path


def test_those_who_keep_idle_connections_keep_nobody_out(moving):
    def ask(client):
        client.sendall(b"GET /page.css HTTP/1.1\r\nHost: localhost\r\n\r\n")
        answer = b""
        while b"\r\n\r\n" not in answer:
            answer += client.recv(65536)
        return answer
    idle = []
    try:
        for _ in range(60):
            idle.append(connect(moving))
            assert ask(idle[-1]).startswith(b"HTTP/1.1 200")
        idle += [connect(moving) for _ in range(40)]
        # Well before the ten seconds that each of them may stay.
        begun = time.monotonic()
        assert json.loads(moving.get("/state", 8))["condition"] == "live"
        assert time.monotonic() - begun < 8
    finally:
        for client in idle:
            client.close()


def test_another_boards_socket_is_refused(moving):
    other = [PROGRAMS / "pmac-web", "--name", "another", "--socket", moving.site.socket, "--listen", "127.0.0.1:0"]
    refused = subprocess.run(other, capture_output=True, text=True, timeout=30)
    assert refused.returncode == 2 and moving.site.name in refused.stderr


def test_long_and_half_requests_are_bounded(board):
    with connect(board) as client:
        client.sendall(b"GET / HTTP/1.1\r\nX: " + b"a" * 100_000)
        assert client.recv(100).startswith(b"HTTP/1.1 431")
    with connect(board) as client:
        client.sendall(b"GET / HTT")
        assert client.recv(100) in (b"", b"HTTP/1.1 408 Request Timeout"), "the server gives up by itself"
    with connect(board) as client:
        client.sendall(b"\x16\x03\x01 nonsense\r\n\r\n")
        assert client.recv(100).startswith(b"HTTP/1.1 400")


def test_many_who_do_not_read_hold_nobody_up(board):
    until(lambda: served(board), "a state")
    before = resident(board.web)
    counters = json.loads(board.get("/state"))["counters"]
    fields = "actual_position,1.following_error,1.velocity,1.commanded_position"
    idle = [connect(board) for _ in range(10)]
    streams = []
    for _ in range(60):
        client = connect(board)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.sendall(f"GET /scope?traces=1.{fields} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        streams.append(client)
    # Those who do not read are sent away, and then everybody is served again.
    until(lambda: served(board), "a state")
    until(lambda: "pmac_up 1" in board.get("/metrics", 30), "metrics")
    assert resident(board.web) < before + 64 * 1024
    after = json.loads(board.get("/state", 30))["counters"]
    assert after["lost"] == counters["lost"]
    for client in idle + streams:
        client.close()


def served(board):
    try:
        return json.loads(board.get("/state", 20))["condition"] == "live"
    except OSError:
        return False


def test_a_stream_tells_what_it_left_out(moving):
    got = []
    with connect(moving) as client:
        client.sendall(b"GET /scope?traces=1.actual_position HTTP/1.1\r\nHost: localhost\r\n\r\n")
        reader = client.makefile("rb")
        thread = threading.Thread(target=lambda: got.extend(line for line, _ in zip(reader, range(200))))
        thread.start()
        thread.join(60)
    batches = [json.loads(line[6:]) for line in got if line.startswith(b"data: ")]
    assert batches and all(batch["lost"] == 0 for batch in batches)
    assert sum(len(batch["t"]) for batch in batches) > 1000
