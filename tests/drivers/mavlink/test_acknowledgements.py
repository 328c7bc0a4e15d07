"""An acknowledgement answers the command it was sent for, or none."""

import pytest

from drivers.mavlink.acknowledgements import LATE_ANSWER_S, Acknowledgements

ARM, TAKE_OFF = 400, 22


@pytest.fixture
def acknowledgements(clock):
    return Acknowledgements(clock)


async def test_an_answer_goes_to_whoever_waits_for_its_number(acknowledgements):
    arm, take_off = acknowledgements.expect(ARM), acknowledgements.expect(TAKE_OFF)
    acknowledgements.take(TAKE_OFF, 4)
    assert not arm.done()
    assert take_off.result() == 4


async def test_a_number_is_not_free_while_its_answer_is_awaited(acknowledgements):
    assert acknowledgements.is_free(ARM)
    acknowledgements.expect(ARM)
    assert not acknowledgements.is_free(ARM)
    assert acknowledgements.is_free(TAKE_OFF)


async def test_an_answered_number_is_free_again(acknowledgements):
    acknowledgements.expect(ARM)
    acknowledgements.take(ARM, 0)
    acknowledgements.stop_waiting(ARM)
    assert acknowledgements.is_free(ARM)


@pytest.mark.parametrize("sent_by", ["expect", "expect_unheeded"])
async def test_an_overdue_answer_keeps_its_number_until_it_comes(acknowledgements, sent_by):
    getattr(acknowledgements, sent_by)(ARM)
    acknowledgements.stop_waiting(ARM)
    assert not acknowledgements.is_free(ARM)
    acknowledgements.take(ARM, 0)
    assert acknowledgements.is_free(ARM)


async def test_an_answer_that_never_comes_is_reckoned_with_for_half_a_minute(acknowledgements, clock):
    acknowledgements.expect(ARM)
    acknowledgements.stop_waiting(ARM)
    await clock.advance(LATE_ANSWER_S - 0.1)
    assert not acknowledgements.is_free(ARM)
    await clock.advance(0.2)
    assert acknowledgements.is_free(ARM)


async def test_a_second_answer_does_not_change_the_first(acknowledgements):
    answer = acknowledgements.expect(ARM)
    acknowledgements.take(ARM, 4)
    acknowledgements.take(ARM, 0)
    assert answer.result() == 4
