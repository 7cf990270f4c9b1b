"""Fit a joint model to a CSV file, and read the result.

The file has a column `time_s` and one column for each signal, in SI units. Here it is simulated first.
"""

from pathlib import Path

import joint_id_core as jid

model = jid.build("harmonic_drive")
truth = model.values({"k_1": 8000.0, "J_q": 1.2})
Path("motion.csv").unlink(missing_ok=True)  # of an earlier run: nothing is overwritten
jid.write("motion.csv", jid.simulate_motion(model, duration=3.0, values=truth))

recording = jid.read("motion.csv")
print("signals:", ", ".join(recording.channels))

estimate = jid.fit(model, recording)
print(estimate)

k_1 = estimate["k_1"]
print(
    f"stiffness {k_1.value:.0f} ± {k_1.std_dev:.0f} {k_1.unit} ({k_1.verdict.value}); the truth is {truth['k_1']:.0f}"
)
if not estimate.converged:
    print("what to do:", estimate.status.advice)
