"""What a program's processes get that are forked from it, as multiprocessing forks them by default up to Python 3.13."""

import multiprocessing
import os
import threading
import time

import pmac_dpram
import pytest

FORK = multiprocessing.get_context("fork")
PATIENCE_S = 20


def in_child(call):
    """What ``call`` returns, or the text of what it raises, in a process forked from this one."""
    ours, theirs = FORK.Pipe(duplex=False)

    def run():
        try:
            theirs.send(call())
        except Exception as error:
            theirs.send(f"{type(error).__name__}: {error}")

    child = FORK.Process(target=run)
    child.start()
    try:
        assert ours.poll(PATIENCE_S), "the child hangs"
        return ours.recv()
    finally:
        child.kill()
        child.join()


def replies(board, line, count=100):
    """The replies to ``line``, each once."""
    found = set()
    for _ in range(count):
        try:
            found.add(tuple(board.command(line)))
        except pmac_dpram.PmacError as error:
            found.add(str(error))
    return found


def test_a_forked_child_and_its_parent_each_get_their_own_replies(site):
    board = site.connect()
    for number in (101, 102):
        board.command(f"P{number}={number}")
    ours, theirs = FORK.Pipe(duplex=False)

    def ask():
        theirs.send((replies(board, "P101"), replies(board, "P101 #99")))

    child = FORK.Process(target=ask)
    child.start()
    parents = (replies(board, "P102"), replies(board, "P102=102"))
    assert ours.poll(PATIENCE_S), "the child hangs"
    answers, errors = ours.recv()
    child.join()
    assert parents == ({("102",)}, {()})
    assert answers == {("101",)} and len(errors) == 1 and "ERR003" in errors.pop()


def test_a_forked_child_reads_and_commands_whatever_threads_of_its_parent_do(site):
    board = site.connect()
    updates = board.updates()
    # No sample has this number for a long time, so one thread reads all the time, and so does the other one's command wait.
    over = threading.Event()

    def read():
        while not over.is_set():
            board.wait(1.0, after=1 << 40)

    def command():
        while not over.is_set():
            board.command("P1")

    threads = [threading.Thread(target=target) for target in (read, command)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(20):
            assert in_child(lambda: len(board.snapshot().motor)) == 8
            assert in_child(lambda: board.command("P2=2")) == []
            assert in_child(lambda: next(updates).sequence) > 0
    finally:
        over.set()
        for thread in threads:
            thread.join()


def test_a_forked_child_neither_ends_its_parents_jog_nor_waits_for_it(site):
    board = site.connect()
    moves = lambda: float(board.command("#1V")[0]) > 1
    with board.jog(1, "+") as jog:
        site.until(moves, "the motor to move")
        assert in_child(lambda: jog.is_held) is False
        told = in_child(lambda: jog.__exit__(None, None, None))
        assert told.startswith("PmacError: ") and f"belongs to process {os.getpid()}" in told, told
        time.sleep(0.5)
        assert jog.is_held and moves()
    not_begun = board.jog(1, "+")
    assert f"belongs to process {os.getpid()}" in in_child(lambda: not_begun.__enter__() and None)
    site.until(lambda: not moves(), "the motor to stand")


def test_no_gather_goes_on_for_a_child_of_a_dead_parent(site):
    other = site.connect()

    def gather():
        def until_it_is_ours():
            while refused(site.connect(), 60):
                pass

        threading.Thread(target=until_it_is_ours, daemon=True).start()
        site.until(lambda: refused(other), "the parent's gather")
        # The child has the descriptor of the connection by which the parent gathers.
        child = os.fork()
        if child == 0:
            time.sleep(60)
            os._exit(0)
        theirs.send(child)
        time.sleep(60)

    def refused(board, seconds=0.1):
        try:
            board.gather(["1.actual_position"], seconds)
        except pmac_dpram.PmacError as error:
            return str(error)
        return ""

    ours, theirs = FORK.Pipe(duplex=False)
    parent = FORK.Process(target=gather)
    parent.start()
    assert ours.poll(PATIENCE_S), "the parent hangs"
    child = ours.recv()
    try:
        assert refused(other)
        parent.kill()
        parent.join()
        began = time.monotonic()
        site.until(lambda: refused(other) == "", "the end of the parent's gather")
        assert time.monotonic() - began < 4, "pmacd ends it for 5 s of silence, too"
        os.kill(child, 0)
    finally:
        os.kill(child, 9)
