"""`sdm view` in a real browser: Chromium, without a graphics card, without a network."""

import asyncio
import os
import re
import signal
import struct
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
import msgpack
import numpy as np
import pytest
from PIL import Image

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.view.serve import CONNECTIONS
from tests.cases.accessible import found, grave, rules

pytestmark = pytest.mark.mesher
GENEROUS = 60_000.0  # ms; a loaded machine without a graphics card
MARKUP = "<b id='injected'>left</b> {{ 6 * 7 }} aileron"


@pytest.fixture(scope="module")
def folder(bare_run):
    return bare_run(replace(case_named("aileron"), title=MARKUP))


@pytest.fixture(scope="module")
def without_opengl(tmp_path_factory):
    """An environment in which no OpenGL library can be loaded."""
    fakes = tmp_path_factory.mktemp("no-opengl")
    for name in ("libGL.so.1", "libEGL.so.1", "libOpenGL.so.0", "libGLX.so.0", "libOSMesa.so.8"):
        (fakes / name).touch()
    return os.environ | {"LD_LIBRARY_PATH": str(fakes)}


@contextmanager
def served(folder, without_opengl):
    """Serve a page by a process that has no OpenGL library; yield the process and the address."""
    command = [sys.executable, "-m", "sdm_deflect", "view", str(folder), "--no-open", "--quiet"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=without_opengl,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        line = process.stdout.readline()
        address = re.match(r"http://127\.0\.0\.1:\d+/\?secret=\S+", line)
        assert address, line + process.stderr.read()
        try:
            yield process, address[0]
        finally:
            process.kill()


@pytest.fixture(scope="module")
def server(folder, without_opengl):
    with served(folder, without_opengl) as process_and_address:
        yield process_and_address


@pytest.fixture(scope="module")
def page(browser, server):
    """The page in a browser; it has the addresses it asked for and the errors it met."""
    shown = browser.new_page(viewport={"width": 1280, "height": 800})
    shown.set_default_timeout(GENEROUS)
    shown.asked, shown.errors = [], []
    shown.on("request", lambda request: shown.asked.append(request.url))
    shown.on("websocket", lambda socket: shown.asked.append(socket.url))
    shown.on("pageerror", lambda error: shown.errors.append(str(error)))
    shown.goto(server[1])
    shown.wait_for_selector("#status")
    wait_until(lambda: colours(picture(shown)) > 50, "the picture stays blank")
    yield shown
    shown.close()


def wait_until(condition, complaint):
    end = time.monotonic() + GENEROUS / 1e3
    while not condition():
        assert time.monotonic() < end, complaint
        time.sleep(0.1)


def picture(page):
    """The middle of the drawing (H, W, 3)."""
    box = page.locator("canvas").first.bounding_box()
    clip = {"x": box["x"] + 150, "y": box["y"] + 60, "width": box["width"] - 450, "height": box["height"] - 200}
    return np.asarray(Image.open(BytesIO(page.screenshot(clip=clip))).convert("RGB")).astype(int)


def colours(image):
    return len(np.unique(image.reshape(-1, 3), axis=0))


def differing(image, other):
    return np.count_nonzero(np.abs(image - other).max(axis=2) > 20) / image[..., 0].size


def settled(page):
    """The picture once two in a row are the same."""
    last = picture(page)
    for _ in range(50):
        time.sleep(0.3)
        now = picture(page)
        if differing(now, last) == 0.0:
            break
        last = now
    return now


def ground(page):
    """The colour (3,) in the lower left corner of the drawing, where no mesh is at first."""
    box = page.locator("canvas").first.bounding_box()
    clip = {"x": box["x"] + 20, "y": box["y"] + box["height"] - 60, "width": 40, "height": 40}
    image = Image.open(BytesIO(page.screenshot(clip=clip))).convert("RGB")
    return tuple(np.median(np.asarray(image).reshape(-1, 3), axis=0))


def trailing_edge(page):
    """Reported coordinates (3,) of the middle of the trailing edge, millimetres."""
    return np.array([float(c) for c in re.findall(r"-?\d+\.\d+", page.locator("#place-aileron_left").inner_text())])


def typed(page, text):
    page.locator("#angle-text").fill(text)
    page.keyboard.press("Enter")


def shows(page, angle):
    return page.locator("#shown").inner_text() == f"{float(angle):+g}°"


def to(page, angle, expected):
    """Type an angle and wait until the page shows it; an answer that is late would be written over what is typed."""
    typed(page, angle)
    wait_until(lambda: shows(page, angle), f"{angle} deg is not shown")
    assert expected in page.locator("#status").inner_text()


def test_the_runs_angle_is_shown_first_and_verified(page):
    assert page.locator("#angle-text").input_value() == "-12"
    assert "Verified: residual" in page.locator("#status").inner_text()
    assert page.locator("#inverted").inner_text() == "0"
    assert page.locator("#histogram svg rect").count() > 20


def test_the_slider_moves_the_trailing_edge(page):
    before, place = settled(page), trailing_edge(page)
    thumb, track = page.locator(".v-slider-thumb").first, page.locator(".v-slider").first
    middle, box = thumb.bounding_box(), track.bounding_box()
    page.mouse.move(middle["x"] + middle["width"] / 2, middle["y"] + middle["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], middle["y"] + middle["height"] / 2, steps=12)
    page.mouse.up()
    wait_until(lambda: float(page.locator("#angle-text").input_value()) > 0.0, "the angle stays")
    wait_until(lambda: trailing_edge(page)[2] < place[2] - 2.0, "the trailing edge stays")
    wait_until(lambda: differing(picture(page), before) > 0.002, "the picture stays")
    wait_until(lambda: shows(page, thumb.get_attribute("aria-valuenow")), "the slider's last angle is not shown")


def test_the_reported_coordinates_are_those_of_the_rotation(page, aileron):
    for angle in (-12.0, 8.0):
        to(page, f"{angle:g}", "Verified")
        expected = 1e3 * aileron.at(angle).points[aileron.surfaces[0].node]
        assert np.abs(trailing_edge(page) - expected).max() < 0.006


def test_many_inputs_in_a_row_end_at_the_last(page, aileron):
    to(page, "0", "Verified")
    thumb = page.locator(".v-slider-thumb").first
    thumb.focus()
    for _ in range(40):
        page.keyboard.press("ArrowRight")
    wait_until(lambda: shows(page, 4), "an earlier angle is shown")
    assert page.locator("#angle-text").input_value() == "4"
    expected = 1e3 * aileron.at(4.0).points[aileron.surfaces[0].node]
    assert np.abs(trailing_edge(page) - expected).max() < 0.006


def test_an_angle_out_of_range_is_refused_with_a_message(page):
    to(page, "5", "Verified")
    place = trailing_edge(page)
    typed(page, "95")
    refusal = page.locator("#refusal")
    refusal.wait_for()
    assert "95° is outside -85° to 85°" in refusal.inner_text()
    assert np.array_equal(trailing_edge(page), place)
    typed(page, "steep")
    wait_until(lambda: "not a number" in refusal.inner_text(), "text is taken for an angle")
    to(page, "6", "Verified")
    refusal.wait_for(state="hidden")


def test_an_angle_beyond_the_verified_ones_is_shown_and_says_so(page):
    to(page, "-45", "Not verified: residual")
    assert "above the run's tolerance" in page.locator("#status").inner_text()
    to(page, "-12", "Verified")


def test_the_browsers_camera_stays_when_the_mesh_moves(page):
    to(page, "2", "Verified")
    first = settled(page)
    box = page.locator("canvas").first.bounding_box()

    def drag():
        """Turn the picture; a busy browser may miss it, so it is done until it is seen."""
        page.mouse.move(box["x"] + 400, box["y"] + 400)
        page.mouse.down()
        page.mouse.move(box["x"] + 560, box["y"] + 430, steps=5)
        page.mouse.up()
        return differing(settled(page), first) > 0.1

    wait_until(drag, "the mouse does not turn the picture")
    turned = settled(page)
    to(page, "2.1", "Verified")
    assert differing(settled(page), turned) < 0.05
    page.locator("#fit").click()
    wait_until(lambda: differing(picture(page), first) < 0.05, "the first view does not come back")


def test_the_section_moves_along_each_axis(page):
    for axis in ("x", "z", "y"):
        before = settled(page)
        page.locator(f"#axis-{axis}").click()
        wait_until(lambda old=before: differing(picture(page), old) > 0.05, f"no section across {axis}")
    before = settled(page)
    page.locator("#worst-cell").click()
    wait_until(lambda: differing(picture(page), before) > 0.01, "the section stays")


def test_an_update_says_how_long_it_took(page):
    """Longer than nothing and no longer than the wait for it, however busy the machine is."""
    for angle in np.linspace(-11.0, 11.0, 4):
        begin = time.monotonic()
        to(page, f"{angle:.1f}", "Verified")
        told = float(page.locator("#elapsed").inner_text().removesuffix(" ms"))
        assert 0.0 < told <= 1e3 * (time.monotonic() - begin) + 0.5  # it is rounded


def test_markup_in_a_title_is_text(page):
    assert page.locator("#title").inner_text() == MARKUP
    assert page.locator("#injected").count() == 0


def test_nothing_is_asked_of_another_machine(page, server):
    own = server[1].removeprefix("http://").partition("/")[0]
    assert page.asked
    assert [url for url in page.asked if own not in url and not url.startswith(("data:", "blob:"))] == []
    assert page.errors == []


def test_the_page_can_be_loaded_again(page):
    assert "secret" not in page.url
    page.reload()
    page.wait_for_selector("#status")
    wait_until(lambda: colours(picture(page)) > 50, "the picture stays blank")


REQUESTS = [  # path, headers, status; SECRET, PORT and GOOD stand for those of the server and for its address
    ("/", {}, 403),
    ("/index.html", {}, 403),
    ("/index.html?secret=wslink-secret", {}, 403),
    ("/ws", {"Connection": "Upgrade", "Upgrade": "websocket"}, 403),
    ("/?secret=SECRET", {}, 302),
    ("/index.html?secret=SECRET", {}, 200),
    ("/index.html?secret=SECRET", {"Origin": "http://127.0.0.1:PORT"}, 200),
    ("/index.html", {"Cookie": "sdm-view-PORT=SECRET"}, 302),
    ("/index.html", {"Cookie": "sdm-view-PORT=wrong"}, 403),
    ("/index.html?secret=SECRET", {"Origin": "http://example.org"}, 403),
    ("/index.html?secret=SECRET", {"Origin": "http://localhost:1"}, 403),
    ("/index.html?secret=SECRET", {"Origin": "http://localhost:PORT"}, 403),
    ("/index.html?secret=SECRET", {"Origin": "https://127.0.0.1:PORT"}, 403),
    ("/index.html?secret=SECRET", {"Origin": "null"}, 403),
    ("/index.html?secret=SECRET", {"Origin": "["}, 403),
    ("/index.html?secret=SECRET", {"Host": "localhost:PORT"}, 200),
    ("/index.html?secret=SECRET", {"Host": "localhost:1"}, 400),
    ("/index.html?secret=SECRET", {"Host": "example.org"}, 400),
    ("/index.html?secret=SECRET", {"Host": "["}, 400),
    ("/index.html?secret=%ff%00", {}, 403),
    ("/nothing?secret=SECRET", {}, 404),
    ("/..%2f..%2fetc%2fpasswd?secret=SECRET", {}, 404),
    ("/ws?secret=SECRET", {}, 400),
    ("/ws?secret=SECRET", {"Connection": "Upgrade", "Upgrade": "websocket"}, 400),
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


def part(payload, number=1, size=None):
    """A part of a message as the page sends it: number, place, size of the whole, content."""
    return struct.pack("<III", number, 0, len(payload) if size is None else size) + payload


def call(method, *arguments, name="rpc:c:1"):
    return part(msgpack.packb({"wslink": "1.0", "id": name, "method": method, "args": arguments}))


ENDED = {
    "4 GB announced": [part(b"x", i, 2**32 - 1) for i in range(3)],
    "many messages begun": [part(b"x", i, 1 << 20) for i in range(9)],
    "another size than before": [part(b"x", 1, 100), part(b"x", 1, 50)],
    "text": ["{"],
    "nothing": [b""],
    "a header alone": [bytes(12)],
    "8 MB": [bytes(8_000_000)],
    "no msgpack": [part(b"\xc1")],
    "more than one message": [part(b"\x01\x01")],
    "nested deeply": [part(600 * b"\x91" + b"\x01")],
    "a number": [part(b"\x05")],
    "an id that is no text": [part(msgpack.packb({"id": 5, "method": "x"}))],
    "no method": [part(msgpack.packb({"id": "rpc:c:1"}))],
    "a method that is no text": [part(msgpack.packb({"id": "rpc:c:1", "method": [1]}))],
}
"""Messages after which the connection is closed."""
BORNE_ANGLE = 2.0
BORNE = [
    call("nothing"),
    call("trame.trigger", "nothing", 5, 5),
    *(
        call("trame.state.update", [{"key": key, "value": value}])
        for key in ("angle", "axis", "position")
        for value in ("steep", None, float("nan"), [1])
    ),
    call("trame.state.update", [{"key": "angle", "value": BORNE_ANGLE}, {"key": "axis", "value": "y"}]),
    call("trame.state.update", [{"key": "position", "value": -0.2}]),
]
"""Calls that are answered, the last ones right."""


async def ended(session, address, messages):
    """Send messages as the page does, and a last one; return whether the connection is closed before that is answered.

    What the server tells all pages meanwhile does not count.
    """
    async with session.ws_connect(address.replace("/?", "/ws?")) as socket:
        hello = {"id": "system:c0:0", "method": "wslink.hello", "args": [{"secret": address.partition("=")[2]}]}
        for message in (part(msgpack.packb(hello)), *messages, call("nothing", name="rpc:c:last")):
            with suppress(aiohttp.ClientConnectionError):
                await (socket.send_str(message) if isinstance(message, str) else socket.send_bytes(message))
        while (answer := await socket.receive(timeout=GENEROUS / 1e3)).type is aiohttp.WSMsgType.BINARY:
            if b"rpc:c:last" in answer.data:
                return False
        return True


def test_messages_are_bounded_and_bad_ones_end_the_connection(server, page):
    """Three messages of 13 bytes, each of which announced 4 GB, once made the server take them."""

    async def everything():
        async with aiohttp.ClientSession() as session:
            for name, messages in ENDED.items():
                assert await ended(session, server[1], messages), name
            assert not await ended(session, server[1], BORNE)
            sockets = [await session.ws_connect(server[1].replace("/?", "/ws?")) for _ in range(CONNECTIONS - 1)]
            with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
                await session.ws_connect(server[1].replace("/?", "/ws?"))
            for socket in sockets:
                await socket.close()

    with ThreadPoolExecutor(1) as thread:  # the browser has this thread's event loop
        thread.submit(asyncio.run, everything()).result()
    own = server[0].pid
    for process in (own, *Path(f"/proc/{own}/task/{own}/children").read_text().split()):
        status = Path(f"/proc/{process}/status").read_text()
        assert int(re.search(r"VmHWM:\s+(\d+)", status)[1]) < 1_000_000  # kB
    wait_until(lambda: shows(page, BORNE_ANGLE), "the last angle of those that are borne is not shown")
    to(page, "3", "Verified")


def test_the_mesh_is_repaired_where_the_slider_rests(browser, repaired_folder, without_opengl):
    with served(repaired_folder, without_opengl) as (_, address):
        tab = browser.new_page()
        tab.set_default_timeout(GENEROUS)
        tab.goto(address)
        said = tab.locator("#repair")
        tab.wait_for_selector("#repair:has-text('Repaired')")
        assert tab.locator("#inverted").inner_text() == "0"
        tab.locator(".v-slider-thumb").first.focus()
        for _ in range(20):
            tab.keyboard.press("ArrowLeft")
        wait_until(lambda: shows(tab, 24), "an earlier angle is shown")
        wait_until(lambda: "nodes moved" in said.inner_text(), "the mesh is not repaired")
        assert tab.locator("#inverted").inner_text() == "0"
        tab.locator("#axis-x").click()
        wait_until(lambda: "x =" in tab.locator("#panel").inner_text(), "no section across x")
        assert "nodes moved" in said.inner_text()
        tab.close()


def test_a_narrow_page_shows_the_scene_above_the_panel(page):
    page.set_viewport_size({"width": 390, "height": 800})
    try:
        stage, panel = (page.locator(name).bounding_box() for name in ("#stage", "#panel"))
        assert stage["width"] == panel["width"] == 390
        assert stage["y"] + stage["height"] == pytest.approx(panel["y"])
    finally:
        page.set_viewport_size({"width": 1280, "height": 800})


def test_the_page_is_for_everyone(page):
    try:
        assert grave(page) == {}
    finally:
        page.emulate_media(color_scheme="light")
        page.set_viewport_size({"width": 1280, "height": 800})


def test_the_page_follows_the_colours_of_the_browser(page):
    """At once, both ways; what has been set stays."""
    to(page, "4", "Verified")
    page.locator("#fit").click()
    wait_until(lambda: ground(page) == (255, 255, 255), "the picture has no white ground")
    page.emulate_media(color_scheme="dark")
    try:
        wait_until(lambda: ground(page) == (22, 24, 27), "the ground of the picture stays light")
        assert found(page, rules("color-contrast")) == []
        assert page.locator(".v-theme--light").count() == 0
        assert page.locator("#shown").inner_text() == "+4\N{DEGREE SIGN}"
    finally:
        page.emulate_media(color_scheme="light")
    wait_until(lambda: ground(page) == (255, 255, 255), "the ground of the picture stays dark")
    assert page.locator(".v-theme--dark").count() == 0


def test_buttons_turn_the_picture(page):
    page.locator("#fit").click()
    before = settled(page)
    page.locator("#turn-right").focus()
    page.keyboard.press("Enter")
    wait_until(lambda: differing(picture(page), before) > 0.1, "the picture stays")
    page.locator("#fit").click()
    wait_until(lambda: differing(picture(page), before) < 0.05, "the first view does not come back")


def test_another_browser_has_a_state_of_its_own(browser, page, server):
    to(page, "3", "Verified")
    other = browser.new_context().new_page()
    other.set_default_timeout(GENEROUS)
    other.goto(server[1])
    other.wait_for_selector("#status")
    assert other.url != page.url
    to(other, "-7", "Verified")
    assert page.locator("#shown").inner_text() == "+3\N{DEGREE SIGN}"
    own = page.url
    page.reload()
    page.wait_for_selector("#status")
    assert page.url == own
    assert page.locator("#shown").inner_text() == "+3\N{DEGREE SIGN}"
    other.context.close()


def test_an_interrupt_ends_it_cleanly_and_the_page_says_so(page, server):  # last: it takes the page's server away
    process, _ = server
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=GENEROUS / 1e3)
    assert (process.returncode, out, err) == (0, "", "")
    page.locator("main[role=alert]").wait_for()
    assert "sdm view has ended" in page.locator("main").inner_text()
