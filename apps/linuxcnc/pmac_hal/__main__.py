"""``pmac-hal``: the motors of a board that pmacd drives, as HAL pins."""

import argparse
import signal
import sys
import time

import pmac_dpram

from .component import Component

ABOUT = """\
Shows the motors of a board of a running pmacd as HAL pins, and jogs them. NOT REAL TIME: it is a userspace component, its pins
follow the board some milliseconds late, and now and then much later. Close no loop over them, and build no interlock on them.
"""
# How long it waits for the board at its start.
PATIENCE_S = 10


def arguments():
    parser = argparse.ArgumentParser(prog="pmac-hal", description=ABOUT)
    parser.add_argument("--name", help="the board's name; pmac0 unless told otherwise")
    parser.add_argument("--socket", help="pmacd's socket; alone, it also tells the board")
    parser.add_argument("--component", default="pmac", help="what the names of all pins begin with; pmac")
    parser.add_argument("--period", type=float, default=0.01, help="seconds between two looks at board and pins; 0.01")
    options = parser.parse_args()
    if not 0.001 <= options.period <= 0.1:
        parser.error(f"--period {options.period}: 0.001 to 0.1 s")
    return options


def first_snapshot(board, period):
    """Live data with all that the board reports; an error after :data:`PATIENCE_S`."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            snapshot = board.snapshot()
            if len(snapshot.system) > 0:
                return snapshot
            error = pmac_dpram.StaleData("no background data come from the board; pmacctl doctor tells why")
        except pmac_dpram.StaleData as stale:
            error = stale
        if time.monotonic() > end:
            raise error
        time.sleep(period)


def main():
    options = arguments()

    def connect():
        return pmac_dpram.connect(options.name, options.socket)

    try:
        board = connect()
        snapshot = first_snapshot(board, options.period)
    except pmac_dpram.PmacError as error:
        print(f"pmac-hal: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    # `halcmd unload` ends a component by this signal.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    component = Component(options.component, board, snapshot, connect)
    try:
        while True:
            component.look()
            time.sleep(options.period)
    except KeyboardInterrupt:
        return 0
    finally:
        component.close()


if __name__ == "__main__":
    sys.exit(main())
