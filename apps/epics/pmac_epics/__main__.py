"""``python -m pmac_epics``: an EPICS server (Channel Access and PV Access) of a board that pmacd drives."""

import argparse
import functools
import logging
import os
import re
import sys
import time

import pmac_dpram

ABOUT = """\
Serves a board of a running pmacd to EPICS, by Channel Access and PV Access. Neither protocol has a password: whoever reaches
the server has the roles of its user. It serves this machine only, unless EPICS_CAS_INTF_ADDR_LIST and
EPICS_PVAS_INTF_ADDR_LIST name other addresses; --read-only refuses every put.
"""


def arguments(line=None):
    parser = argparse.ArgumentParser(prog="pmac-epics", description=ABOUT)
    parser.add_argument("--name", help="the board's name; pmac0 unless told otherwise")
    parser.add_argument("--socket", help="pmacd's socket; alone, it also tells the board")
    parser.add_argument("--prefix", help="what the names of all records begin with; the board's name and a colon, PMAC0:")
    parser.add_argument("--read-only", action="store_true", help="take no puts")
    found = parser.parse_args(line)
    if found.prefix is not None and not re.fullmatch(r"[A-Za-z0-9_:;<>\[\]-]{1,40}", found.prefix):
        parser.error(f"--prefix {found.prefix!r}: 1 to 40 letters, digits and _ : ; < > [ ] -")
    return found


def once_live(begin):
    """What ``begin`` returns, once it finds live data. Whatever only time can cure is waited for."""
    told = None
    while True:
        try:
            return begin()
        except (pmac_dpram.DaemonGone, pmac_dpram.StaleData) as error:
            if str(error) != told:
                told = str(error)
                logging.warning("waiting for the board: %s", error)
            time.sleep(0.5)


def main():
    options = arguments()
    logging.basicConfig(format="%(levelname)s %(message)s", level=logging.INFO)
    for variable in ("EPICS_CAS_INTF_ADDR_LIST", "EPICS_PVAS_INTF_ADDR_LIST"):
        os.environ.setdefault(variable, "127.0.0.1")
    # EPICS reads its environment when it is loaded.
    from softioc import asyncio_dispatcher, builder, imports, softioc

    from .records import ACCESS
    from .server import Server

    def begin():
        connect = functools.partial(pmac_dpram.connect, options.name, options.socket)
        return Server(connect, options.prefix, not options.read_only)

    try:
        server = once_live(begin)
    except pmac_dpram.PmacError as error:
        print(f"pmac-epics: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
    # Each put is logged with the client's user and host.
    imports.install_pv_logging(str(ACCESS))
    builder.LoadDatabase()
    dispatcher = asyncio_dispatcher.AsyncioDispatcher()
    softioc.iocInit(dispatcher)
    server.follow()
    refused = ", puts are refused" if options.read_only else ""
    logging.info("serves %s as %s*%s", server.name, server.prefix, refused)
    dispatcher.wait_for_quit()
    server.close()
    softioc.epicsExit(0)


if __name__ == "__main__":
    main()
