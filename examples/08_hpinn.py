"""The paper's network (H-PINN) beside the default estimator, on the same data and from the same starts.

Needs torch: `pip install torch`.
"""

import joint_id_core as jid

model = jid.build("dc_motor")
truth = model.values()
recording = jid.simulate_motion(model, duration=1.0, rate=1000.0)
starts = jid.ParameterSettings({name: 1.1 * truth[name] for name in ("R", "k_b", "k_t", "c_b", "tau_fc")})

for estimator in (jid.HPinn(epochs=200), jid.Innovations()):
    estimate = jid.fit(model, recording, starts, estimator)
    print(
        f"{estimate.estimator}: {estimate.status.value} in {estimate.iterations} iterations, {estimate.elapsed_s:.2f} s"
    )
    for name in starts.values:
        print(f"  {name:<7}{100 * (estimate[name].value / truth[name] - 1):+7.2f} %")
