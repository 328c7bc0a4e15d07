"""What no autopilot should send: seeded noise, broken frames, and whole frames that say absurd things."""

import math
import struct
from random import Random

from pymavlink.dialects.v20 import ardupilotmega as mavlink

UNKNOWN_IDS = (12_345, 0xABCDE, 0xFFFFFF)
FLOATS = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, 0.0)
TEXTS = (
    b"\x1b[2J\x1b]0;owned\x07\x9b31m",
    b"\xff\xfe\x80\xc3(\xed\xa0\x80" * 6,
    b"\x00after the end",
    b"a\r\nb\tc\x08\x7f",
    b"%s%n{0}{x!r}" * 4,
    "прилёт 🚁".encode(),
    b"",
    b"x" * 50,
)


class Hostile:
    """A sender that says nothing true. The same seed says the same."""

    def __init__(self, seed, system_id=1):
        self._random = Random(seed)
        self._system_id = system_id
        self._kinds = (
            self.noise,
            self.noise_full_of_beginnings,
            self.false_header,
            self.mavlink_1,
            self.damaged,
            self.truncated,
            self.wrong_length,
            self.wrong_checksum,
            self.flagged_as_signed,
            self.unknown,
            self.random_payload,
            self.absurd,
            self.absurd,
        )

    def datagram(self):
        """Return a piece of one to three kinds."""
        return b"".join(self._random.choice(self._kinds)() for _ in range(self._random.randint(1, 3)))

    def frame(self, message_id, payload, flags=0, trailer=b""):
        """Return a frame with a right checksum around any payload; it mostly says that the autopilot sent it."""
        random = self._random
        system_id = self._system_id if random.random() < 0.9 else random.choice((0, 2, 51, 255))
        component_id = 1 if random.random() < 0.9 else random.choice((0, 68, 190, 191))
        head = struct.pack(
            "<BBBBBBHB",
            len(payload),
            flags,
            0,
            random.randrange(256),
            system_id,
            component_id,
            message_id & 0xFFFF,
            message_id >> 16,
        )
        extra = mavlink.mavlink_map[message_id].crc_extra if message_id in mavlink.mavlink_map else 0
        checksum = mavlink.x25crc(head + payload + bytes([extra])).crc
        return b"\xfd" + head + payload + struct.pack("<H", checksum) + trailer

    def noise(self):
        return self._random.randbytes(self._random.randint(1, 300))

    def noise_full_of_beginnings(self):
        return bytes(self._random.choice((0xFD, 0xFD, 0xFE, 0, 1, 9, 255)) for _ in range(self._random.randint(1, 300)))

    def false_header(self):
        return b"\xfd" + bytes([self._random.randrange(256), self._random.choice((0, 1))]) + self._random.randbytes(7)

    def mavlink_1(self):
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3)
        return heartbeat.pack(mavlink.MAVLink(None, self._system_id, 1), force_mavlink1=True)

    def damaged(self):
        frame = bytearray(self.random_payload())
        for _ in range(self._random.randint(1, 3)):
            frame[self._random.randrange(len(frame))] ^= self._random.randint(1, 255)
        return bytes(frame)

    def truncated(self):
        frame = self.random_payload()
        return frame[: self._random.randrange(len(frame))]

    def wrong_length(self):
        frame = bytearray(self.random_payload())
        frame[1] = self._random.randrange(256)
        return bytes(frame)

    def wrong_checksum(self):
        frame = bytearray(self.random_payload())
        frame[-1] ^= self._random.randint(1, 255)
        return bytes(frame)

    def flagged_as_signed(self):
        trailer = self._random.randbytes(self._random.choice((0, 5, 13, 13, 13)))
        return self.frame(mavlink.MAVLINK_MSG_ID_HEARTBEAT, self._random.randbytes(9), flags=1, trailer=trailer)

    def unknown(self):
        return self.frame(self._random.choice(UNKNOWN_IDS), self._random.randbytes(self._random.randint(1, 255)))

    def random_payload(self):
        message_id = self._random.choice(
            (*mavlink.mavlink_map, *[absurd.get_msgId() for absurd in self._absurdities()])
        )
        return self.frame(message_id, self._random.randbytes(self._random.randint(1, 255)))

    def absurd(self):
        """Return a sound frame with a message an autopilot does send, and values it never would."""
        message = self._random.choice(self._absurdities())
        packed = message.pack(mavlink.MAVLink(None, self._system_id, 1))
        return self.frame(message.get_msgId(), packed[10:-2])

    def _absurdities(self):
        random = self._random
        number = random.choice(FLOATS)
        far = random.choice((2**31 - 1, -(2**31), 0, 900_000_001, 1_800_000_001))
        fast = random.choice((32767, -32768, 0))
        boot_ms = random.choice((0, 1, 2**32 - 1, random.getrandbits(32)))
        return (
            mavlink.MAVLink_heartbeat_message(*random.randbytes(3), random.getrandbits(32), *random.randbytes(2)),
            mavlink.MAVLink_global_position_int_message(boot_ms, far, far, far, far, fast, fast, fast, 65535),
            mavlink.MAVLink_system_time_message(random.getrandbits(64), boot_ms),
            mavlink.MAVLink_timesync_message(random.choice((-(2**63), 2**63 - 1, 0)), random.choice((-(2**63), 0, 1))),
            mavlink.MAVLink_ekf_status_report_message(random.getrandbits(16), *(number,) * 5),
            mavlink.MAVLink_sys_status_message(
                *(random.getrandbits(32) for _ in range(3)), 65535, 65535, -1, -128, *(65535,) * 6
            ),
            mavlink.MAVLink_statustext_message(
                random.randrange(256), random.choice(TEXTS), random.choice((0, 1, 65535)), 255
            ),
            mavlink.MAVLink_command_ack_message(
                random.choice((400, 176, 511, 65535)), random.randrange(256), 255, -(2**31)
            ),
            mavlink.MAVLink_param_value_message(random.choice(TEXTS)[:16], number, random.randrange(256), 65535, 65535),
            mavlink.MAVLink_autopilot_version_message(
                random.getrandbits(64),
                *(random.getrandbits(32) for _ in range(4)),
                *(list(random.randbytes(8)) for _ in range(3)),
                0,
                0,
                random.getrandbits(64),
                list(random.randbytes(18)),
            ),
        )
