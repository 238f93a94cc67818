"""A simulated board, pmacd and pmac-web as processes, and a browser without a screen."""

import copy
import os
import pathlib
import re
import shutil
import tempfile
import urllib.request

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from board_of_processes import PROGRAMS
from site_of_processes import Site

NAMED = '[[motor]]\nnumber = 1\nname = "AZ"\nunit = "deg"\ncounts_per_unit = 1000\n'
WORDS = """
[[user]]
name = "count"
address = "$DA10"
format = "DP"
unit = "part"

[[user]]
name = "pair"
address = "$DA11"
format = "Y"
count = 2
"""
# Motor 1 goes to and fro for ever.
PROGRAM = ["&1#1->1000X", "OPEN PROG 5 CLEAR", "LINEAR INC TA100 TS50 TM300", "WHILE (1=1)", "X2", "X-2", "ENDWHILE", "CLOSE"]


class Shown:
    """A board that is shown by pmac-web at ``url``."""

    def __init__(self, directory, *options, **site):
        self.site = Site(directory, **site)
        self.web = self.start(*options)

    def start(self, *options):
        """Starts pmac-web and waits for its address."""
        listening = re.compile(r"listening on (http://\S+)")
        before = len(listening.findall(self.site.log()))
        place = ("--name", self.site.name, "--socket", self.site.socket)
        web = self.site.run(PROGRAMS / "pmac-web", *place, "--listen", "127.0.0.1:0", *options)
        self.site.until(lambda: len(listening.findall(self.site.log())) > before, "pmac-web")
        self.url = listening.findall(self.site.log())[-1]
        return web

    def get(self, path, patience=10):
        """What is answered, as text."""
        with urllib.request.urlopen(self.url + path, timeout=patience) as answer:
            return answer.read().decode()

    def send(self, *lines):
        board = self.site.connect()
        for line in lines:
            board.command(line)


def shown(**options):
    directory = tempfile.mkdtemp(dir="/dev/shm")
    try:
        own = Shown(directory, **options)
        try:
            yield own
        finally:
            own.site.close()
    finally:
        shutil.rmtree(directory)


@pytest.fixture(scope="module")
def moving():
    """A classic board whose motor 1 has a name and moves, and whose programs have words."""
    for own in shown(configuration=NAMED + WORDS):
        own.send("M200->DP:$DA10", "M201->Y:$DA11,0,16", "M202->Y:$DA12,0,16", "M200=-7 M201=5 M202=6")
        own.send(*PROGRAM, "&1B5R")
        yield own


@pytest.fixture
def board():
    """A board of one's own."""
    yield from shown()


@pytest.fixture
def watching(moving):
    """The moving board on another page, which watches variables."""
    page = copy.copy(moving)
    moving.send("P1=12.5 P2=-7")
    web = page.start("--watch", "P1,p2", "--watch", "I122")
    yield page
    web.kill()


@pytest.fixture
def turbo():
    """A Turbo board of one's own."""
    yield from shown(simulator=("--family", "turbo2"), configuration='family = "turbo2"\n')


@pytest.fixture(autouse=True)
def picture(request):
    """Saves what is seen in the end, for somebody to look at, if PMAC_PICTURES names a directory."""
    yield
    if (directory := os.environ.get("PMAC_PICTURES")) and "browser" in request.fixturenames:
        request.getfixturevalue("browser").save_screenshot(str(pathlib.Path(directory) / f"{request.node.name}.png"))


@pytest.fixture(scope="module")
def browser():
    """Chromium without a screen. It must not look for other computers."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    profile = tempfile.mkdtemp()
    quiet = ["headless", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run", "disable-dev-shm-usage"]
    quiet += ["disable-background-networking", "disable-component-update", "disable-sync", "window-size=1280,1500"]
    for option in quiet + [f"user-data-dir={profile}"]:
        options.add_argument(f"--{option}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        yield driver
    finally:
        driver.quit()
        shutil.rmtree(pathlib.Path(profile), ignore_errors=True)
