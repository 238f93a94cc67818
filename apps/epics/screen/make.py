"""Writes a Phoebus screen (.bob) of a board: ``make.py --motors 8 > pmac.bob``. Its macro P is the prefix."""

import argparse
import itertools
from xml.etree import ElementTree as XML

ROW, TOP = 30, 90
# Of the traces of a plot; also people who do not see all colours tell these apart.
COLORS = [(0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0), (0, 0, 0), (128, 128, 128)]
# Column, its record, its place and width.
COLUMNS = [
    ("Position", "RBV", 110, 130),
    ("Target", "VAL", 250, 110),
    ("Following error", "FERR", 370, 120),
    ("State", "STAT", 500, 150),
]


def widget(display, kind, x, y, width, height, **properties):
    version = "2.0.0" if kind in ("label", "textupdate") else "3.0.0"
    made = XML.SubElement(display, "widget", type=kind, version=version)
    XML.SubElement(made, "name").text = f"{kind}_{x}_{y}"
    for name, value in {"x": x, "y": y, "width": width, "height": height, **properties}.items():
        XML.SubElement(made, name).text = str(value)
    return made


def button(display, x, y, width, text, pv):
    """A button that writes 1."""
    made = widget(display, "action_button", x, y, width, ROW - 5, text=text, pv_name=pv)
    action = XML.SubElement(XML.SubElement(made, "actions"), "action", type="write_pv")
    for name, value in {"pv_name": pv, "value": 1, "description": text}.items():
        XML.SubElement(action, name).text = str(value)


def plot(display, x, y, width, height, title, traces):
    made = widget(display, "xyplot", x, y, width, height, title=title)
    entry = XML.SubElement(XML.SubElement(made, "y_axes"), "y_axis")
    XML.SubElement(entry, "autoscale").text = "true"
    entry = XML.SubElement(made, "x_axis")
    XML.SubElement(entry, "autoscale").text = "true"
    listed = XML.SubElement(made, "traces")
    for (name, x_pv, y_pv), color in zip(traces, itertools.cycle(COLORS)):
        trace = XML.SubElement(listed, "trace")
        for key, value in {"name": name, "x_pv": x_pv, "y_pv": y_pv, "axis": 0, "trace_type": 1}.items():
            XML.SubElement(trace, key).text = str(value)
        shares = dict(zip(("red", "green", "blue"), map(str, color), strict=True))
        XML.SubElement(XML.SubElement(trace, "color"), "color", shares)


def screen(prefix, motors):
    """The screen; its macro P is ``prefix`` unless who opens it says otherwise."""
    display = XML.Element("display", version="2.0.0")
    bottom = TOP + ROW * (motors + 1)
    XML.SubElement(XML.SubElement(display, "macros"), "P").text = prefix
    prefix = "$(P)"
    for name, value in {"name": f"PMAC {prefix}", "width": 900, "height": bottom + 460}.items():
        XML.SubElement(display, name).text = str(value)
    widget(display, "label", 10, 10, 120, ROW, text=f"PMAC {prefix}")
    widget(display, "textupdate", 140, 10, 80, ROW - 5, pv_name=f"{prefix}CONN")
    widget(display, "textupdate", 230, 10, 650, ROW - 5, pv_name=f"{prefix}WHY", format=6)
    widget(display, "label", 10, 45, 120, ROW, text="Missed, lost")
    widget(display, "textupdate", 140, 45, 80, ROW - 5, pv_name=f"{prefix}MISSED")
    widget(display, "textupdate", 230, 45, 80, ROW - 5, pv_name=f"{prefix}LOST")
    for title, _, x, width in COLUMNS:
        widget(display, "label", x, TOP, width, ROW, text=title)
    for number in range(1, motors + 1):
        y, motor = TOP + ROW * number, f"{prefix}M{number}:"
        widget(display, "label", 10, y, 90, ROW, text=f"Motor {number}")
        for _, record, x, width in COLUMNS:
            kind = "textentry" if record == "VAL" else "textupdate"
            widget(display, kind, x, y, width, ROW - 5, pv_name=f"{motor}{record}")
        button(display, 660, y, 60, "Stop", f"{motor}STOP")
        widget(display, "textupdate", 730, y, 160, ROW - 5, pv_name=f"{motor}MSG", format=6)
    y = bottom + 20
    widget(display, "label", 10, y, 90, ROW, text="Command")
    widget(display, "textentry", 110, y, 250, ROW - 5, pv_name=f"{prefix}CMD", format=6)
    widget(display, "textupdate", 370, y, 250, ROW - 5, pv_name=f"{prefix}REPLY", format=6)
    widget(display, "textupdate", 630, y, 260, ROW - 5, pv_name=f"{prefix}MSG", format=6)
    y += ROW + 10
    widget(display, "label", 10, y, 90, ROW, text="Gather")
    widget(display, "textentry", 110, y, 250, ROW - 5, pv_name=f"{prefix}GATHER:SOURCES", format=6)
    widget(display, "textentry", 370, y, 60, ROW - 5, pv_name=f"{prefix}GATHER:SECONDS")
    widget(display, "textentry", 440, y, 60, ROW - 5, pv_name=f"{prefix}GATHER:PERIOD")
    button(display, 510, y, 60, "Start", f"{prefix}GATHER:START")
    widget(display, "textupdate", 580, y, 90, ROW - 5, pv_name=f"{prefix}GATHER:STATE")
    widget(display, "textupdate", 680, y, 210, ROW - 5, pv_name=f"{prefix}GATHER:MSG", format=6)
    y += ROW + 10
    errors = [(f"motor {number}", f"{prefix}TIME", f"{prefix}M{number}:FE") for number in range(1, motors + 1)]
    plot(display, 10, y, 435, 340, "Following error, last block", errors)
    gathered = [(f"column {number}", f"{prefix}GATHER:TIME", f"{prefix}GATHER:DATA{number}") for number in range(1, 3)]
    plot(display, 455, y, 435, 340, "Gathered", gathered)
    XML.indent(display)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + XML.tostring(display, encoding="unicode") + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prefix", default="PMAC0:")
    parser.add_argument("--motors", type=int, default=8)
    options = parser.parse_args()
    print(screen(options.prefix, options.motors), end="")
