"""Keep an estimate as JSON, and use it later: validate it on another recording, start the next fit from it."""

import joint_id_core as jid

model = jid.build("harmonic_drive")
estimate = jid.fit(model, jid.simulate_motion(model, duration=4.0, seed=1))
estimate.save("joint.json")

later = jid.Estimate.load("joint.json")
same_model = jid.build(later.model, **later.model_options)
monday = jid.simulate_motion(model, duration=4.0, seed=2)
for signal, nrmse in jid.held_out(same_model, monday, later).items():
    print(f"{signal}: predicted 0.1 s ahead to {nrmse:.2g} of its variation")

again = jid.fit(same_model, monday, jid.ParameterSettings(later.values))
for name in later.free:
    before, now = later[name], again[name]
    sigma = (before.std_dev**2 + now.std_dev**2) ** 0.5
    print(
        f"{name:<7}{before.value:10.4g} then {now.value:10.4g}: {(now.value - before.value) / sigma:+.1f} sigma apart"
    )
