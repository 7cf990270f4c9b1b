"""Forward simulation with exact stick and slip: joints, sensors, position control and motions."""
