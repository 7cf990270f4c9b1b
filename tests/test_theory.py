"""docs/theory.md quotes the constants, units and files of the code."""

from __future__ import annotations

import math
import re
from pathlib import Path

from joint_id_core import models
from joint_id_core.data.signals import CHANNELS
from joint_id_core.estimators.hpinn import fit as hpinn
from joint_id_core.estimators.innovations import (
    annealing,
    estimator,
    gauss_newton,
    misfit,
    missing_torques,
    recursion,
    search,
    stages,
    verdicts,
    whiteness,
)
from joint_id_core.estimators.shared import fit_data, initial_state, stillness, substeps
from joint_id_core.models import dc_motor, transmission
from joint_id_core.online import (
    change_history,
    checks,
    follower,
    learning,
    levels,
    likelihood_profile,
    memory,
    newest_innovations,
    offsets,
    pending_change,
    profile_search,
    refined_memory,
    resume,
    score_test,
    second_look,
    sharpness,
    stretch,
    trial,
)
from joint_id_core.validation import inverse_dynamics, prediction

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "docs/theory.md").read_text()
BLOCKS = round(10 * 3600 / memory.BLOCK_S)  # in 10 h


def test_files_that_the_theory_names_exist() -> None:
    library = ROOT / "ros2_ws/src/joint_id_core/joint_id_core"
    lines = re.findall(r"Code: ((?:[^.]|\.(?=\w))+)\.|\(code: ([^)]+)\)", TEXT, re.IGNORECASE)
    named = re.findall(r"`([\w/]+(?:\.py|/))`", " ".join(chain for pair in lines for chain in pair))
    assert len(named) > 30
    assert [name for name in named if not (library / name).exists()] == []


