"""`sdm view` in a real browser: Chromium, without a graphics card, without a network."""

import asyncio
import json
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from http.client import HTTPConnection
from io import BytesIO
from pathlib import Path

import aiohttp
import numpy as np
import pytest
from PIL import Image

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.mesh_files import write_mesh
from sdm_deflect.cases.view.serve import CONNECTIONS
from tests.cases.accessible import found, grave, rules

pytestmark = pytest.mark.mesher
GENEROUS = 60_000.0  # ms; a loaded machine without a graphics card
MARKUP = "<b id='injected'>left</b> {{ 6 * 7 }} aileron"


@pytest.fixture(scope="module")
def folder(bare_run):
    return bare_run(replace(case_named("aileron"), title=MARKUP))


@contextmanager
def served(place):
    """Serve a page by a process of its own; yield the process and the address."""
    command = [sys.executable, "-m", "sdm_deflect", "view", str(place), "--no-open", "--quiet"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        line = process.stdout.readline()
        address = re.match(r"http://127\.0\.0\.1:\d+/\?secret=\S+", line)
        assert address, line + process.stderr.read()
        try:
            yield process, address[0]
        finally:
            process.kill()


@pytest.fixture(scope="module")
def server(folder):
    with served(folder) as process_and_address:
        yield process_and_address


def shown_by(browser, address):
    """Open an address; the page has the addresses that it asked for and the errors that it met."""
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    tab.set_default_timeout(GENEROUS)
    tab.asked, tab.errors = [], []
    tab.on("request", lambda request: tab.asked.append(request.url))
    tab.on("websocket", lambda socket: tab.asked.append(socket.url))
    tab.on("pageerror", lambda error: tab.errors.append(str(error)))
    tab.on("console", lambda said: tab.errors.append(said.text) if said.type == "error" else None)
    tab.goto(address, timeout=GENEROUS)
    tab.wait_for_selector("#turnable[data-state]")
    return tab


@pytest.fixture(scope="module")
def page(browser, server):
    tab = shown_by(browser, server[1])
    wait_until(lambda: "esidual" in tab.locator("#scene-status").inner_text(), "no angle is answered")
    yield tab
    tab.close()


def wait_until(condition, complaint):
    end = time.monotonic() + GENEROUS / 1e3
    while not condition():
        assert time.monotonic() < end, complaint
        time.sleep(0.1)


def picture(page):
    """The drawing (H, W, 3)."""
    image = Image.open(BytesIO(page.locator("#turnable canvas").screenshot())).convert("RGB")
    return np.asarray(image).astype(int)


def differing(image, other):
    return np.count_nonzero(np.abs(image - other).max(axis=2) > 20) / image[..., 0].size


def trailing_edge(page):
    """Printed coordinates (3,) of the middle of the trailing edge, millimetres."""
    return np.array([float(c) for c in re.search(r"\((.*?)\)", page.inner_text("#scene-notes"))[1].split(",")])


def typed(page, text):
    page.locator("#scene-typed").fill(text)
    page.keyboard.press("Enter")


def shows(page, angle):
    return page.get_attribute("#turnable", "data-angle") == f"{angle:g}"


def to(page, angle):
    """Type an angle and wait until the page shows it."""
    typed(page, f"{angle:g}")
    wait_until(lambda: shows(page, angle), f"{angle} deg is not shown")
    return page.inner_text("#scene-status")


def test_the_runs_angle_is_shown_first_and_fits(page):
    assert page.input_value("#scene-typed") == "-12"
    assert "Residual" in page.inner_text("#scene-status")
    assert "0 inverted" in page.inner_text("#scene-count")
    wait_until(
        lambda: "no cell inverts without repair; positive is trailing" in page.inner_text("#scene-range"),
        "no angles that fit",
    )
    assert float(page.get_attribute("#scene-angle", "max")) == 85.0


def test_the_slider_moves_the_surface_and_many_inputs_end_at_the_last(page, aileron):
    to(page, 0)
    before, slider = picture(page), page.locator("#scene-angle")
    slider.focus()
    for _ in range(40):
        page.keyboard.press("ArrowRight")
    last = float(slider.input_value())
    assert last > 3.0
    wait_until(lambda: shows(page, last), "an earlier angle is shown")
    wait_until(lambda: differing(picture(page), before) > 0.001, "the picture stays")
    assert float(page.input_value("#scene-typed")) == last
    assert page.get_attribute("#turnable", "data-milliseconds")


def test_the_printed_coordinates_are_those_of_the_rotation(page, aileron):
    for angle in (-12.0, 8.0):
        assert "below" in to(page, angle)
        expected = 1e3 * aileron.at(angle).points[aileron.surfaces[0].node]
        assert np.abs(trailing_edge(page) - expected).max() < 0.006


def test_an_angle_out_of_range_is_refused_with_a_message(page):
    to(page, 5)
    place, said = trailing_edge(page), page.locator("#scene-said")
    typed(page, "95")
    wait_until(lambda: "95 is outside -85 ... 85°" in said.inner_text(), "95 is not refused")
    assert np.array_equal(trailing_edge(page), place)
    typed(page, "steep")
    wait_until(lambda: "not a number" in said.inner_text(), "text is taken for an angle")
    to(page, 6)
    assert said.inner_text() == ""


def test_an_angle_beyond_those_that_fit_is_shown_and_says_so(page):
    assert "above the run's tolerance" in to(page, -45)
    assert page.locator("#scene-status.bad").count() == 1
    assert "below" in to(page, -12)


def test_the_camera_stays_when_the_mesh_moves_and_buttons_turn_it(page):
    to(page, 2)
    first = picture(page)
    page.locator("[data-turn=right]").focus()
    for _ in range(3):
        page.keyboard.press("Enter")
    wait_until(lambda: differing(picture(page), first) > 0.05, "the picture stays")
    turned = picture(page)
    to(page, 2.1)
    assert differing(picture(page), turned) < 0.05
    page.locator("[data-turn=first]").click()
    wait_until(lambda: differing(picture(page), first) < 0.05, "the first view does not come back")


def test_the_section_goes_to_the_worst_cell(page):
    to(page, -12)
    before = picture(page)
    page.select_option("#scene-axis", "x")
    wait_until(lambda: differing(picture(page), before) > 0.02, "no section across x")
    where = page.inner_text("#scene-where")
    page.locator("#scene-worst").click()
    wait_until(lambda: page.inner_text("#scene-where") != where, "the section stays")
    page.select_option("#scene-axis", "none")
    page.uncheck("#scene-cells")
    wait_until(lambda: differing(picture(page), before) < 0.02, "the section stays")


def test_its_command_is_printed(page):
    to(page, -11)
    page.locator("#scene-command").click()
    assert "--set angle=-11" in page.inner_text("#scene-said")
    assert not page.locator("#scene-mesh").count()


def test_markup_in_a_title_is_text(page):
    assert page.inner_text("h1") == f"{MARKUP}, -12° (trailing edge up)"
    assert page.locator("#injected").count() == 0


def test_nothing_is_asked_of_another_machine_and_the_page_can_be_loaded_again(page, server):
    own = server[1].removeprefix("http://").partition("/")[0]
    assert page.asked
    assert [url for url in page.asked if own not in url and not url.startswith(("data:", "blob:"))] == []
    assert page.errors == []
    assert "secret" not in page.url
    page.reload()
    page.wait_for_selector("#turnable[data-angle='-12']")


def test_the_page_is_for_everyone(page):
    try:
        assert grave(page) == {}
        page.emulate_media(color_scheme="dark")
        assert found(page, rules("color-contrast")) == []
    finally:
        page.emulate_media(color_scheme="light")
        page.set_viewport_size({"width": 1280, "height": 900})


def test_the_keyboard_reaches_every_control(page):
    reached = set()
    page.locator("body").focus()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.dataset.turn || ''"))
    names = "angle typed command deflected view colour lines overlay box sites centres cells threshold axis place"
    assert {
        "turnable",
        "left",
        "closer",
        "save",
        "scene-worst",
        *("scene-" + name for name in names.split()),
    } - reached == set()


def test_a_click_names_the_patch_and_two_make_a_hinge_of_any_mesh(browser, tmp_path, block):
    write_mesh(None, block, block.points, tmp_path / "block.su2")
    with served(tmp_path / "block.su2") as (_, address):
        tab = shown_by(browser, address)
        assert "body" in tab.inner_text("table")
        assert not tab.locator("#scene-live").count()
        assert "secret" not in tab.url
        frame = tab.locator("#turnable canvas").bounding_box()
        for shift in (0, 40):
            tab.mouse.click(frame["x"] + frame["width"] / 2 + shift, frame["y"] + frame["height"] / 2)
        assert re.search(r"body, undeflected node at \S+; --hinge \S+ \S+", tab.inner_text("#scene-picked"))
        assert tab.errors == []
        tab.close()


REQUESTS = [  # path, headers, status; SECRET and PORT stand for those of the server
    ("/", {}, 403),
    ("/?secret=wslink-secret", {}, 403),
    ("/ws", {"Connection": "Upgrade", "Upgrade": "websocket"}, 403),
    ("/?secret=SECRET", {}, 200),
    ("/?secret=SECRET", {"Origin": "http://127.0.0.1:PORT"}, 200),
    ("/", {"Cookie": "sdm-view-PORT=SECRET"}, 200),
    ("/", {"Cookie": "sdm-view-PORT=wrong"}, 403),
    ("/", {"Cookie": "sdm-view-1=SECRET"}, 403),
    ("/?secret=SECRET", {"Origin": "http://example.org"}, 403),
    ("/?secret=SECRET", {"Origin": "http://localhost:1"}, 403),
    ("/?secret=SECRET", {"Origin": "http://localhost:PORT"}, 403),
    ("/?secret=SECRET", {"Origin": "https://127.0.0.1:PORT"}, 403),
    ("/?secret=SECRET", {"Origin": "null"}, 403),
    ("/?secret=SECRET", {"Origin": "["}, 403),
    ("/?secret=SECRET", {"Origin": ""}, 403),
    ("/?secret=SECRET", {"Host": "localhost:PORT"}, 200),
    ("/?secret=SECRET", {"Host": "localhost:1"}, 400),
    ("/?secret=SECRET", {"Host": "example.org"}, 400),
    ("/?secret=SECRET", {"Host": "["}, 400),
    ("/?secret=%ff%00", {}, 403),
    ("/nothing?secret=SECRET", {}, 404),
    ("/..%2f..%2fetc%2fpasswd?secret=SECRET", {}, 404),
    ("/ws?secret=SECRET", {}, 400),
    ("/ws?secret=SECRET", {"Connection": "Upgrade", "Upgrade": "websocket"}, 400),
    ("/ws?secret=SECRET", {"Origin": "http://example.org"}, 403),
    ("/" + 20_000 * "a", {}, 400),
]


def test_only_the_servers_own_page_is_answered(server):
    port, secret = re.search(r":(\d+)/\?secret=(.+)", server[1]).groups()
    for path, headers, status in REQUESTS:
        filled = {name: text.replace("PORT", port).replace("SECRET", secret) for name, text in headers.items()}
        connection = HTTPConnection("127.0.0.1", int(port), timeout=GENEROUS / 1e3)
        connection.request("GET", path.replace("SECRET", secret), headers=filled)
        assert connection.getresponse().status == status, (path[:40], headers)
        connection.close()


ENDED = ["{", "", "[1]", "5", '"angle"', "[" * 3000, "x" * 8_000_000, b"\x00", b""]
"""Messages after which the connection is closed."""
BORNE = [
    {},
    {"angle": None},
    {"angle": [1]},
    {"angle": "steep"},
    {"angle": float("nan")},
    {"save": 1},
    {"angle": 1e400},
]
"""Messages that are answered by a sentence."""


async def answer_of(session, address, message):
    """Send a message and return the type of the answer, and what it says."""
    async with session.ws_connect(address.replace("/?", "/ws?")) as socket:
        with suppress(aiohttp.ClientConnectionError, ConnectionError):
            await (socket.send_bytes(message) if isinstance(message, bytes) else socket.send_str(message))
        while (answer := await socket.receive(timeout=GENEROUS / 1e3)).type is aiohttp.WSMsgType.TEXT:
            if "said" in json.loads(answer.data):
                break
        return answer.type, answer.data


def test_messages_are_bounded_and_bad_ones_end_the_connection(server, page):
    async def everything():
        async with aiohttp.ClientSession() as session:
            for message in ENDED:
                kind, _ = await answer_of(session, server[1], message)
                assert kind in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED), message[:20]
            for wish in BORNE:
                kind, _ = await answer_of(session, server[1], json.dumps(wish))
                assert kind is aiohttp.WSMsgType.TEXT, wish
            kind, _ = await answer_of(session, server[1], '{"angle": 2}')
            assert kind is aiohttp.WSMsgType.BINARY
            sockets = [await session.ws_connect(server[1].replace("/?", "/ws?")) for _ in range(CONNECTIONS - 1)]
            with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
                await session.ws_connect(server[1].replace("/?", "/ws?"))
            for socket in sockets:
                await socket.close()

    with ThreadPoolExecutor(1) as thread:  # the browser has this thread's event loop
        thread.submit(asyncio.run, everything()).result()
    status = Path(f"/proc/{server[0].pid}/status").read_text()
    assert int(re.search(r"VmHWM:\s+(\d+)", status)[1]) < 1_000_000  # kB
    assert "below" in to(page, 3)


def test_the_mesh_is_repaired_where_the_slider_rests(browser, repaired_folder):
    with served(repaired_folder) as (_, address):
        tab = shown_by(browser, address)
        notes = tab.locator("#scene-notes")
        wait_until(lambda: "Repaired" in notes.inner_text(), "the run's mesh is not shown")
        assert "0 inverted" in tab.inner_text("#scene-count")
        typed(tab, "24")
        wait_until(lambda: shows(tab, 24) and "nodes moved" in notes.inner_text(), "the mesh is not repaired")
        assert "0 inverted" in tab.inner_text("#scene-count")
        tab.close()


def test_another_browser_has_an_angle_of_its_own(browser, page, server):
    to(page, 3)
    other = shown_by(browser, server[1])
    to(other, -7)
    assert shows(page, 3)
    other.close()


def test_an_interrupt_ends_it_cleanly_and_the_page_says_so(page, server):  # last: it takes the page's server away
    process, _ = server
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=GENEROUS / 1e3)
    assert (process.returncode, out, err) == (0, "", "")
    wait_until(lambda: "sdm view has ended" in page.inner_text("#scene-said"), "the page does not say so")
    assert page.is_disabled("#scene-angle")
