"""The Tango device of a board: the commands that programs know from sites' own ``PmacEth`` servers, and live positions."""

import functools
import logging
import threading
import time

import pmac_dpram
import tango
from tango.server import Device, attribute, command, device_property

from .text import integer, read, written

log = logging.getLogger(__name__)

# Control characters that only ask; ^G answers in binary.
QUESTIONS = "BCFPV"
# Those that tell of a group of eight motors on a Turbo board.
OF_A_GROUP = "BFPV"
# A report tells what a motor does for so long, if no other one comes.
KNOWN_NS = 1_000_000_000
MOTORS, VARIABLES, PLCS = (1, 32), (0, 8191), (0, 31)


def tells_errors(call):
    """``call`` with every error as Tango's own; its reason is ERR003, DaemonGone and the like."""

    @functools.wraps(call)
    def told(self, *arguments):
        try:
            return call(self, *arguments)
        except pmac_dpram.PmacError as error:
            reason = f"ERR{error.code:03}" if error.code else type(error).__name__
            tango.Except.throw_exception(reason, str(error), call.__name__)
        except ValueError as error:
            tango.Except.throw_exception("WrongArgument", str(error), call.__name__)

    return told


class PmacEth(Device):
    """A board of a running pmacd."""

    Board = device_property(dtype=str, default_value="", doc="The board's name; pmac0 unless told otherwise")
    Socket = device_property(dtype=str, default_value="", doc="pmacd's socket; alone, it also tells the board")
    Timeout = device_property(
        dtype=float, default_value=2.5, doc="Seconds for a command line; less than Tango's own, so that clients see why"
    )
    JogStopClosesLoop = device_property(
        dtype=bool,
        default_value=False,
        doc="Whether JogStop also goes to a motor in open loop. It closes the loop, which switches the amplifier on",
    )

    of_command_line = (None, None)

    def init_device(self):
        super().init_device()
        # A stop waits for no other client's command. What is kept here is written under the lock alone.
        tango.Util.instance().set_serial_model(tango.SerialModel.NO_SYNC)
        self._lock, self._boards, self._is_turbo = threading.Lock(), {}, None

    def _board(self, purpose="lines"):
        """The board; commands of another purpose do not wait for those of this one."""
        with self._lock:
            if purpose not in self._boards:
                name, socket = self.of_command_line
                self._boards[purpose] = pmac_dpram.connect(self.Board or name, self.Socket or socket)
            return self._boards[purpose]

    def _send(self, line, purpose="own lines"):
        """The lines of the reply. Those of another purpose are no lines of a program that these have open, and the other way round."""
        return self._board(purpose).command(line, self.Timeout)

    def _ask(self, line):
        """The first line of the reply."""
        lines = self._send(line)
        if not lines:
            raise pmac_dpram.PmacError(f"the board took {line} and answered nothing")
        return lines[0]

    def _log(self, what):
        """What moves, stops or sets something is logged with whom it came from; pmacd logs this server's user and pid."""
        client = self.get_client_ident()
        log.info("%s of %s pid %s: %s", self.get_name(), client.client_ip, client.client_pid, what)

    def dev_state(self):
        self._look()
        return self.get_state()

    def dev_status(self):
        self._look()
        return self.get_status()

    def _look(self):
        """ON while the data are live."""
        try:
            self._board("data").snapshot()
        except pmac_dpram.PmacError as error:
            self.set_state(tango.DevState.FAULT)
            self.set_status(str(error))
        else:
            self.set_state(tango.DevState.ON)
            self.set_status("The board is live.")

    @tells_errors
    def _spectrum(self, value):
        """``value`` of motors 1 to the last one that the board reports; NaN where it is not known."""
        snapshot = self._board("data").snapshot()
        numbers = range(1, max(snapshot.motor, default=0) + 1)
        found = [value(snapshot.motor[number]) if number in snapshot.motor.keys() else None for number in numbers]
        values = [float("nan") if each is None else each for each in found]
        return values, snapshot.realtime_ns / 1e9, tango.AttrQuality.ATTR_VALID

    @attribute(dtype=(float,), max_dim_x=MOTORS[1], unit="counts", doc="Actual positions of motors 1, 2, …")
    def Positions(self):
        return self._spectrum(lambda motor: motor.position)

    @attribute(dtype=(float,), max_dim_x=MOTORS[1], unit="counts", doc="Following errors of motors 1, 2, …")
    def FollowingErrors(self):
        return self._spectrum(lambda motor: motor.following_error)

    @command(dtype_in=str, doc_in="A command line", dtype_out=str, doc_out="The lines of its reply")
    @tells_errors
    def OnlineCmd(self, line):
        self._log(line)
        return "\n".join(self._send(line, "lines"))

    @command(dtype_in=str, doc_in="A letter: B is ^B", dtype_out=str, doc_out="The reply")
    @tells_errors
    def SendCtrlChar(self, letter):
        letter = letter.removeprefix("^").upper()
        if letter in OF_A_GROUP:
            self._check_group()
        elif letter not in QUESTIONS:
            self._log(f"^{letter}")
        return " ".join(self._board().control(f"^{letter}"))

    def _check_group(self):
        """On a Turbo board ##n chooses whose motors ^B, ^F, ^P and ^V tell; a client takes the first for motor 1."""
        if self._is_turbo is None:
            self._is_turbo = self._ask("TYPE").startswith("TURBO")
        if self._is_turbo and (group := self._ask("##")) != "0":
            first = 8 * int(group) + 1
            raise ValueError(f"the board tells of motors {first} to {first + 7} (##{group}), not of 1 to 8; send ##0")

    @command(dtype_in=(float,), doc_in="Motor, position in counts")
    @tells_errors
    def JogToPos(self, argument):
        motor, position = self._pair(argument, "motor", MOTORS)
        if self._is_open(motor):
            raise ValueError(f"{self._open(motor)}; the line #{motor}J/ does so")
        self._log(f"#{motor}J={position}")
        self._board().jog_to(motor, position)

    @command(dtype_in=(int,), doc_in="Motor")
    @tells_errors
    def JogStop(self, motors):
        motor = self._motor(motors)
        if self._is_open(motor):
            if not self.JogStopClosesLoop:
                raise ValueError(
                    f"{self._open(motor)}; the line #{motor}J/ does so, and the property JogStopClosesLoop lets JogStop do it"
                )
            # pmacd's own stop may leave a killed motor out.
            self._log(f"#{motor}J/")
            self._board("stops").command(f"#{motor}J/", self.Timeout)
        else:
            self._log(f"#{motor} jog-stop")
            self._board("stops").panel("jog-stop", [motor])

    @staticmethod
    def _open(motor):
        return f"motor {motor} is in open loop (killed, or a fault): nothing was sent, for it would close the loop"

    def _is_open(self, motor):
        """Whether a recent report shows the loop open. Where nothing is known, a stop is better sent."""
        snapshot = self._board("data").snapshot(stale_ok=True)
        if time.monotonic_ns() - snapshot.time_ns > KNOWN_NS or motor not in snapshot.motor.keys():
            return False
        return snapshot.motor[motor].status.open_loop

    @command(dtype_in=(int,), doc_in="Motor")
    @tells_errors
    def KillMotor(self, motors):
        motor = self._motor(motors)
        self._log(f"#{motor}K")
        self._board("stops").command(f"#{motor}K", self.Timeout)

    @command(dtype_in=int, doc_in="n of In", dtype_out=float)
    @tells_errors
    def GetIVariable(self, number):
        return self._get("I", number)

    @command(dtype_in=(float,), doc_in="n of In, value")
    @tells_errors
    def SetIVariable(self, argument):
        self._set("I", argument)

    @command(dtype_in=int, doc_in="n of Pn", dtype_out=float)
    @tells_errors
    def GetPVariable(self, number):
        return self._get("P", number)

    @command(dtype_in=(float,), doc_in="n of Pn, value")
    @tells_errors
    def SetPVariable(self, argument):
        self._set("P", argument)

    @command(dtype_in=int, doc_in="n of Mn", dtype_out=float)
    @tells_errors
    def GetMVariable(self, number):
        return self._get("M", number)

    @command(dtype_in=(float,), doc_in="n of Mn, value")
    @tells_errors
    def SetMVariable(self, argument):
        self._set("M", argument)

    @command(dtype_in=int, doc_in="A PLC program")
    @tells_errors
    def EnablePLC(self, number):
        self._plc("ENABLE", number)

    @command(dtype_in=int, doc_in="A PLC program")
    @tells_errors
    def DisablePLC(self, number):
        self._plc("DISABLE", number)

    def _plc(self, verb, number):
        line = f"{verb} PLC {integer(number, 'PLC', *PLCS)}"
        self._log(line)
        self._send(line)

    def _get(self, kind, number):
        return read(self._ask(f"{kind}{integer(number, kind, *VARIABLES)}"))

    def _set(self, kind, argument):
        number, value = self._pair(argument, kind, VARIABLES)
        line = f"{kind}{number}={written(value)}"
        self._log(line)
        self._send(line)

    @staticmethod
    def _pair(argument, what, limits):
        if len(argument) != 2:
            raise ValueError(f"{len(argument)} values: give two, [{what}, value]")
        return integer(argument[0], what, *limits), float(argument[1])

    @staticmethod
    def _motor(motors):
        if len(motors) != 1:
            raise ValueError(f"{len(motors)} values: give one, [motor]")
        return integer(motors[0], "motor", *MOTORS)
