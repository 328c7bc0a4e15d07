"""Stands in for ArduCopter's simulator: takes its command line, and says just enough to be ready to fly.

The environment variable FAKE says what is wrong with the vehicles it names: `3=silent` (says nothing), `3=lost` (finds
no position), `3=fast` (keeps its speed), `3=dead` (ends at once); several with commas.
"""

import os
import select
import socket
import sys
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

PERIOD_S = 0.05


def main() -> None:
    words = [word for word in sys.argv[1:] if word != "--wipe"]
    options = dict(zip(words[::2], words[1::2], strict=True))
    wrong = dict(pair.split("=") for pair in os.environ.get("FAKE", "").split(",") if pair)
    fault = wrong.get(options["--sysid"], "none")
    if fault == "dead":
        sys.exit("PANIC: no airframe")
    Vehicle(options, fault).run()


class Vehicle:
    def __init__(self, options: dict[str, str], fault: str) -> None:
        _, host, port = options["--serial0"].split(":")
        self.parent = os.getppid()
        self.station = (host, int(port))
        self.fault = fault
        self.speedup = float(options["--speedup"])
        self.encoder = mavlink.MAVLink(None, int(options["--sysid"]), 1)
        self.place = [float(part) for part in options["--home"].split(",")]
        self.boot_ms = 0.0
        self.asked = set[int]()

    def run(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as self.socket:
            while os.getppid() == self.parent:  # as the real one
                ends_s = time.monotonic() + PERIOD_S
                if self.fault != "silent":
                    self.report()
                while (left_s := ends_s - time.monotonic()) > 0 and select.select([self.socket], [], [], left_s)[0]:
                    self.hear(self.socket.recv(2048))

    def report(self) -> None:
        self.boot_ms += PERIOD_S * 1e3 * self.speedup
        self.send(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, mavlink.MAV_STATE_STANDBY, 3))
        if mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT in self.asked:
            at = [round(self.place[0] * 1e7), round(self.place[1] * 1e7), round(self.place[2] * 1e3)]
            self.send(mavlink.MAVLink_global_position_int_message(round(self.boot_ms), *at, 0, 0, 0, 0, 0))
        if mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT in self.asked and self.fault != "lost":
            self.send(mavlink.MAVLink_ekf_status_report_message(0x33F, 0.0, 0.0, 0.0, 0.0, 0.0))

    def hear(self, data: bytes) -> None:
        message = self.encoder.decode(bytearray(data))
        if message.get_type() == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            self.asked.add(int(message.param1))
        if message.get_type() == "PARAM_SET" and message.param_id == "SIM_SPEEDUP" and self.fault != "fast":
            self.speedup = message.param_value
            name, kind = message.param_id.encode(), mavlink.MAV_PARAM_TYPE_REAL32
            self.send(mavlink.MAVLink_param_value_message(name, self.speedup, kind, 1, 65535))

    def send(self, message: mavlink.MAVLink_message) -> None:
        self.socket.sendto(message.pack(self.encoder), self.station)
        self.encoder.seq = (self.encoder.seq + 1) % 256


if __name__ == "__main__":
    main()
