"""The page's examples run as they stand, but for the name of the board."""

import pathlib
import re

import pmac_dpram
import pytest

PAGE = (pathlib.Path(__file__).parents[1] / "README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES, ids=range(len(EXAMPLES)))
def test_the_examples_of_the_page_run(site, monkeypatch, capsys, example):
    site.connect().command("I2=3")
    monkeypatch.setattr(pmac_dpram, "connect", site.connect)
    exec(compile(example, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    if "snapshot" in example:
        assert printed.startswith("1 0.0 ") and printed.endswith("['32', '1']\n")
    elif "gather" in example:
        assert printed.endswith(" 0 ['servo_timer [servo cycles]', '1.actual_position [count]']\n"), printed
    elif "history" in example:
        assert printed.endswith(" 0 [0. 0. 0.]\n"), printed
    elif "updates" in example:
        assert printed.splitlines()[-1].startswith("0 ")
    else:
        assert printed == ""


def test_there_are_examples():
    assert len(EXAMPLES) == 5
