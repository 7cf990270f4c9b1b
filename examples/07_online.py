"""Identify while samples arrive: the first window is fitted, then every sample counts once."""

import joint_id_core as jid

model = jid.build("harmonic_drive")
recording = jid.simulate_motion(model, duration=6.0, values={"k_1": 6000.0})

identifier = jid.OnlineIdentifier(model, options=jid.OnlineOptions(window_s=2.0, hop_s=0.5))
for first in range(0, len(recording), 25):  # 25 samples arrive at a time, 50 ms of motion
    estimate = identifier.update(recording.slice(first, first + 25))
    if estimate is None:
        continue  # no hop has passed
    k_1 = estimate["k_1"]
    print(f"{estimate.end:5.2f} s  k_1 = {k_1.value:6.1f} ± {k_1.std_dev:5.1f} {k_1.unit}  {estimate.status.value}")
