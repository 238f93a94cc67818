"""The page in a browser."""

import json

from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select
from board_of_processes import until


def text(browser, selector):
    return browser.find_element(By.CSS_SELECTOR, selector).text


def rows(browser, table):
    """The rows at one moment: the page makes new ones all the time."""
    cells = "[...row.cells].map((cell) => cell.innerText).join(' ')"
    return browser.execute_script(f"return [...document.getElementById('{table}').tBodies[0].rows].map((row) => {cells})")


def open_page(browser, own):
    browser.get(own.url)
    until(lambda: text(browser, "#condition") == "live", "a live page")


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
    times, position, error = shown(browser)
    # The state is taken five times a second.
    until(lambda: json.loads(moving.get("/state"))["counters"]["updates"] > counters["updates"] + len(times), "a later state")
    after = json.loads(moving.get("/state"))["counters"]
    period = json.loads(moving.get("/state"))["servo_period_ns"] / 1e9
    absent = round(span(times) / period) + 1 - len(times)
    assert absent <= after["missed"] - counters["missed"] + after["skipped"] - counters["skipped"], "what pmacd read is shown"
    assert max(position) - min(position) > 1000, "the motor moves"
    assert max(error) > 0 > min(error)
    Select(browser.find_element(By.ID, "field")).select_by_value("velocity")
    browser.find_element(By.ID, "add").click()
    until(lambda: len(shown(browser)) == 4 and len(shown(browser)[3]) > 100, "the velocity")
    browser.find_elements(By.CSS_SELECTOR, "#traces button")[2].click()
    until(lambda: len(shown(browser)) == 3, "the velocity to go")


def test_the_trigger_holds_a_picture(moving, browser):
    open_page(browser, moving)
    Select(browser.find_element(By.ID, "span")).select_by_value("0.5")
    level = browser.find_element(By.ID, "level")
    level.clear()
    level.send_keys("1000")
    Select(browser.find_element(By.ID, "mode")).select_by_value("single")
    until(lambda: text(browser, "#run") == "run", "a single picture")
    until(lambda: max(shown(browser)[0], default=0) > 0.39, "its samples")
    times, position, _ = shown(browser)
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
