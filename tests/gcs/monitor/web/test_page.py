"""The page in a real browser, before a scripted run."""

import asyncio
import json
import math
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.async_playwright import Axe

from tests.gcs.monitor.web.browsing import COMMAND, VIEW, Dashboard, browsing, scripted

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

GRAVE = ("serious", "critical")
RUN = ("--ahead-s", "22", "--speed", "0.5")


async def serious(page):
    """Return what axe finds wrong and grave on a page, in words."""
    found = (await Axe().run(page, options={"resultTypes": ["violations"]})).response["violations"]
    return [f"{one['id']}: {one['nodes'][0]['html'][:120]}" for one in found if one["impact"] in GRAVE]


async def latencies_ms(browser, during):
    """Return how long each state took from the service to the screen while something was done, in order of size."""
    await browser.forget_latencies()
    await during
    return sorted(await browser.latencies_ms())


async def stuck_for_a_while(browser):
    """Keep the page busy for three seconds, as a slow device would be, and wait until it follows again."""
    await browser.page.evaluate("() => { for (const end = performance.now() + 3000; performance.now() < end; ); }")
    for _ in range(200):
        if min(await browser.latencies_ms(), default=math.inf) < 1000.0:
            return
        await asyncio.sleep(0.1)
    pytest.fail("it shows nothing new any more")


async def resume_and_abort(browser):
    """Resume with the keyboard, and abort with the word typed."""
    await browser.page.locator(".command-panel [data-verb=resume]").focus()
    await browser.page.keyboard.down("Enter")
    await asyncio.sleep(1.0)
    await browser.page.keyboard.up("Enter")
    await browser.until("answers", "the relay goes on")
    await browser.until("phase", "relay")

    await browser.page.locator(".command-panel [data-verb=abort]").press("Enter")
    await browser.page.locator("dialog[open] input").fill("abort")
    await browser.page.keyboard.press("Enter")
    await browser.until("answers", "the relay ends")
    await browser.until("phase", "aborted")


@pytest.mark.parametrize(("size", "colours", "receivers"), [("desktop", "light", 20), ("phone", "dark", 8)])
async def test_the_operator_sees_the_run_and_holds_resumes_and_aborts_it(tmp_path, size, colours, receivers):
    site, run = Dashboard(tmp_path), (*RUN, "--receivers", str(receivers))
    async with scripted(tmp_path, *run), site.open(), browsing(site.url, size, colours) as browser:
        await browser.sign_in("wrong-0123456789abc")
        assert "not right" in await browser.page.inner_text("main")
        assert await serious(browser.page) == []
        await browser.sign_in(COMMAND)
        await browser.until("fresh", "live")
        states = await browser.states()
        assert len(states) == receivers
        assert set(states.values()) >= {"PLACED", "WAITING"}
        await browser.until("in-motion", "until L0 ∠ L1 is")
        width = await browser.page.evaluate("document.documentElement.scrollWidth")
        assert width <= browser.page.viewport_size["width"]

        await browser.keep_pressed("hold", 0.1)  # too short: it asks instead
        dialog = browser.page.locator("dialog[open]")
        await dialog.locator("input").fill("something else")
        await dialog.locator("button[type=submit]").click()
        assert "That is not" in await dialog.inner_text()
        assert await serious(browser.page) == []
        await browser.page.keyboard.press("Escape")
        assert await browser.words("phase") == "RELAY"

        await browser.keep_pressed("hold", 0.6)
        await browser.until("answers", "the relay is held")
        await browser.until("phase", "held")
        assert "HELD" in (await browser.states()).values()
        assert await serious(browser.page) == []

        shown_ms = await latencies_ms(browser, resume_and_abort(browser))
        assert len(shown_ms) > 5
        assert shown_ms[int(0.95 * len(shown_ms))] < 300.0
        assert browser.wrong == []


async def test_a_viewer_sees_all_and_commands_nothing_and_no_token_is_anywhere(tmp_path):
    site = Dashboard(tmp_path)
    async with scripted(tmp_path, *RUN), site.open() as process, browsing(site.url) as browser:
        await browser.page.goto(site.url)
        assert browser.page.url.endswith("/login")
        await browser.sign_in(VIEW)
        await browser.until("fresh", "live")
        await browser.until("command-off", "sign in with the command token")
        assert await browser.page.locator("[data-verb]").count() == 0
        answer = await browser.asks("abort")
        assert answer[0] == 403
        assert await browser.words("phase") == "RELAY"
        await browser.page.fill("[data-test=event-words]", "U2 PLACED")
        assert await browser.page.locator("[data-test=log] li").all_inner_texts() == ["19.8 s\n·\nU2 PLACED"]

        page = await browser.page.content()
        kept = await browser.page.evaluate("JSON.stringify([localStorage, sessionStorage, document.cookie])")
        said = page + kept + json.dumps(answer) + " ".join(browser.asked)
        assert VIEW not in said
        assert COMMAND not in said
        assert {urlsplit(url).netloc for url in browser.asked if urlsplit(url).scheme not in ("data", "blob")} == {
            f"127.0.0.1:{site.port}"
        }
        assert browser.wrong == []
        process.terminate()
        written = await process.stdout.read()
        assert VIEW.encode() not in written
        assert COMMAND.encode() not in written


