"""A whole relay on embedded copters, watched and commanded from the page by a real browser."""

import asyncio
import contextlib

import pytest

from tests.gcs.monitor.web.browsing import COMMAND, Dashboard, browsing, started

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

FLY = ("-m", "gcs.cli", "fly", "sitl_configs/waves_8.yaml", "--attended", "--speedup", "5")
PASSED = {"WAITING", "LOCATING", "VERIFYING", "PLACED"}
ON_A_LEG = {"LEG_1", "LEG_2"}


async def entered(browser):
    """Return the states that the page has seen every receiver come into."""
    return await browser.page.evaluate(
        """async () => {
            const {spans} = await import("/assets/store.js");
            return Object.fromEntries([...spans.value].map(([name, entered]) => [name, [...entered.values()]]));
        }"""
    )


async def until_formed(browser):
    """Wait until all are placed; where a busy machine made the relay hold, let it go on, as an operator would."""
    while await browser.words("phase") != "FORMED":
        if await browser.words("phase") == "HELD":
            await browser.keep_pressed("resume", 1.1)
        await asyncio.sleep(0.5)


async def test_eight_receivers_go_through_all_their_states_and_are_held_and_resumed_on_the_page(tmp_path):
    site = Dashboard(tmp_path, tokens={"COMMAND": COMMAND})
    environment = {"BEARING_RELAY_COMMAND_TOKEN": COMMAND}
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(site.open())
        browser = await stack.enter_async_context(browsing(site.url))
        await browser.sign_in(COMMAND)
        await browser.until("fresh", "no run yet")
        service = await stack.enter_async_context(started(*FLY, "--runs-dir", str(tmp_path), environment=environment))
        await browser.until("phase", "relay", within_s=60.0)
        await browser.until("in-motion", "until", within_s=60.0)
        await browser.keep_pressed("hold", 0.7)
        await browser.until("answers", "the relay is held")
        await browser.until("phase", "held")
        assert "HELD" in (await browser.states()).values()
        await browser.keep_pressed("resume", 1.1)
        await browser.until("answers", "the relay goes on")
        async with asyncio.timeout(120.0):
            await until_formed(browser)
        assert await browser.words("placed") == "8 / 8"
        states = await entered(browser)
        assert sorted(states) == [f"U{k}" for k in range(1, 9)]
        for name, seen in states.items():
            assert set(seen) >= PASSED, name
            assert ON_A_LEG & set(seen), name
        assert any("HELD" in seen for seen in states.values())
        report = browser.page.locator("[data-test=report]")
        await report.wait_for(timeout=20_000)
        async with browser.context.expect_page() as opened:
            await report.click()
        page = await opened.value
        await page.wait_for_load_state()
        assert "formed" in await page.inner_text("body")
        assert b"formed" in (await service.communicate())[0]
        assert service.returncode == 0
        assert browser.wrong == []
