"""Draw measured and predicted signals, and use the arrays behind the picture. Needs matplotlib."""

import numpy as np

import joint_id_core as jid

model = jid.build("harmonic_drive")
estimate = jid.fit(model, jid.simulate_motion(model, duration=3.0))
estimate.plot("fit.png")
print("see fit.png")

shown = estimate.predictions
for signal, predicted in shown.predicted.items():
    error = predicted - shown.measured[signal]
    print(f"{signal}: largest error {np.nanmax(np.abs(error)):.2g}, at {shown.time[np.nanargmax(np.abs(error))]:.3f} s")
