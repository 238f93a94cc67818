"""An ophyd device for a motor of the server: set, read, stop, monitor. For bluesky's plans.

    from pmac_epics.device import PmacMotor
    x = PmacMotor("PMAC0:M1", name="x", tolerance=10)
"""

import contextlib
import threading

from ophyd import Component, Device, EpicsSignal, EpicsSignalRO, Kind
from ophyd.status import DeviceStatus
from ophyd.utils import InvalidState, StatusTimeoutError
from ophyd.utils.epics_pvs import AlarmStatus

DONE = 1


class PmacMotor(Device):
    """One motor. ``set`` is done when the motor stands. It has failed when the motor stands further than ``tolerance`` (in its
    unit) from the target, when the server refused the move, and when pmacd is gone.
    """

    readback = Component(EpicsSignalRO, ":RBV", kind=Kind.hinted, auto_monitor=True)
    setpoint = Component(EpicsSignal, ":VAL", kind=Kind.normal)
    following_error = Component(EpicsSignalRO, ":FERR", kind=Kind.normal, auto_monitor=True)
    state = Component(EpicsSignalRO, ":STAT", string=True, kind=Kind.omitted)
    done = Component(EpicsSignalRO, ":DMOV", kind=Kind.omitted, auto_monitor=True)
    message = Component(EpicsSignalRO, ":MSG", string=True, kind=Kind.omitted)
    stop_signal = Component(EpicsSignal, ":STOP", kind=Kind.omitted)

    def __init__(self, prefix, *, name, tolerance, **options):
        super().__init__(prefix, name=name, **options)
        self.tolerance, self._latest = tolerance, None
        # The readback goes by the device's own name, as bluesky's plots and tables expect of a motor.
        self.readback.name = self.name

    @property
    def position(self):
        """Where the motor is, in its unit."""
        return self.readback.get(use_monitor=False)

    def set(self, target, *, timeout=60.0):
        """Moves to ``target``, in the motor's unit. After ``timeout`` seconds its latest move is stopped."""
        # By itself the status would also stop the move of a later target.
        status = self._latest = DeviceStatus(self, timeout=timeout, call_stop_on_failure=False)
        taken = threading.Event()

        def finish(error=None):
            # Reports go on while the first that finished it is worked on.
            with contextlib.suppress(InvalidState):
                if error is None:
                    status.set_finished()
                else:
                    status.set_exception(RuntimeError(f"{self.name}: {error}"))

        def look(**_):
            # Until the put is complete DMOV tells of the move before. A monitor may tell what is no longer so: it is asked.
            if not taken.is_set():
                return
            now = self.done.get(use_monitor=False)
            if self.done.alarm_status == AlarmStatus.COMM:
                finish("pmacd is gone; whether the motor moves is not known")
            elif self.done.alarm_status == AlarmStatus.NO_ALARM and now == DONE:
                where = self.position
                is_there = abs(where - target) <= self.tolerance
                finish(None if is_there else f"stands at {where}, not at {target}")

        def put_is_complete(**_):
            error = self.message.get(use_monitor=False)
            if error:
                finish(error)
                return
            taken.set()
            look()

        def over(_):
            self.done.unsubscribe(look)
            if isinstance(status.exception(), StatusTimeoutError) and self._latest is status:
                self.stop()

        self.done.subscribe(look, run=False)
        status.add_callback(over)
        self.setpoint.put(target, use_complete=True, callback=put_is_complete)
        return status

    def stop(self, *, success=False):
        """Stops the motor where it is."""
        self.stop_signal.put(1, wait=False)
