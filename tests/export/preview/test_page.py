# SPDX-License-Identifier: Apache-2.0
"""The preview page in a real browser: values under the cursor, player, keys, objects; and what is in the file."""

import json
import re

import numpy as np
import pytest

from tests.export.preview.browser import browser, console_errors
from tiscene.errors import ArgumentError, ExportError
from tiscene.export.preview import write_preview
from tiscene.export.preview.buffer_codec import PageBuffer
from tiscene.export.preview.object_tracks import ObjectTracks
from tiscene.frame.buffers import BUFFERS
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.stream.stream import Stream

BUFFERS_SHOWN = ("semantic", "instance", "depth", "forward_flow", "normal", "forward_occlusion", "coverage")
FRAMES = 10


@pytest.fixture(scope="module")
def stream():
    ball = Object("<b>ball</b> {{style}}", "Ball 01", (0, 1, -3), first_frame=2)
    cameras = [Camera.look_at((0.0, 1.5, 3.0), (0.0, 0.5, 0.0), name=name) for name in ("First", "Second")]
    scenario = Scenario("solid_benchmark", [ball], camera=tuple(cameras))
    return Stream(scenario, width=48, height=36, frames=FRAMES, buffers=BUFFERS_SHOWN)


@pytest.fixture(scope="module")
def path(stream, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "preview.html"
    rendered = []
    write_preview(stream, path, progress=rendered.append)
    assert rendered == list(range(FRAMES))
    return path


@pytest.fixture(scope="module")
def page(path, tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as page:
        page.get(path.as_uri())
        wait(page, "document.body.dataset.shown === '0'")
        yield page
        assert console_errors(page) == []


def wait(page, condition):
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(page, 20, 0.02).until(lambda _: page.execute_script(f"return {condition}"))


def go_to(page, frame):
    page.execute_script(f"goTo({frame})")
    wait(page, f"document.body.dataset.shown === '{frame}'")


def press(page, *keys):
    from selenium.webdriver.common.action_chains import ActionChains

    ActionChains(page).send_keys(*keys).perform()


def point_at(page, buffer, x, y):
    """Move the mouse to a pixel of a buffer's picture."""
    from selenium.webdriver.common.action_chains import ActionChains

    canvas = page.find_element("css selector", f"canvas[data-buffer={buffer}]")
    width, height = page.execute_script(
        "const b = arguments[0].getBoundingClientRect(); return [b.width, b.height]", canvas
    )
    offsets = round((x + 0.5) / 48 * width - width / 2), round((y + 0.5) / 36 * height - height / 2)
    ActionChains(page).move_to_element_with_offset(canvas, *offsets).perform()
    wait(page, f"(document.body.dataset.pixel || '').endsWith(' {x},{y}')")


def readout(page):
    lines = page.execute_script(
        "return [...document.querySelectorAll('[data-value]')].map((cell) => [cell.dataset.value, cell.textContent])"
    )
    return dict(lines)


@pytest.mark.parametrize("frame", [7, 1, 9])
def test_values_under_the_cursor_are_those_of_the_arrays(stream, page, frame):
    go_to(page, frame)
    shown = stream[frame]
    row, column = np.argwhere(shown.instance == np.unique(shown.instance)[-1])[0]
    for x, y in ((column, row), (5, 30), (0, 0), (47, 35)):
        point_at(page, "depth", x, y)
        values = readout(page)
        id = shown.semantic[y, x]
        assert values["semantic"] == (f"{id} {shown.categories[id]}" if id else "0 background")
        id = shown.instance[y, x]
        assert values["instance"] == (f"{id} {shown.objects.by_id(id).name}" if id else "0 background")
        depth = shown.depth[y, x]
        assert values["depth"] == (f"{np.rint(float(depth) * 1000) / 1000:.3f} m" if np.isfinite(depth) else "∞ m")
        flow = [float(text) for text in values["forward_flow"].removesuffix(" px").split(", ")]
        np.testing.assert_allclose(flow, shown.forward_flow[y, x], atol=0.00501)
        normal = [float(text) for text in values["normal"].split(", ")]
        np.testing.assert_allclose(normal, shown.normal[y, x], atol=0.00501)
        assert values["forward_occlusion"] == str(shown.forward_occlusion[y, x])
        ranks = [f"{int(id)} {shown.objects.by_id(id).name} {part:.4f}" for id, part in shown.coverage[y, x] if part]
        assert values["coverage"] == (", ".join(ranks) or "background")


def test_picture_is_that_of_the_frame(stream, page):
    go_to(page, 6)
    press(page, "3")  # one buffer, as large as the page allows
    wait(page, "document.querySelector('[data-tab=depth]').getAttribute('aria-selected') === 'true'")
    press(page, "2")
    wait(page, "document.body.dataset.shown === '6'")
    data = page.execute_script(
        "const c = document.querySelector('canvas[data-buffer=instance]');"
        "return [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data]"
    )
    pixels = np.array(data, np.uint8).reshape(36, 48, 4)[..., :3]
    np.testing.assert_array_equal(pixels, stream[6].picture("instance"))
    press(page, "0")


def test_keys_step_jump_and_play(page):
    from selenium.webdriver.common.keys import Keys

    go_to(page, 0)
    for keys, frame in (((Keys.ARROW_RIGHT,), 1), ((Keys.END,), 9), ((Keys.ARROW_LEFT,), 8), ((Keys.HOME,), 0)):
        press(page, *keys)
        wait(page, f"document.body.dataset.shown === '{frame}'")
    press(page, " ")
    wait(page, "state.frame >= 3")
    press(page, " ")
    assert page.execute_script("return state.playing") == 0
    press(page, "t")
    dark = page.execute_script("return document.documentElement.classList.contains('dark')")
    press(page, "t")
    assert page.execute_script("return document.documentElement.classList.contains('dark')") is not dark


def test_slider_scrubs(page):
    page.execute_script("const s = document.getElementById('slider'); s.value = 4; s.dispatchEvent(new Event('input'))")
    wait(page, "document.body.dataset.shown === '4'")
    assert "frame 4" in page.find_element("id", "clock").text


def test_objects_events_and_plan_follow_the_frame(stream, page):
    def names():
        return page.execute_script(
            "return [...document.querySelectorAll('#objects td.name')].map((c) => c.textContent)"
        )

    go_to(page, 1)
    assert sorted(names()) == sorted(row.name for row in stream[1].objects if row.visible_pixels)
    go_to(page, 2)
    assert "spawn: <b>ball</b> {{style}}" in page.find_element("id", "events").text
    go_to(page, 9)
    assert sorted(names()) == sorted(row.name for row in stream[9].objects if row.visible_pixels)
    titles = page.execute_script("return [...document.querySelectorAll('#plan title')].map((t) => t.textContent)")
    assert sorted(titles) == sorted(row.name for row in stream[9].objects)


def test_click_keeps_the_pixel_until_escape(page):
    from selenium.webdriver.common.keys import Keys

    go_to(page, 5)
    point_at(page, "depth", 20, 30)
    page.find_element("css selector", "canvas[data-buffer=depth]").click()
    kept = page.execute_script("return state.pixel")
    go_to(page, 6)
    assert page.execute_script("return state.pixel") == kept
    press(page, Keys.ESCAPE)
    assert page.execute_script("return state.pixel") is None


def test_other_camera_can_be_chosen(page):
    page.execute_script(
        "const c = document.getElementById('camera'); c.selectedIndex = 1; c.dispatchEvent(new Event('change'))"
    )
    wait(page, "state.camera === 1")
    go_to(page, 3)
    page.execute_script(
        "const c = document.getElementById('camera'); c.selectedIndex = 0; c.dispatchEvent(new Event('change'))"
    )


@pytest.mark.parametrize("height", [None, 3.0])
def test_plan_knows_how_wide_the_camera_sees(height):
    camera = Camera((0, 1, 2), orthographic_height=height)
    stream = Stream(Scenario("object_view", camera=camera), width=48, height=36, buffers=("instance",))
    tracks = ObjectTracks()
    tracks.add(stream[0])
    ((x, z, *forward, half_width, is_orthographic),) = tracks.to_json()["cameraPath"]
    assert (x, z, forward) == (0, 2, [0, -1])
    assert is_orthographic == (height is not None)
    assert half_width == pytest.approx(2.0 if height else np.tan(np.pi / 6) * 48 / 36, abs=1e-3)


def test_page_refers_to_nothing_outside(path):
    text = path.read_text()
    assert not re.findall(r'(?:src|href)="(?!data:)', text)
    assert "default-src 'none'" in text
    content = json.loads(re.search(r'id="content">(.*?)</script>', text, re.DOTALL)[1])
    assert content["frames"] == list(range(FRAMES))
    assert [each["name"] for each in content["cameras"]] == ["First", "Second"]


@pytest.mark.slow
def test_page_of_a_hundred_frames_with_six_buffers_stays_below_15_megabytes():
    """The share of one frame of a moving camera in a room, times a hundred; objects add little."""
    camera = Camera.look_at((0.75, 1.32, 0.72), (-1.72, 0.88, -4.2), vertical_fov=0.8)
    frame = Stream("room_02", camera=camera, buffers=("semantic", "instance", "depth", "normal", "position"))[0]
    size = 0
    for name in ("semantic", "instance", "depth", "normal"):
        from tiscene.export.preview.buffer_codec import ValueEncoder
        from tiscene.frame.visualize import limits_of

        page_buffer = PageBuffer(BUFFERS[name], limits_of(name, [frame[name]]))
        size += len(page_buffer.picture(frame[name])) + len(ValueEncoder(page_buffer).encode(frame[name]))
    assert size < 105_000  # rgb and flow take 45,000 more


@pytest.mark.parametrize("frames", [range(0), range(5, 20), range(-2, 2), 7])
def test_frames_that_the_stream_does_not_have_are_refused(stream, tmp_path, frames):
    with pytest.raises(ArgumentError, match="frames"):
        write_preview(stream, tmp_path / "page.html", frames=frames)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("place", ["file/page.html", "folder"])
def test_page_that_cannot_be_written_is_an_error_before_rendering(stream, tmp_path, place):
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(ExportError, match="cannot write"):
        write_preview(stream, tmp_path / place, progress=lambda index: pytest.fail("rendered"))
