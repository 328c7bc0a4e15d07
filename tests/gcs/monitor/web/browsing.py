"""The dashboard as a user has it: its process, a run for it to show, and a real browser before it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import socket
import sys
from dataclasses import dataclass, field

import pytest
from playwright.async_api import Error as PlaywrightError
from playwright.async_api import async_playwright

from drivers.simulation.launcher import free_tcp_port

DASHBOARD = ("-m", "gcs.cli", "dashboard")
CHROMIUM = shutil.which("chromium")
VIEW = "view-0123456789abcdef"
COMMAND = "command-0123456789abcdef"
SIZES = {"desktop": {"width": 1280, "height": 800}, "phone": {"width": 390, "height": 844}}
_STARTS_WITHIN_S = 60.0


@contextlib.asynccontextmanager
async def started(*arguments, environment=None, end=signal.SIGTERM):
    """Run a Python process of this project while the block lasts."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *arguments,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env={**os.environ, **(environment or {})},
        start_new_session=True,
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.send_signal(end)
            try:
                await asyncio.wait_for(process.communicate(), 5.0)
            except TimeoutError:
                process.kill()
                await process.communicate()


@dataclass
class Dashboard:
    """The dashboard's process, which can be ended and started anew at the same place."""

    runs_dir: object
    tokens: dict = field(default_factory=lambda: {"VIEW": VIEW, "COMMAND": COMMAND})
    port: int = field(default_factory=free_tcp_port)
    options: tuple[str, ...] = ()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}/"

    @property
    def environment(self):
        return {f"BEARING_RELAY_{role}_TOKEN": token for role, token in self.tokens.items()}

    @contextlib.asynccontextmanager
    async def open(self):
        place = ["--listen", f"127.0.0.1:{self.port}", "--runs-dir", str(self.runs_dir), *self.options]
        async with started(*DASHBOARD, *place, environment=self.environment) as process:
            line = await asyncio.wait_for(process.stdout.readline(), _STARTS_WITHIN_S)
            assert b"dashboard at" in line, line + await process.stdout.read()
            yield process


@contextlib.asynccontextmanager
async def scripted(runs_dir, *options, port=None):
    """Play a scripted run on a bus of its own."""
    port = str(port or free_tcp_port())
    async with started("-m", "tests.gcs.monitor.web.scripted", port, str(runs_dir), *options) as process:
        yield process


class Browser:
    """One page of a real browser. It notes what goes wrong in it, and whom it asks for anything."""

    def __init__(self, context, page, url):
        self.context = context
        self.page = page
        self.url = url
        self.wrong = []
        self.asked = set()
        page.on("pageerror", lambda error: self.wrong.append(str(error)))
        page.on("request", lambda request: self.asked.add(request.url))
        page.on("websocket", lambda socket: self.asked.add(socket.url))

    async def sign_in(self, token):
        await self.page.goto(self.url + "login")
        await self.page.fill("#token", token)
        await self.page.click("button")

    async def words(self, name):
        return await self.page.locator(f"[data-test={name}]").inner_text()

    async def until(self, name, words, within_s=10.0):
        """Wait until a part of the page says these words."""
        found = self.page.locator(f"[data-test={name}]", has_text=words)
        try:
            await found.wait_for(timeout=1000.0 * within_s)
        except PlaywrightError:
            page = await self.page.inner_text("body")
            pytest.fail(f"{name} does not say {words!r} within {within_s:g} s; the page says:\n{page}")

    async def states(self):
        """Return the state that the table shows of every receiver."""
        rows = self.page.locator("tr[data-receiver]")
        told = await rows.evaluate_all("rows => rows.map(row => [row.dataset.receiver, row.dataset.state])")
        return dict(told)

    async def forget_latencies(self):
        await self.page.evaluate("import('/assets/store.js').then(store => { store.latency.shown.length = 0; })")

    async def latencies_ms(self):
        """Return how long each state since took from the service to this screen."""
        return await self.page.evaluate("import('/assets/store.js').then(store => store.latency.shown)")

    async def asks(self, verb):
        """Ask for a word behind the page's back, with all that the page knows; return the status and the answer."""
        status, answer = await self.page.evaluate(
            """async (verb) => {
                const session = await (await fetch("/about")).json();
                const answer = await fetch("/control", {method: "POST", headers: {"x-csrf-token": session.csrf},
                    body: JSON.stringify({verb})});
                return [answer.status, await answer.json()];
            }""",
            verb,
        )
        return status, answer["message"]

    async def report(self):
        """Open the report of the run that has ended, and return what it says."""
        link = self.page.locator("[data-test=report]")
        await link.wait_for(timeout=20_000)
        async with self.context.expect_page() as opened:
            await link.click()
        page = await opened.value
        await page.wait_for_load_state()
        return await page.inner_text("body")

    async def keep_pressed(self, verb, for_s):
        """Keep a button of the commands pressed with the mouse; where the page moved and it was missed, once more."""
        button = self.page.locator(f".command-panel [data-verb={verb}]")
        for _ in range(5):
            await button.hover()
            await button.evaluate("b => { b.hit = false; b.onpointerdown = () => { b.hit = true; }; }")
            await self.page.mouse.down()
            await asyncio.sleep(for_s)
            await self.page.mouse.up()
            if await button.evaluate("b => b.hit"):
                return
        pytest.fail(f"the button {verb} was missed five times")


@contextlib.asynccontextmanager
async def browser(program=CHROMIUM):
    """Start a real browser; skipped where there is none."""
    if CHROMIUM is None:
        pytest.skip("needs chromium")
    async with async_playwright() as playwright:
        chromium = await playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        try:
            yield chromium
        finally:
            with contextlib.suppress(PlaywrightError):
                await chromium.close()


async def opened(chromium, url, size="desktop", colours="light"):
    """Return a page of a browser, as somebody who has not been there before."""
    context = await chromium.new_context(
        viewport=SIZES[size], color_scheme=colours, has_touch=size == "phone", reduced_motion="reduce"
    )
    return Browser(context, await context.new_page(), url)


@contextlib.asynccontextmanager
async def browsing(url, size="desktop", colours="light"):
    """Open a page of a browser of its own."""
    async with browser() as chromium:
        yield await opened(chromium, url, size, colours)


async def until_served(port, *, served=True):
    """Wait until somebody listens at a port, or nobody does any more."""
    async with asyncio.timeout(_STARTS_WITHIN_S):
        while is_served(port) is not served:  # noqa: ASYNC110  # another process's port tells nobody
            await asyncio.sleep(0.1)


def is_served(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
