"""The page in a browser."""

import contextlib
import json
import pathlib

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select
from board_of_processes import PROGRAMS, until

CAPTURE = pathlib.Path(__file__).parents[2] / "tests" / "captures" / "simulator-pmac"


def text(browser, selector):
    return browser.find_element(By.CSS_SELECTOR, selector).text


def rows(browser, table):
    """The rows at one moment: the page makes new ones all the time."""
    cells = "[...row.cells].map((cell) => cell.innerText).join(' ')"
    return browser.execute_script(f"return [...document.getElementById('{table}').tBodies[0].rows].map((row) => {cells})")


def open_page(browser, own):
    browser.get(own.url)
    until(lambda: text(browser, "#condition") == "live", "a live page")


@contextlib.contextmanager
def window(browser, width, height):
    """A window of this size, also smaller than a desktop's windows can be."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 700}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        yield
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def shown(browser):
    """The samples that the plot shows: how many, and the last trace's values."""
    return browser.execute_script("const data = scope.shown(); return data.map((trace) => trace.length ? [...trace] : [])")


def span(times):
    return times[-1] - times[0] if len(times) else 0


def test_motors_systems_and_health_are_shown(moving, browser):
    open_page(browser, moving)
    assert text(browser, "#name") == moving.site.name
    assert "1.16D" in text(browser, "#board")
    motors = rows(browser, "motors")
    assert len(motors) == 8
    assert motors[0].startswith("#1 AZ ") and " deg " in motors[0] and "timed-move" in motors[0], motors[0]
    assert len(rows(browser, "systems")) == 8 and "running-program" in rows(browser, "systems")[0]
    assert rows(browser, "words") == ["count -7 part", "pair 5 6 "]
    assert "servo data" in text(browser, "#health") and "missed" in text(browser, "#counters")
    first = rows(browser, "motors")[0]
    until(lambda: rows(browser, "motors")[0] != first, "another position")
    assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []


def test_the_scope_shows_every_update_of_the_traces(moving, browser):
    counters = json.loads(moving.get("/state"))["counters"]
    open_page(browser, moving)
    until(lambda: span(shown(browser)[0]) > 1.9, "two seconds of updates")
    times, commanded, position, error = shown(browser)
    # The state is taken five times a second.
    until(lambda: json.loads(moving.get("/state"))["counters"]["updates"] > counters["updates"] + len(times), "a later state")
    after = json.loads(moving.get("/state"))["counters"]
    period = json.loads(moving.get("/state"))["servo_period_ns"] / 1e9
    absent = round(span(times) / period) + 1 - len(times)
    assert absent <= after["missed"] - counters["missed"] + after["skipped"] - counters["skipped"], "what pmacd read is shown"
    assert max(position) - min(position) > 1000, "the motor moves"
    assert max(error) > 0 > min(error)
    assert max(commanded) - min(commanded) > 1000
    scales = browser.execute_script("return scope.scales()")
    assert scales[0] == scales[1] != scales[2], "commanded and actual position are on one axis"
    Select(browser.find_element(By.ID, "field")).select_by_value("velocity")
    browser.find_element(By.ID, "add").click()
    until(lambda: len(shown(browser)) == 5 and len(shown(browser)[4]) > 100, "the velocity")
    until(lambda: "counts/s" in text(browser, "#traces button:last-child"), "its unit and value")
    browser.find_elements(By.CSS_SELECTOR, "#traces button")[3].click()
    until(lambda: len(shown(browser)) == 4, "the velocity to go")


