"""Real-Time Data Exchange: the stream of measurements of a Universal Robots controller.

Read-only: nothing here can move a robot.
"""
