"""A vehicle in a process of its own: numbered PING messages over UDP, each with its time of sending, without end.

Run: python numbered_sender.py PORT RATE [HOST]
"""

import socket
import sys
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

PERIOD_S = 0.005
HEARTBEAT_S = 0.5


def main() -> None:
    port, rate = int(sys.argv[1]), float(sys.argv[2])
    host = sys.argv[3] if len(sys.argv) > 3 else "127.0.0.1"
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, 0, 0, 0, 4, 3)
    number = 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect((host, port))
        print("sending", flush=True)
        start = time.monotonic()
        next_beat = 0.0
        while True:
            passed = time.monotonic() - start
            messages = []
            if passed >= next_beat:
                next_beat = passed + HEARTBEAT_S
                messages.append(beat)
            # A machine that was busy elsewhere is no reason for a burst that no vehicle would send.
            for _ in range(min(int(passed * rate) - number, int(rate * 10 * PERIOD_S) + 1)):
                messages.append(mavlink.MAVLink_ping_message(time.time_ns() // 1000, number, 0, 0))
                number += 1
            if int(passed * rate) > number:
                start = time.monotonic() - number / rate
            for message in messages:
                frame = message.pack(mav)
                mav.seq = (mav.seq + 1) % 256
                try:
                    sock.send(frame)
                except OSError:  # the station is not there any more, or not yet, or no way leads to it
                    continue
            time.sleep(PERIOD_S)


if __name__ == "__main__":
    main()
