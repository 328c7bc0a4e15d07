"""What is wrong and what the operator can do about it, in lines for any screen; nothing while all is well."""

from __future__ import annotations

import math
from typing import Final

from drivers.mavlink.link_status import LinkState, LinkStatus
from gcs.relay.states import ReceiverState
from gcs.status import RunStatus

WORTH_SAYING_LOSS: Final = 0.01
WORTH_SAYING_SILENCE_S: Final = 0.5

_HALTED: Final = (ReceiverState.PILOT, ReceiverState.HELD, ReceiverState.FAILED)


def relay_troubles(status: RunStatus) -> list[str]:
    """Return who does not fly and why, those alike together; and while the relay waits, the commands that help."""
    alike: dict[tuple[ReceiverState, str], list[str]] = {}
    for name, record in status.records.items():
        if record.state in _HALTED:
            alike.setdefault((record.state, record.reason), []).append(name)
    lines = [
        f"{', '.join(names)} {state.value}: {reason}"
        for (state, reason), names in sorted(alike.items(), key=lambda entry: _HALTED.index(entry[0][0]))
    ]
    relay = status.relay
    if relay is None:
        return lines
    if others := sorted(relay.taken - status.records.keys()):
        lines.insert(0, f"{', '.join(others)} PILOT: no longer trusted to stand")
    if relay.held is not None:
        lines.append(f"the relay holds: {relay.held}")
    if relay.waiting:
        lines.append("waiting for the operator:")
        lines.extend(f"  {command}" for command in relay.ways_out())
    return lines


def link_troubles(status: RunStatus) -> list[str]:
    """Return a line for every link that does not fare well, or is not recorded."""
    told = [(vehicles, link, link_trouble(link)) for vehicles, link in status.links()]
    lines = [f"{vehicles} {link.address}: {trouble}" for vehicles, link, trouble in told if trouble]
    return lines + [f"recording: {problem}" for problem in [status.recording()] if problem]


def link_trouble(link: LinkStatus) -> str:
    """Return what is wrong with a link, in words; nothing while it fares well."""
    troubles: list[str] = []
    if link.state is LinkState.DOWN:
        troubles.append("down, tried again")
    elif math.isinf(link.silent_for_s):
        troubles.append("nothing heard yet")
    if link.loss_ratio is not None and link.loss_ratio >= WORTH_SAYING_LOSS:
        troubles.append(f"{100.0 * link.loss_ratio:.0f} % lost")
    if WORTH_SAYING_SILENCE_S <= link.silent_for_s < math.inf:
        troubles.append(f"silent {link.silent_for_s:.1f} s")
    if link.contested_system_ids:
        troubles.append(f"two autopilots with system id {', '.join(map(str, link.contested_system_ids))}")
    return ", ".join(troubles)