async def test_the_page_says_when_what_it_shows_is_old_and_comes_back_by_itself(tmp_path):
    site = Dashboard(tmp_path, tokens={"COMMAND": COMMAND})
    async with browsing(site.url) as browser:
        async with site.open():
            await browser.page.goto(site.url)
            await browser.page.locator(".alerts", has_text="no run in").wait_for()
            async with scripted(tmp_path, *RUN):
                await browser.until("fresh", "live")
            await browser.until("fresh", "old")  # the service is gone...
            assert "nothing heard" in await browser.page.inner_text(".alerts")
            async with scripted(tmp_path, "--run", "20261122-130000-next", "--receivers", "3"):
                await browser.until("fresh", "live")  # ...and the next one has come
                await browser.until("placed", "0 / 3")
        await browser.until("fresh", "gone")  # the dashboard itself
        async with site.open(), scripted(tmp_path, "--run", "20261122-140000-third", "--receivers", "5"):
            await browser.until("placed", "0 / 5", within_s=15.0)
            await browser.until("fresh", "live")


@pytest.mark.alone
async def test_a_hundred_vehicles_are_drawn_five_times_a_second(tmp_path):
    site = Dashboard(tmp_path, tokens={})
    many = ("--receivers", "100", "--together", "10", "--ahead-s", "30")
    async with scripted(tmp_path, *many), site.open(), browsing(site.url) as browser:
        await browser.page.goto(site.url)
        await browser.until("fresh", "live")
        async with asyncio.timeout(60.0):  # for a while it may have to wait for a core
            while len(await latencies_ms(browser, asyncio.sleep(4.0))) < 0.8 * 4 * 5:
                pass
        shown_ms = await latencies_ms(browser, stuck_for_a_while(browser))
        assert len([each for each in shown_ms if each > 1000.0]) < 7  # most of the fifteen that came are left out
        assert browser.wrong == []


async def test_the_map_is_to_scale_turned_as_told_and_not_mirrored(tmp_path):
    site = Dashboard(tmp_path, tokens={})
    async with scripted(tmp_path, *RUN), site.open(), browsing(site.url) as browser:
        await browser.page.goto(site.url)
        await browser.until("fresh", "live")
        told = await browser.page.evaluate(
            """async () => {
                const {fitted, onCanvas, toPixels, zoomed} = await import("/assets/view.js");
                const step = (view, direction) => {
                    const [from, to] = [[3, 4], [3 + 10 * Math.cos(direction), 4 + 10 * Math.sin(direction)]];
                    const [a, b] = [toPixels(view, from), toPixels(view, to)];
                    return [(b[0] - a[0]) / view.scale, (b[1] - a[1]) / view.scale];
                };
                const corners = [[-90, -20], [40, 120]];
                const north = fitted(corners, 600, 400, 1.0), formation = fitted(corners, 600, 400, 0.0);
                const near = zoomed(north, 3.0, [100, 50]);
                return {
                    north: step(north, 1.0), east: step(north, 1.0 - Math.PI / 2), nose: onCanvas(north, 1.0),
                    x: step(formation, 0.0), y: step(formation, Math.PI / 2), zoomed: step(near, 1.0),
                    inside: corners.map(corner => toPixels(formation, corner)),
                };
            }"""
        )
        up, right, left = pytest.approx([0.0, -10.0]), pytest.approx([10.0, 0.0]), pytest.approx([-10.0, 0.0])
        assert [told[name] for name in ("north", "x", "zoomed")] == [up, up, up]
        assert told["east"] == right
        assert told["y"] == left  # counter-clockwise seen from above
        assert told["nose"] == pytest.approx(-1.5708, abs=1e-4)
        assert all(0.0 <= x <= 600.0 and 0.0 <= y <= 400.0 for x, y in told["inside"])

        turn = browser.page.locator(".map-panel button").first
        assert await turn.inner_text() == "North up"
        await browser.page.locator("canvas.map").press("n")
        assert await turn.inner_text() == "Formation up"
        await browser.page.locator("tr[data-receiver=U5] button").press("Enter")
        assert await browser.page.locator("tr.chosen").count() == 2  # in the relay, and in its health
        assert browser.wrong == []
