"""Emulator of a robot controller: six simulated joints behind RTDE, and faults on demand.

Use it to try things out and to test clients; its joints are fictitious. `joint-id robot-emulator` starts it.
"""
