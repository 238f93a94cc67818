"""An ophyd device for a motor of the server: set, read, stop, monitor. For bluesky's plans.

    from pmac_epics.device import PmacMotor
    x = PmacMotor("PMAC0:M1", name="x")
"""

import threading

from ophyd import Component, Device, EpicsSignal, EpicsSignalRO, Kind
from ophyd.status import DeviceStatus


class PmacMotor(Device):
    """One motor. ``set`` is done when the motor has stopped, and has failed when it stopped elsewhere or was refused."""

    readback = Component(EpicsSignalRO, ":RBV", kind=Kind.hinted)
    setpoint = Component(EpicsSignal, ":VAL", kind=Kind.normal)
    following_error = Component(EpicsSignalRO, ":FERR", kind=Kind.normal)
    state = Component(EpicsSignalRO, ":STAT", string=True, kind=Kind.omitted)
    done = Component(EpicsSignalRO, ":DMOV", kind=Kind.omitted)
    message = Component(EpicsSignalRO, ":MSG", string=True, kind=Kind.omitted)
    stop_signal = Component(EpicsSignal, ":STOP", kind=Kind.omitted)

    def __init__(self, prefix, *, name, tolerance=1.0, **options):
        super().__init__(prefix, name=name, **options)
        self.tolerance = tolerance
        # The readback goes by the device's own name, as bluesky's plots and tables expect of a motor.
        self.readback.name = self.name

    @property
    def position(self):
        """Where the motor is, in its unit."""
        return self.readback.get()

    def set(self, target, *, timeout=60.0):
        """Moves to ``target``, in the motor's unit."""
        status = DeviceStatus(self, timeout=timeout)
        lock, taken, over = threading.Lock(), threading.Event(), threading.Event()

        def finish(error=None):
            with lock:
                if over.is_set():
                    return
                over.set()
            if error is None:
                status.set_finished()
            else:
                status.set_exception(error)

        def refused(value, **_):
            if value:
                finish(RuntimeError(f"{self.name}: {value}"))

        def done(value, **_):
            if not value:
                taken.set()
            elif taken.is_set():
                where = self.position
                missed = abs(where - target) > self.tolerance
                finish(RuntimeError(f"{self.name} stopped at {where}, not at {target}") if missed else None)

        self.message.subscribe(refused, run=False)
        self.done.subscribe(done, run=False)

        def forget(_):
            self.message.unsubscribe(refused)
            self.done.unsubscribe(done)

        status.add_callback(forget)
        self.setpoint.put(target, wait=False)
        return status

    def stop(self, *, success=False):
        """Stops the motor where it is."""
        self.stop_signal.put(1, wait=False)
