"""``PmacEth``: a Tango server of boards that pmacd drives."""

import argparse
import logging
import sys

from .device import PmacEth

LOOPBACK = "giop:tcp:127.0.0.1:"
ABOUT = """\
Serves boards of running pmacds to Tango: each device one board. Tango has no password: whoever reaches the server sends any
command line. It listens on this machine only, unless -ORBendPoint says otherwise.
"""


def main():
    parser = argparse.ArgumentParser(
        prog="PmacEth",
        usage="PmacEth [--name NAME] [--socket PATH] INSTANCE [options of Tango, as -nodb -dlist a/b/c -ORBendPoint ...]",
        description=ABOUT,
        allow_abbrev=False,
    )
    parser.add_argument("--name", help="the board of devices without a property Board; pmac0 unless told otherwise")
    parser.add_argument("--socket", help="pmacd's socket, for devices without a property Socket; alone, it also tells the board")
    options, tango = parser.parse_known_args()
    if not tango or tango[0].startswith("-"):
        parser.error("the first argument is the server's instance, any name")
    if "-ORBendPoint" not in tango:
        tango += ["-ORBendPoint", LOOPBACK]
    logging.basicConfig(format="%(levelname)s %(message)s", level=logging.INFO)
    PmacEth.of_command_line = (options.name, options.socket)
    PmacEth.run_server(["PmacEth", *tango])


if __name__ == "__main__":
    sys.exit(main())
