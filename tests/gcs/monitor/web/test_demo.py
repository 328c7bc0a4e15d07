"""A whole relay on embedded copters, watched and commanded by a real browser on a desktop and on a phone."""

import asyncio
import contextlib
import os
import signal
from pathlib import Path

import pytest

from tests.gcs.monitor.web.browsing import (
    COMMAND,
    VIEW,
    Dashboard,
    browser,
    opened,
    started,
    until_served,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

FLY = ("-m", "gcs.cli", "fly", "sitl_configs/waves_8.yaml", "--attended", "--speedup", "5")
PASSED = {"LOCATING", "PLACED"}
ON_A_LEG = {"LEG_1", "LEG_2"}


async def entered(page):
    """Return the states that a page has seen every receiver come into."""
    return await page.page.evaluate(
        """async () => {
            const {spans} = await import("/assets/store.js");
            return Object.fromEntries([...spans.value].map(([name, entered]) => [name, [...entered.values()]]));
        }"""
    )


async def until(page, come):
    """Wait until something has come; where a busy machine made the relay hold, let it go on, as an operator would."""
    async with asyncio.timeout(120.0):
        while not await come():
            if await page.words("phase") == "HELD":
                await page.keep_pressed("resume", 1.1)
            await asyncio.sleep(0.2)


def dashboard_of(service):
    """Return the process of the dashboard that a service has started beside itself."""
    children = Path(f"/proc/{service.pid}/task/{service.pid}/children").read_text().split()
    (found,) = (int(pid) for pid in children if b"dashboard" in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0"))
    return found


async def test_a_flight_on_two_screens_is_held_resumed_and_formed_and_its_dashboard_may_die(tmp_path):
    site = Dashboard(tmp_path)
    beside = ("--runs-dir", str(tmp_path), "--dashboard", f"127.0.0.1:{site.port}")
    async with contextlib.AsyncExitStack() as stack:
        service = await stack.enter_async_context(started(*FLY, *beside, environment=site.environment))
        chromium = await stack.enter_async_context(browser())
        desktop = await opened(chromium, site.url)
        phone = await opened(chromium, site.url, "phone", "dark")
        screens = (desktop, phone)

        async def both_show(name, words, within_s=20.0):
            await asyncio.gather(*(screen.until(name, words, within_s) for screen in screens))

        async def in_motion():
            return ON_A_LEG & set((await desktop.states()).values())

        async def formed():
            return await desktop.words("phase") == "FORMED"

        async def both_are_held():
            await both_show("phase", "held")
            for screen in screens:
                assert "HELD" in (await screen.states()).values()

        await until_served(site.port)
        await asyncio.gather(desktop.sign_in(COMMAND), phone.sign_in(VIEW))
        await both_show("fresh", "live", within_s=60.0)
        assert await phone.page.locator("[data-verb]").count() == 0
        assert await phone.asks("abort") == (403, "this needs the token for commanding")
        await phone.sign_in(COMMAND)
        await until(desktop, in_motion)
        await phone.keep_pressed("hold", 0.7)
        await phone.until("answers", "the relay is held")
        await both_are_held()

        os.kill(dashboard_of(service), signal.SIGKILL)
        await both_show("fresh", "dashboard gone")
        await stack.enter_async_context(site.open())
        await both_show("fresh", "live")
        await both_are_held()

        await desktop.keep_pressed("resume", 1.1)
        await desktop.until("answers", "the relay goes on")
        await until(desktop, formed)
        await both_show("placed", "8 / 8")
        for screen in screens:
            states = await entered(screen)
            assert sorted(states) == [f"U{k}" for k in range(1, 9)]
            for name, seen in states.items():
                assert set(seen) >= PASSED, name
                assert ON_A_LEG & set(seen), name
            for some in ("WAITING", "VERIFYING", "HELD"):
                assert any(some in seen for seen in states.values()), some
            assert "formed" in await screen.report()
            assert screen.wrong == []
        assert b"formed" in (await service.communicate())[0]
        assert service.returncode == 0
