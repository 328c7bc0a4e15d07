"""A smaller time since boot is a late message or a reboot: which of them, follows from how long nothing was heard."""

import pytest

from drivers.mavlink.boot_clock import BootClock


def heard(*times):
    """Return which of the (time since boot, time heard), s, tell of a reboot."""
    boot_clock = BootClock()
    return [boot_clock.restarted(boot_s, now_s) for boot_s, now_s in times]


def test_a_clock_that_goes_on_is_no_reboot():
    assert heard((5.0, 100.0), (5.2, 100.2), (300.0, 395.0)) == [False, False, False]


def test_the_first_time_heard_of_is_no_reboot():
    assert heard((0.0, 0.0)) == [False]


@pytest.mark.parametrize("late_s", [0.001, 0.4, 3.0, 12.0, 90.0])
def test_a_late_message_of_a_running_autopilot_is_no_reboot(late_s):
    assert heard((300.0, 1000.0), (300.0 - late_s, 1000.1)) == [False, False]


@pytest.mark.parametrize("uptime_s", [4.0, 60.0, 5000.0])
@pytest.mark.parametrize("after_s", [0.3, 1.6, 3.2])
def test_a_clock_that_began_again_since_it_was_last_heard_is_a_reboot(uptime_s, after_s):
    assert heard((uptime_s, 1000.0), (after_s, 1000.6 + after_s)) == [False, True]


def test_after_a_reboot_late_messages_of_before_do_not_tell_of_another():
    times = (300.0, 1000.0), (2.0, 1003.0), (299.9, 1003.1), (2.4, 1003.4)
    assert heard(*times)[1:3] == [True, False]


def test_two_reboots_are_two():
    assert heard((300.0, 1000.0), (2.0, 1003.0), (20.0, 1021.0), (1.0, 1023.0)) == [False, True, False, True]


def test_what_was_forgotten_is_no_longer_compared_with():
    boot_clock = BootClock()
    boot_clock.restarted(300.0, 1000.0)
    boot_clock.forget()
    assert not boot_clock.restarted(2.0, 1003.0)
