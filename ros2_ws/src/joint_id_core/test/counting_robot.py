"""A robot of RTDE in its own process, with nothing but the standard library: every value of a sample is its number.

`python counting_robot.py HOST PERIOD` listens at the port of RTDE and prints a line when it does. It serves one
connection after the other, with a sample every PERIOD s; time stamps are those of 500 Hz. Lines on standard input:
`cut` ends the connection, `mute` sends no more from then on. Each is answered by `true` once it holds.
"""

import socket
import struct
import sys
import threading
import time

PORT, STEP_S = 30004, 0.002
CODES = {"timestamp": "d", "actual_q": "6d", "actual_qd": "6d", "joint_mode": "6i", "robot_mode": "i"}
NAMES = {"d": "DOUBLE", "6d": "VECTOR6D", "6i": "VECTOR6INT32", "i": "INT32"}

mute = threading.Event()
cut = threading.Event()


def packet(kind, payload=b""):
    return struct.pack(">HB", 3 + len(payload), ord(kind)) + payload


def exactly(sock, size):
    data = b""
    while len(data) < size:
        more = sock.recv(size - len(data))
        if not more:
            raise ConnectionError
        data += more
    return data


def serve(sock, period_s):
    layout = ""
    while True:
        size, kind = struct.unpack(">HB", exactly(sock, 3))
        payload = exactly(sock, size - 3)
        if chr(kind) == "v":
            sock.sendall(packet("v", struct.pack(">4I", 5, 13, 0, 0)))
        elif chr(kind) == "O":
            codes = [CODES[name] for name in payload[8:].decode().rstrip(",").split(",")]
            layout = ">B" + "".join(codes)
            sock.sendall(packet("O", b"\x01" + ",".join(NAMES[code] for code in codes).encode()))
        else:
            sock.sendall(packet(chr(kind), b"\x01"))
        if chr(kind) == "S":
            break
    count = len(struct.unpack(layout, bytes(struct.calcsize(layout)))) - 2
    number, begin = 0, time.monotonic()
    while not cut.is_set():
        number += 1
        time.sleep(max(0.0, begin + number * period_s - time.monotonic()))
        if not mute.is_set():
            sock.sendall(packet("U", struct.pack(layout, 1, number * STEP_S, *[number] * count)))
    cut.clear()


def listen():
    with socket.create_server((sys.argv[1], PORT)) as server:
        print("ready", flush=True)
        while True:
            sock, _ = server.accept()
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            try:
                serve(sock, float(sys.argv[2]))
            except OSError:
                pass
            finally:
                sock.close()


threading.Thread(target=listen, daemon=True).start()
for line in sys.stdin:
    {"cut": cut, "mute": mute}[line.strip()].set()
    print("true", flush=True)