def test_the_trigger_holds_a_picture(moving, browser):
    open_page(browser, moving)
    Select(browser.find_element(By.ID, "span")).select_by_value("0.5")
    level = browser.find_element(By.ID, "level")
    level.clear()
    level.send_keys("1000")
    Select(browser.find_element(By.ID, "mode")).select_by_value("single")
    until(lambda: text(browser, "#run") == "run", "a single picture")
    until(lambda: max(shown(browser)[0], default=0) > 0.39, "its samples")
    times, position, *_ = shown(browser)
    after = next(index for index, time in enumerate(times) if time >= -1e-9)
    assert position[after - 1] < 1000 <= position[after], "it rises past the level at time 0"
    assert times[0] < -0.09
    browser.find_element(By.ID, "run").click()
    Select(browser.find_element(By.ID, "mode")).select_by_value("free")
    until(lambda: text(browser, "#run") == "stop", "it to run again")


def test_old_data_say_so_and_the_page_comes_back(board, browser):
    open_page(browser, board)
    board.site.kill_daemon()
    until(lambda: text(browser, "#condition") in ("stale", "absent"), "a page that says it")
    until(lambda: "pmacd" in text(browser, "#reason"), "why")
    board.site.start_daemon()
    until(lambda: text(browser, "#condition") == "live", "the new daemon")
    board.web.kill()
    until(lambda: text(browser, "#condition") == "disconnected", "a page that notices")
    assert "old" in browser.find_element(By.CSS_SELECTOR, "#motors tbody td:nth-child(3)").get_attribute("class")


def test_a_turbo_board_has_its_motors(turbo, browser):
    open_page(browser, turbo)
    until(lambda: len(rows(browser, "motors")) == 32, "32 motors")
    assert not browser.find_element(By.ID, "own").is_displayed(), "words that no configuration names"
    assert "turbo2" in text(browser, "#board")
    assert len(rows(browser, "systems")) == 16
    # The board reports no commanded position.
    until(lambda: span(shown(browser)[0]) > 0.5, "half a second of updates")
    _, commanded, actual, error = shown(browser)
    assert all(abs(c - a - e) < 1e-6 for c, a, e in zip(commanded, actual, error)) and len(commanded) == len(error)


@pytest.mark.parametrize("width, height", [(1300, 900), (390, 844)])
def test_32_motors_and_the_scope_have_room(turbo, browser, width, height):
    with window(browser, width, height):
        open_page(browser, turbo)
        until(lambda: len(rows(browser, "motors")) == 32, "32 motors")
        place = "const place = document.querySelector(arguments[0]).getBoundingClientRect(); return place.toJSON()"
        plot, row = (browser.execute_script(place, part) for part in ("#plot canvas", "#motors tbody tr:last-child"))
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        assert plot["left"] >= 0 and plot["right"] <= width and plot["width"] > 340 and plot["height"] > 200
        assert plot["bottom"] <= height, "the scope is seen at once"
        assert plot["left"] >= row["right"] or plot["bottom"] <= row["top"], "it covers no motor"
        if width > 1000:
            assert row["bottom"] <= height, "all motors are seen beside it"
        else:
            browser.execute_script("window.scrollTo(0, 2000)")
        assert text(browser, "#condition") == "live"
        badge = browser.execute_script(place, "#condition")
        assert 0 <= badge["top"] and badge["bottom"] <= height, "the condition stays in sight"


def test_variables_stand_beside_the_words(watching, browser):
    open_page(browser, watching)
    until(lambda: rows(browser, "words")[2:] == ["P1 12.5 ", "P2 -7 ", "I122 32 "], "the variables")
    assert rows(browser, "words")[0] == "count -7 part" and text(browser, "#unasked") == ""


def test_a_replay_says_so_and_is_never_live(board, browser):
    site = board.site
    site.kill_daemon()
    place = ("--name", site.name, "--socket", site.socket)
    site.daemon = site.run(PROGRAMS / "pmacd", "--board", f"replay:{CAPTURE}", *place)
    browser.get(board.url)
    until(lambda: text(browser, "#condition") in ("replay", "stale"), "the recording")
    until(lambda: text(browser, "#replay").startswith("REPLAY"), "the bar")
    assert browser.title.startswith("REPLAY")
    until(lambda: "the recording is over" in text(browser, "#reason"), "the end")
    assert text(browser, "#replay").startswith("REPLAY")
