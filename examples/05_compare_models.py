"""Which friction law describes a joint? Rank models by what they predict of data that they have not seen."""

import joint_id_core as jid

truth = jid.build("rigid_joint", friction="stribeck")
recording = jid.simulate_motion(truth, duration=6.0, seed=3)

found = jid.compare(["rigid_joint:coulomb_viscous", "rigid_joint:stribeck"], recording)
print(found)

best = found.ranking.best
print("best:", best.label)
print("fit it with: joint-id fit FILE", *best.candidate.arguments)
