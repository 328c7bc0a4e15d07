"""Messages are asked for until they come, and again when they stop."""

import pytest

from drivers.mavlink.message_rates import PATIENCE_S, MessageRates

POSITION, ESTIMATOR = 33, 193
RATES = {POSITION: 5.0, ESTIMATOR: 1.0}


class Asked:
    def __init__(self, clock):
        self.requests = []
        self.clock = clock
        self.rates = MessageRates(clock, lambda message_id, rate_hz: self.requests.append((message_id, rate_hz)))

    async def reviewed(self, duration_s, *coming):
        """Let messages come, and reviews with each second; return what the reviews said, and forget the requests."""
        self.requests.clear()
        said = []
        for _ in range(round(duration_s)):
            await self.clock.advance(1.0)
            for message_id in coming:
                self.rates.came(message_id)
            said.append(self.rates.review())
        return said


@pytest.fixture
def asked(clock):
    asked = Asked(clock)
    asked.rates.ask(RATES)
    return asked


def test_everything_wanted_is_asked_for_once(asked):
    assert asked.requests == [(POSITION, 5.0), (ESTIMATOR, 1.0)]


async def test_what_comes_is_not_asked_for_again(asked):
    assert not any(await asked.reviewed(60, POSITION, ESTIMATOR))
    assert asked.requests == []
    assert asked.rates.missing == ()


async def test_what_never_came_is_asked_for_every_few_seconds_and_nothing_has_stopped(asked):
    assert not any(await asked.reviewed(30, POSITION))
    assert 4 <= asked.requests.count((ESTIMATOR, 1.0)) <= 30 / PATIENCE_S
    assert set(asked.requests) == {(ESTIMATOR, 1.0)}
    assert asked.rates.missing == (ESTIMATOR,)


async def test_what_stops_is_asked_for_within_seconds_and_is_said_once(asked):
    await asked.reviewed(10, POSITION, ESTIMATOR)
    said = await asked.reviewed(20)
    assert sum(said) == 1
    assert said.index(True) < PATIENCE_S + 3
    assert set(asked.requests) == {(POSITION, 5.0), (ESTIMATOR, 1.0)}


async def test_a_pause_of_this_service_is_not_taken_for_the_autopilots(asked):
    await asked.reviewed(5, POSITION, ESTIMATOR)
    asked.clock.jump(30.0)
    assert not asked.rates.review(), "the heartbeat happens to be read before what came with it"
    assert not any(await asked.reviewed(5, POSITION, ESTIMATOR))
    assert asked.requests == []


async def test_a_slow_message_is_given_the_time_it_needs(clock):
    asked = Asked(clock)
    asked.rates.ask({ESTIMATOR: 0.1})
    assert not any(await asked.reviewed(30))
    assert asked.requests == []


async def test_asking_again_asks_for_everything_and_forgets_that_it_came(asked):
    await asked.reviewed(2, POSITION, ESTIMATOR)
    asked.rates.ask_again()
    assert asked.requests == [(POSITION, 5.0), (ESTIMATOR, 1.0)]
    assert asked.rates.missing == (POSITION, ESTIMATOR)
