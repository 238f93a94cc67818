"""The screen for Phoebus: as its maker makes it, and of records that exist."""

import pathlib
import subprocess
import sys
from xml.etree import ElementTree

SCREEN = pathlib.Path(__file__).parents[1] / "screen"


def names():
    """The records that the screen shows, without the prefix."""
    root = ElementTree.parse(SCREEN / "pmac.bob").getroot()
    assert (root.tag, root.findtext("macros/P")) == ("display", "PMAC0:")
    found = {element.text for element in root.iter() if element.tag in ("pv_name", "x_pv", "y_pv")}
    assert all(name.startswith("$(P)") for name in found)
    return {name.removeprefix("$(P)") for name in found}


def test_the_screen_is_what_its_maker_makes():
    made = subprocess.run([sys.executable, SCREEN / "make.py"], capture_output=True, text=True, check=True).stdout
    assert made == (SCREEN / "pmac.bob").read_text(), "screen/make.py > screen/pmac.bob"


def test_every_record_of_the_screen_exists(ioc, context):
    found = names()
    assert len(found) > 60
    values = context.get([ioc.prefix + name for name in found], timeout=20, throw=False)
    assert [name for name, value in zip(found, values, strict=True) if isinstance(value, Exception)] == []


def test_what_the_screen_writes_may_be_written(ioc):
    root = ElementTree.parse(SCREEN / "pmac.bob").getroot()
    written = {entry.findtext("pv_name") for entry in root.iter("widget") if entry.get("type") == "textentry"}
    assert len(written) == 8 + 4
