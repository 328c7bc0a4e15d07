"""The operator's word at the terminal itself."""

from __future__ import annotations

import asyncio
import os
import pty
import sys

import pytest

from gcs.commands.attending import enter_pressed


@pytest.mark.parametrize(
    ("typed", "goes_on"), [(b"\n", True), (b"yes\n", True), (b" Y \n", True), (b"no\n", False), (b"\x04", False)]
)
async def test_enter_or_a_yes_goes_on_and_anything_else_does_not(
    monkeypatch: pytest.MonkeyPatch, typed: bytes, goes_on: bool
) -> None:
    keyboard, terminal = pty.openpty()
    with os.fdopen(terminal) as standard_input:
        monkeypatch.setattr(sys, "stdin", standard_input)
        asked = asyncio.ensure_future(enter_pressed())
        await asyncio.sleep(0.05)
        assert not asked.done()
        os.write(keyboard, typed)
        assert await asyncio.wait_for(asked, 5.0) is goes_on
    os.close(keyboard)
