"""The page's HAL file does what it shows, and the page has every pin."""

import pathlib
import re
import subprocess

PAGE = (pathlib.Path(__file__).parents[1] / "README.md").read_text()


def test_one_minute_from_nothing_to_a_value(site, tmp_path):
    """As the page has it, but for the name of the board."""
    (commands,) = re.findall(r"```hal\n(.*?)```", PAGE, re.DOTALL)
    script = tmp_path / "pmac.hal"
    script.write_text(commands.replace("--name sim", f"--name {site.name} --socket {site.socket}"))
    printed = tmp_path / "printed"
    try:
        # The component keeps the files of halcmd open, so no pipe would come to its end.
        with open(printed, "w") as to:
            subprocess.run(["halcmd", "-f", script], stdout=to, stderr=to, check=True, timeout=60)
        assert re.search(r"float OUT +[0-9.e-]+ +pmac\.motor\.1\.position", printed.read_text()), printed.read_text()
    finally:
        subprocess.run(["halcmd", "unload", "pmac"], check=True, timeout=60)


def test_the_page_has_every_pin_and_no_other(site):
    named = set(re.findall(r"^\| `pmac\.(\S+)` \|", PAGE, re.MULTILINE))
    assert named == {re.sub(r"motor\.\d+\.", "motor.N.", pin) for pin in site.pins()}
