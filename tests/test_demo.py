"""`make demo`: estimates with their uncertainty appear beside the truth, and a picture is made."""

import re

import pytest
from conftest import DEMO, DEMO_S
from matplotlib.image import imread

ROW = re.compile(r"^  (\w+) +(\S.*?) +(\S+) ± (\S+) +(\S+) +([+-]\S+) σ   (\w[\w ]*)$", re.MULTILINE)
# The demo without the robot and the replay: test_driver*.py and test_chain.py have both.
TWO_ACTS = f"""
import sys
sys.path.insert(0, {str(DEMO.parent)!r})
import acts, demo
kept, live = [], acts.live
acts.live = lambda *arguments: kept.append(live(*arguments)) or kept[0]
acts.robot = lambda _: (kept[0], {{}}, {{}}, "nothing")
acts.replay = lambda *_: kept[0]
sys.exit(demo.main())
"""


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.long)], ids=["two acts", "whole"])
def test_every_act_shows_estimates_beside_the_truth_and_the_picture_is_made(demo, tmp_path, whole):
    process = demo("--duration", "6", **({} if whole else {"program": ("-c", TWO_ACTS)}))
    text, _ = process.communicate(timeout=DEMO_S)
    assert process.returncode == 0, text
    acts = re.split(r"^Act \d, ", text, flags=re.MULTILINE)[1:]
    assert re.findall(r"^Act (\d), ", text, re.MULTILINE) == ["1", "2", "3", "4", "5"]
    found = {"R", "k_b", "k_t", "c_m", "tau_fm", "c_1", "k_1"}
    robot = {"J_m", "tau_fm", "c_1", "k_1", "k_2", "J_q", "c_q", "tau_fq"}
    # The robot sticks and slips exactly, which the smoothed friction of the fit follows to some percent only.
    expected = ((found, 0.01), (robot, 0.01), (robot, 0.03), (found, 0.01))
    for act, (names, share) in zip(acts, expected[: 4 if whole else 2], strict=False):
        rows = {row[0]: row for row in ROW.findall(act)}  # the last table of the act
        assert names <= set(rows)
        for name, unit, value, std_dev, truth, sigma, verdict in rows.values():
            assert unit and verdict == "estimated"
            error, std = float(value) - float(truth), float(std_dev)
            assert std > 0.0
            # What is shown fits together; the shown truth has four digits.
            assert abs(error / std - float(sigma)) < 0.2 + 1e-3 * float(truth) / std, name
            assert abs(error) < max(5.0 * std, share * float(truth)), (name, value, std_dev, truth)
    # The load was followed within two windows of 2 s, and its inertia was named, and nothing else. Estimates are
    # counted, half a second of motion each, because a busy computer publishes fewer of them.
    assert re.search(r"J_q changed after \S+ s of motion; \S+ s later the estimate was within 1%", acts[1]), acts[1]
    found_out = re.findall(r"load: \S+ s of motion, estimate \d+, ([\w ]+),", acts[1])
    assert len(found_out) > 9 and sum(status != "converged" for status in found_out) <= 8, acts[1]
    assert re.search(r"The identifier says: Changed: J_q from 0\.7\d+ ± \S+ to 1\.5\d+ ± \S+$", acts[1], re.MULTILINE)
    # The connection was cut once, and all six joints were identified, or called what they are. A computer that stands
    # still for seconds may cut it again and lose samples; test_driver*.py test that a driver with time does neither.
    if whole:
        assert re.search(r"the driver says: .*, lost \d+, reconnects [1-9];", acts[2])
        assert len(re.findall(r"^  \w+_joint +(?:converged|poor fit) ", acts[2], re.MULTILINE)) == 6
    picture = imread(tmp_path / "demo.png")
    assert picture.shape[0] > 500 and picture.shape[1] > 1000
    assert picture.std() > 0.05  # something is drawn on it
    assert (tmp_path / "out/recording/metadata.yaml").is_file()
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["logs", "recording"]
