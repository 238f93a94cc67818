"""The page's commands and example run as they stand, but for the names of board and port."""

import pathlib
import re
import sys

import tango
from site_of_processes import free_ports

PAGE = (pathlib.Path(__file__).parents[1] / "README.md").read_text()


def test_one_minute_from_nothing_to_a_value(site, device, capsys):
    """The board and its daemon run already; the server is started as the page says."""
    (port,) = free_ports(1)
    (start,) = re.findall(r"```sh start\n(.*?)```", PAGE, re.DOTALL)
    daemon, server = start.strip().splitlines()
    assert daemon == "pmacd --board sim --name sim &"
    words = server.replace("10000", str(port)).replace("sim", f"{site.name} --socket {site.socket}").split()[:-1]
    program = pathlib.Path(sys.executable).parent / words[0]
    child = site.run(program, *words[1:])
    (example,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    example = compile(example.replace("10000", str(port)), "README.md", "exec")

    def runs():
        assert child.poll() is None, site.log()
        try:
            exec(example, {})
            return True
        except tango.DevFailed:
            return False

    site.until(runs, "the server")
    state, variable = capsys.readouterr().out.splitlines()[-2:]
    assert state.startswith("ON [") and variable == "32"
    site.until(lambda: device.SendCtrlChar("P").split()[0] == "2000", "motor 1 at 2000")
