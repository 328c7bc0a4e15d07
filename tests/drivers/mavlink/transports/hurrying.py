"""An event loop on which waiting takes no time, for what waits by the loop's own clock; and what is logged when."""

import asyncio
import logging
import selectors


class HurryingSelector(selectors.DefaultSelector):
    """Where the event loop would wait for a timer, its time jumps there instead."""

    skipped_s = 0.0

    def select(self, timeout=None):
        if timeout is None or timeout <= 0.0:
            return super().select(timeout)
        ready = super().select(min(timeout, 0.003))
        if not ready:
            self.skipped_s += timeout
        return ready


class HurryingLoop(asyncio.SelectorEventLoop):
    """An event loop on which the longest back-off passes at once."""

    def __init__(self):
        self._hurrying = HurryingSelector()
        super().__init__(self._hurrying)

    def time(self):
        return super().time() + self._hurrying.skipped_s


def waited_s():
    """Return how long everybody on the running loop has waited for timers, s: no time that a busy machine takes."""
    return asyncio.get_running_loop()._hurrying.skipped_s


def run_hurrying(scenario):
    with asyncio.Runner(loop_factory=HurryingLoop) as runner:
        return runner.run(scenario)


async def until(condition):
    """Return once a condition holds that no event tells of."""
    async with asyncio.timeout(100.0):
        while not condition():  # noqa: ASYNC110 - what is waited for is the kernel's
            await asyncio.sleep(0.02)


def logged_by(scenario, logger_name):
    """Return (time, level, text) of everything a logger is told while a scenario runs."""
    records = []

    class Recorder(logging.Handler):
        def emit(self, record):
            records.append((asyncio.get_running_loop().time(), record.levelno, record.getMessage()))

    logger, recorder = logging.getLogger(logger_name), Recorder()
    level = logger.level
    logger.addHandler(recorder)
    logger.setLevel(logging.DEBUG)
    try:
        run_hurrying(scenario)
    finally:
        logger.removeHandler(recorder)
        logger.setLevel(level)
    return records
