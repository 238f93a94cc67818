"""The requests of BLISS's turbopmac controller, in its order: FLUSH, SENDLINE, GETBUFFER. BLISS itself is too large to
be installed for this; what it sends was read in its source (2.4.0)."""

import socket
import struct

import pytest
from board_of_processes import until

DOWNLOAD, UPLOAD = 0x40, 0xC0
SENDLINE, FLUSH, GETBUFFER = 0xB0, 0xB3, 0xC5


class Client:
    def __init__(self, address):
        self.socket = socket.create_connection(address, timeout=20)

    def request(self, kind, request, value=0, data=b""):
        self.socket.sendall(struct.pack(">BBHHH", kind, request, value, 0, len(data)) + data)

    def receive(self):
        received = self.socket.recv(1400)
        assert received, "the connection has ended"
        return received

    def flush(self):
        self.request(DOWNLOAD, FLUSH, 500)
        return self.receive()

    def send(self, line):
        self.request(DOWNLOAD, SENDLINE, data=line.encode())
        return self.receive()

    def ask(self, line):
        """What is fetched, until ACK."""
        assert self.flush() == b"@"
        assert self.send(line) == b"@"
        reply = b""
        while not reply.endswith(b"\x06"):
            self.request(UPLOAD, GETBUFFER)
            reply += self.receive()
            assert not reply.startswith(b"\x07"), reply
            assert len(reply) < 10_000, reply
        return reply.removesuffix(b"\x06").decode().split("\r")[:-1]


@pytest.fixture
def client(site):
    client = Client(site.address)
    yield client
    client.socket.close()


def test_it_asks_who_is_there_and_sets_the_velocity(site, client):
    assert [client.ask(line) for line in ["VERSION", "DATE", "TYPE"]] == [["1.947"], ["07/17/1999"], ["TURBO2, X4"]]
    assert client.ask("I122=16") == []
    assert client.ask("I122") == ["16"] == site.send("I122")


def test_it_moves_follows_and_stops(site, client):
    status = int(client.ask("#2?")[0], 16)
    # Activated, and not open loop (bits 23 and 18 of the first word).
    assert status >> 47 & 1 and not status >> 42 & 1
    assert client.ask("#2J=1500") == []
    until(lambda: abs(float(client.ask("#2P")[0]) - 1500) < 2, "the end of the move")
    # In position (bit 0 of the second word).
    until(lambda: int(client.ask("#2?")[0], 16) & 1, "the motor to be in position")
    assert client.ask("#2J:-500") == []
    until(lambda: abs(site.position(2) - 1000) < 2, "the end of the step")
    assert client.ask("#2J+") == []
    until(lambda: float(client.ask("#2P")[0]) > 1100, "motion")
    assert client.ask("#2J/") == []
    until(lambda: site.send("#2V") == ["0"], "the motor to stand")
    assert client.ask("#2K") == []
    until(lambda: int(client.ask("#2?")[0], 16) >> 42 & 1, "the open loop")
    assert client.ask("#2J:0") == []
    assert site.has_told("#2J=1500")


def test_an_error_is_fetched_and_flushed(client):
    assert client.send("nonsense") == b"@"
    client.request(UPLOAD, GETBUFFER)
    assert client.receive() == b"\x07ERR003\r"
    assert client.send("P0..9") == b"@"
    assert client.flush() == b"@"
    client.request(UPLOAD, GETBUFFER)
    assert client.receive() == b"\x00"
    assert client.ask("P0") == ["0"]


def test_a_classic_board_is_served_alike(new_site):
    site = new_site("pmac")
    client = Client(site.address)
    assert client.ask("VERSION") == ["1.16D"]
    assert client.ask("#1J=800") == []
    until(lambda: abs(float(client.ask("#1P")[0]) - 800) < 2, "the end of the move")
    assert client.ask("#1K") == []
    client.socket.close()
