"""A service that is killed in mid-leg and resumed, as a browser shows it; then the flight is aborted from the page."""

import asyncio
import contextlib
import time

import pytest

from gcs.monitor.access import COMMAND_VARIABLE
from tests.gcs.field import open_field
from tests.gcs.monitor.web.browsing import COMMAND, Dashboard, browser, opened, started

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

MOVING_MPS = 1.0


async def test_the_screens_find_the_resumed_service_and_abort_what_it_flies(tmp_path, monkeypatch):
    monkeypatch.setenv(COMMAND_VARIABLE, COMMAND)
    site = Dashboard(tmp_path / "runs", tokens={"COMMAND": COMMAND})
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(site.open())
        chromium = await stack.enter_async_context(browser())
        screens = [await opened(chromium, site.url, size) for size in ("desktop", "phone")]

        async def all_show(name, words, within_s=60.0):
            await asyncio.gather(*(screen.until(name, words, within_s) for screen in screens))

        async def all_show_them_fly():
            await all_show("phase", "relay")
            await all_show("in-motion", "until")

        await asyncio.gather(*(screen.sign_in(COMMAND) for screen in screens))
        field = await stack.enter_async_context(open_field(tmp_path, options=("--attended",)))
        await all_show_them_fly()
        await field.until_moving()
        field.service.kill()
        await all_show("fresh", "old")
        for screen in screens:
            assert "nothing heard for" in await screen.page.inner_text(".alerts")

        (run,) = (path for path in field.runs_dir.iterdir() if path.is_dir())
        service = await stack.enter_async_context(started("-m", "gcs.cli", "resume", str(run), "--attended"))
        resumed_s = time.monotonic()
        await all_show("fresh", "live")
        await all_show_them_fly()
        async with asyncio.timeout(60.0):
            while field.fastest_after(resumed_s) < MOVING_MPS:  # noqa: ASYNC110  # the wire tells nobody
                await asyncio.sleep(0.05)

        phone = screens[1]
        await phone.keep_pressed("abort", 1.8)
        await phone.until("answers", "the relay ends; stopped: U1")
        answered_s = time.monotonic()
        await all_show("phase", "aborted")
        said, _ = await asyncio.wait_for(service.communicate(), 60.0)
        assert service.returncode == 1, said
        assert field.fastest_after(answered_s) == 0.0
        assert field.report()["outcome"] == "aborted"
        for screen in screens:
            assert "U1 HELD: stopped by the operator" in await screen.report()
            assert screen.wrong == []
