"""A robot controller without a robot: six simulated joints behind RTDE, and faults on demand.

It is there to try things out and to test clients; its joints are made up. `joint-id robot-emulator` starts it.
"""
