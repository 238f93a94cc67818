"""dls-pmaccontrol, the window itself, without a screen: it connects, follows the motors, jogs, kills and gathers."""

import os
import pathlib
import types

import pytest
from board_of_processes import until

os.environ["QT_QPA_PLATFORM"] = "offscreen"

from dls_pmac_control.__main__ import Controlform  # noqa: E402
from PyQt5.QtWidgets import QApplication, QMessageBox  # noqa: E402

POSITION, VELOCITY = 0, 1
SOURCES = ["Motor present desired position", "Motor present actual position", "Motor following error"]


class Window:
    """The program's window, its event loop turned by whoever waits."""

    def __init__(self, site):
        host, port = site.address
        options = types.SimpleNamespace(
            server=host,
            port=str(port),
            protocol="tcpip",
            defaultAxis=1,
            macroAxisStartIndex=0,
            nAxes=8,
            timeout=20.0,
            username="",
            password="",
            verbose=False,
        )
        self.form = Controlform(options)
        self.form.show()

    def until(self, condition, what):
        def turned():
            QApplication.processEvents()
            return condition()

        return until(turned, what)

    def connect(self):
        self.form.btnConnect.click()
        self.until(lambda: self.form.btnDisconnect.isEnabled() and self.cell(8, POSITION), "the first poll")

    def cell(self, motor, column):
        item = self.form.table.item(motor - 1, column)
        return item.text() if item else ""

    def position(self, motor):
        return float(self.cell(motor, POSITION))

    def picture(self, name, widget=None):
        """Saves what is seen, for somebody to look at, if PMAC_PICTURES names a directory."""
        if directory := os.environ.get("PMAC_PICTURES"):
            assert (widget or self.form).grab().save(str(pathlib.Path(directory) / f"{name}.png"))

    def close(self):
        self.form.die()
        # Its thread polls until it is told to end.
        self.until(lambda: not self.form.commsThread.updateThreadHandle.is_alive(), "the end of its thread")
        self.form.close()


@pytest.fixture(scope="module")
def application():
    return QApplication.instance() or QApplication(["dls-pmac-control"])


@pytest.fixture
def window(site, application, monkeypatch):
    def fail(parent, title, text):
        raise AssertionError(f"{title}: {text}")

    # It would wait for somebody to press its button.
    monkeypatch.setattr(QMessageBox, "information", fail)
    window = Window(site)
    yield window
    window.close()


def test_it_connects_and_follows_the_motors(site, window):
    window.connect()
    assert window.form.windowTitle() == "Delta Tau motor controller - Turbo PMAC2-VME"
    # A poll asks 52 values in one line of 131 characters: were one of them missing, the rows would be shifted.
    targets = {motor: 1000 * motor - 4250.5 for motor in range(1, 9)}
    site.send(" ".join(f"#{motor}J={target}" for motor, target in targets.items()))
    window.until(lambda: all(abs(window.position(motor) - targets[motor]) < 1 for motor in targets), "the motors")
    window.until(lambda: all(abs(float(window.cell(motor, VELOCITY))) < 0.5 for motor in targets), "them to stand")
    assert window.form.lblIdentity.text() == "Identity not set"
    status = window.form.statusScreen
    status.show()
    lit = window.form.greenLedOn.cacheKey()

    def flags():
        lamps = [led.pixmap() for led in status.lstLeds]
        return {name for name, lamp in zip(status.lstLabelTexts, lamps) if lamp and lamp.cacheKey() == lit}

    expected = {"In position", "Desired velocity zero", "Integration mode", "Amplifier enabled", "Motor activated"}
    window.until(lambda: flags() == expected, f"{expected}")
    window.picture("status", status)


def test_it_jogs_and_kills(site, window):
    form = window.form
    window.connect()
    form.spnJogMotor.setValue(2)
    form.lneJogTo.setText("3000")
    form.btnJogTo.click()
    window.until(lambda: abs(window.position(2) - 3000) < 2, "the end of the jog")
    form.chkJogInc.setChecked(True)
    form.lneJogDist.setText("1000")
    form.btnJogNeg.click()
    window.until(lambda: abs(window.position(2) - 2000) < 2, "the end of the step")
    form.chkJogInc.setChecked(False)
    form.btnJogPos.pressed.emit()
    window.until(lambda: window.position(2) > 2200 and float(window.cell(2, VELOCITY)) > 1, "motion")
    window.picture("jogging")
    form.btnJogPos.released.emit()
    window.until(lambda: abs(float(window.cell(2, VELOCITY))) < 0.5, "the motor to stand")
    form.lneSend.setText("#2p")
    form.btnSend.click()
    assert form.txtShell.toPlainText().splitlines()[-2] == "#2p"
    assert abs(float(form.txtShell.toPlainText().splitlines()[-1]) - window.position(2)) < 2

    def is_open(motor):
        return int(site.send(f"#{motor}?")[0], 16) >> 42 & 1

    form.btnKillMotor.click()
    window.until(lambda: is_open(2), "the open loop")
    assert not is_open(1)
    # ^K inside a GETRESPONSE.
    form.btnKillAll.click()
    window.until(lambda: is_open(1) and is_open(8), "all loops open")
    assert site.has_told("^K")


def test_it_gathers_what_moves_and_plots_it(site, window):
    form = window.form
    window.connect()
    form.dataGather()
    gather = form.pmacgatherScreen
    for index, source in enumerate(SOURCES):
        gather.lstCheckboxes[index].setChecked(True)
        gather.lstSpinboxes[index].setValue(4)
        combo = gather.lstComboboxes[index]
        combo.setCurrentIndex(combo.findText(source))
    gather.lneSampleTime.setText("2")
    gather.lneNumberSamples.setText("400")
    gather.applyConfigClicked()
    gather.changedNoSamples()
    gather.setupClicked()
    assert site.send("I5050 I5049") == ["$7", "2"]
    site.send("#4J+")
    # 32 counts/ms, reached after 200 ms.
    window.until(lambda: window.position(4) > 10_000, "the motor at its velocity")
    gather.triggerClicked()
    window.until(gather.btnCollect.isEnabled, "the time that gathering takes")
    # Bit 19 of the first word of `???`: gathering. The time of a simulated board on a busy machine is longer.
    window.until(lambda: not int(site.send("???")[0][:6], 16) & 0x080000, "the end of gathering")
    site.send("#4J/")
    gather.collectClicked()
    desired, actual, error = (channel.scaledData for channel in gather.lstChannels)
    assert 400 <= len(desired) and len(desired) - len(actual) in (0, 1), [len(desired), len(actual), len(error)]
    step = 2 * int(site.send("I10")[0]) / 8388608 * 32
    assert all(abs(b - a - step) < 0.1 for a, b in zip(desired, desired[1:])), [step, *desired]
    assert all(abs(a - b - c) < 2 and c > 1 for a, b, c in zip(desired, actual, error)), [desired, actual, error]
    for channel in gather.lstChannels:
        plotted = channel.qwtCurve.data()
        assert list(plotted.xData()) == list(range(len(channel.scaledData)))
        assert list(plotted.yData()) == list(channel.scaledData)
    window.picture("gather", gather)