def test_constants_in_the_theory() -> None:
    """What docs/theory.md quotes is what the code uses: the text is looked up with the constant put in."""
    words = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 8: "eight", 9: "nine", 64: "64"}
    theory = " ".join(TEXT.split())
    quoted = [
        f"| $N$ | {transmission.GEAR_RATIO:g} |",
        f"| $L$ | {dc_motor.INDUCTANCE:.0e} H".replace("e-0", "e-"),
        f"6e-5 kg m² | the rotor inertia in Table V{'' if dc_motor.ROTOR_INERTIA == 6e-5 else '?'}",
        f"$|\\lambda h| \\le {substeps.STABLE:g}$ on the negative real axis",
        f"$|\\lambda h| \\le {substeps.LIMIT:g}$ for the fastest mode of the sliding joint, at most "
        f"{words[substeps.MOST]}.",
        f"{words[substeps.MORE_STEPS]} times as many steps are taken",
        f"within ${substeps.KINK:g}\\,w_s$ of zero",
        f"more than ${substeps.FAST:g}\\,w_s$, take one step for each $w_s$, up to {substeps.MOST_TURNING:g}.",
        f"From {stages.FALLS:g} on, which a test of the residuals could find with "
        f"{words[round(stages.FALLS**0.5)]} standard deviations",
        f"jumps (by more than {100 * substeps.JUMP:.2g} % of its range) get {words[substeps.MORE_STEPS]} times",
        f"An innovation beyond {follower.JUMP:g} standard deviations is that of a sensor that jumps",
        f"at least {offsets.REACH:g} times what the samples of {words[round(offsets.WINDOWS)]} windows tell",
        f"(or {100 * stages.STEP_TOLERANCE:g} %, where $\\sigma$ is smaller)",
        f"to at most {estimator.MAX_SUBSTEPS}.",
        f"a negligible variance ($10^{{{round(math.log10(recursion.STATE_NOISE))}}}$ of",
        f"more than {words[fit_data.LONGEST_GAP]} missing samples",
        f"a spread of {initial_state.TWIST_SPREAD:g} rad and {initial_state.TWIST_RATE_SPREAD:g} rad/s at the link",
        f"$\\Delta z' H \\Delta z < {stages.TOLERANCE:g}$; or {stages.NEAR:g},",
        f"No step is longer than a factor {'$e$' if gauss_newton.MAX_STEP == 1.0 else '?'}",
        f"$q$ starts at {annealing.STRONG:.0e} times".replace("e+0", "e"),
        f"$q$ held at {annealing.STRONGEST:.0e} times".replace("e+0", "e"),
        "uses the quarter of the record" if annealing.EXCERPT == 4 else "?",
        f"at least {annealing.SHORTEST} samples long",
        f"up to {words[search.EXTRA_STARTS]} more starts",
        f"their costs differ by less than {search.SAME_COST:g}",
        f"more than {search.APART:g} standard deviations apart, whose costs differ by less than {search.CLOSE:g}",
        f"the way that is left is longer than {words[stages.STALLED]} standard deviation,",
        f"From {misfit.LIKELY:g} on the bias counts; above {misfit.SIGNIFICANT:g} the message names",
        f"At most {words[misfit.MOST]} shapes are taken together",
        f"can take more than {100 * (1 - misfit.OWN_SHARE):g} % of it",
        f"if their size is above {misfit.CERTAIN:g}",
        f"stiffness by more than {'half' if misfit.LARGE == 0.5 else '?'}",
        f"{'half' if missing_torques.REACH == 0.5 else '?'} of its rms",
        f"its last {words[len(missing_torques.FORESEEN) - 1]} samples do not foresee",
        f"Above {misfit.SIGNIFICANT:g} standard deviations the message says that it does not",
        f"over {whiteness.LAGS} lags, with",
        f"a probability below {whiteness.RARE:.0e}".replace("e-0", "e-"),
        f"beyond {verdicts.COLOURED:g} in size",
        f"$\\chi^2 = \\overline{{r^2}}$ | above {verdicts.MOST_CHI2:g} |",
        f"nrmse of free runs of {prediction.HORIZON_S:g} s ([validation](#validation)) "
        f"| above {verdicts.CONSTANT_NRMSE:g} |",
        f"| up to {verdicts.PRIOR_RATIO:g} | `estimated` |",
        f"| above {verdicts.NOT_EXCITED_RATIO:g} | `not_excited`",
        f"above {verdicts.MAGNITUDE:g} for a positive parameter | `prior`",
        f"correlation is beyond {verdicts.STRONG_CORRELATION:g} in size",
        f"at least {1000 * stillness.STILL_S:g} ms in which no position",
        f"shows at the latest {1000 * stillness.STILL_S:g} ms after it",
        f"left out too, up to {stillness.WIND_UP_S:g} s",
        f"After a start the first {1000 * fit_data.SETTLE_S:g} ms tell the state",
        f"{words[round(10 * (1.0 - levels.DOUBTED))]} tenths of what was known of the levels is forgotten",
        f"r = {resume.DRIFT_PER_H:g}\\ \\text{{per hour}}",
        f"block of {memory.BLOCK_S:g} s. If it moves by more than {100 * refined_memory.LINEAR:g} %",
        f"by more than {refined_memory.LINEAR_SIGMA:g} standard deviations, the newest blocks (up to {memory.HISTORY})",
        f"over {'a tenth' if sharpness.SHARPEST == 0.1 else '?'} of the velocity",
        f"$({memory.FIRM:g} + \\sum t_j^2)/({memory.FIRM:g} + n)$",
        f"stretches of {', '.join(map(str, memory.LENGTHS[:-1]))} and {memory.LENGTHS[-1]} blocks",
        f"each of them alarms with probability $10^{{{round(math.log10(memory.RARE))}}}$",
        f"of {BLOCKS:,} blocks give at most {2 * len(memory.LENGTHS) * BLOCKS * memory.RARE:.2g} false alarms in 10 h",
        f"Sixteen tests of {BLOCKS:,} blocks" if len(memory.LENGTHS) == 8 else "?",
        f"are learned from the newest {memory.LEARNED} at most",
        f"looks like noise (probability {score_test.LEFT:g})",
        f"no worse than a change of all parameters (probability {learning.UNNEEDED:g})",
        f"tested together, with probability $10^{{{round(math.log10(memory.AGAIN))}}}$",
        f"explain them as well (cost within {score_test.ALIKE:g})",
        f"after {second_look.AFTER[0]}, {second_look.AFTER[1]} and {second_look.AFTER[2]} window lengths of motion",
        f"mean square distance of their estimates is above {second_look.APART:g}",
        f"from {stretch.LEAST:g} window lengths of motion on, at most {stretch.REACH:g}, again after",
        f"again after {stretch.EVERY:g} of new motion, or as seldom",
        f"keep these fits below {100 * stretch.SHARE:g} % of a processor",
        f"had described less than {stretch.LEAST:g} window lengths before",
        f"what was known had described {words[round(change_history.BEFORE)]} windows before it",
        f"its values have described {words[round(change_history.SINCE)]} since",
        f"nothing confirms new values for {words[round(pending_change.PATIENT)]} windows",
        f"until {words[round(trial.TRIAL)]} windows of motion agree with the new fit",
        f"whose logarithms of variances count as known to {resume.NOISE_SIGMA:g}",
        "after {}, {} and {} blocks, since the start or".format(*profile_search.AFTER),
        f"above {likelihood_profile.UNSURE:g} ({100 * likelihood_profile.UNSURE:g} %, or a share of the spread)",
        f"steps of $\\min(\\sigma_a, {likelihood_profile.STEP:g})$, up to {words[likelihood_profile.FARTHEST]}, and",
        f"until the cost has risen by {likelihood_profile.RISEN:g}. With places",
        f"lower by {likelihood_profile.LOWER:g} or more is a new begin",
        f"In the {'first' if follower.YOUNG == 1.0 else '?'} window after the first fit",
        "first after {} window length, then after {} and {} more, ".format(*checks.CHECK_AFTER)
        + f"then after every {checks.CHECK_EVERY}",
        f"innovations leaves {newest_innovations.QUIETER:g} to {newest_innovations.NOISIER:g}",
        f"compared below {inverse_dynamics.DRIVE_BAND_HZ:g} Hz",
        f"for stability and accuracy ($|\\lambda h| \\le {hpinn.STEP_LIMIT:g}$)",
    ]
    assert [text for text in quoted if text not in theory] == []


def test_symbols_of_the_theory_have_the_units_of_the_code() -> None:
    """Rows of the tables `| symbol | names | units | meaning |`: every parameter of every model stands in one."""
    built = [models.build(name) for name in models.MODELS]
    built.append(models.build("harmonic_drive", actuation="current", gravity=True, kinematic_error=True,
                                  delays=True, offsets=True))  # fmt: skip
    units = {p.name: p.unit for model in built for p in model.parameters if not p.name.startswith("w_s")}
    channels = {name: signal.unit for name, signal in CHANNELS.items()}
    found = {}
    for names, unit in re.findall(r"^\| \$[^|]+\$ \| (`[^|]+`) \| ([^|]+) \|", TEXT, re.M):
        found |= dict(zip(re.findall(r"`(\w+)`", names), unit.split(", "), strict=False))
        if len(unit.split(", ")) == 1:
            found |= dict.fromkeys(re.findall(r"`(\w+)`", names), unit)
    assert units.keys() <= found.keys()
    assert found.items() <= (units | channels).items()
