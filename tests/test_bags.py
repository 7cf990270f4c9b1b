"""The recordings in bags/: any rosbag2 reader takes them, and a fit finds the truth that is beside them."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from joint_id_core.cli import app
from joint_id_core.models import MODELS, build

ROOT = Path(__file__).resolve().parent.parent
BAGS = ROOT / "bags"
NAMES = ("model_3_steps", "model_2_multisine")
RAW = {"/link_states", "/motor_states", "/motor_voltages"}
FACTOR = 2.0  # by which start values are off, at most


@pytest.fixture(params=NAMES)
def bag(request):
    """Path of a bag and its truth."""
    path = BAGS / request.param
    return path, yaml.safe_load(path.with_suffix(".yaml").read_text())


def test_recordings_are_small():
    assert sum(f.stat().st_size for f in BAGS.rglob("*") if f.is_file()) < 2e6


def test_rosbags_reads_every_sample_of_the_raw_topics(bag):
    path, truth = bag
    count = round(truth["duration_s"] * truth["rate_hz"])
    with AnyReader([path]) as reader:
        assert {c.topic for c in reader.connections} <= RAW
        for connection in reader.connections:
            messages = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages([connection])]
            stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages]
            assert np.array_equal(np.diff(stamps), np.full(count - 1, round(1e9 / truth["rate_hz"])))
            assert {tuple(m.name) for m in messages} == {(truth["joint"],)}


def test_mcap_reads_the_same_topics(bag):
    path, truth = bag
    with (path / f"{path.name}.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert {c.topic for c in summary.channels.values()} <= RAW
    assert all(c.message_encoding == "cdr" for c in summary.channels.values())
    count = round(truth["duration_s"] * truth["rate_hz"])
    assert list(summary.statistics.channel_message_counts.values()) == [count] * len(summary.channels)


def test_truth_has_every_parameter_of_the_model_with_its_unit(bag):
    _, truth = bag
    options = {"actuation": truth["actuation"]} if "actuation" in truth else {}
    model = build(truth["model"], **options)
    assert truth["model"] in MODELS
    smoothing = set(model.smoothing.values())  # the simulated joint sticks exactly, it has none
    assert {n: row["unit"] for n, row in truth["parameters"].items()} == {
        p.name: p.unit for p in model.parameters if p.name not in smoothing
    }


def test_fit_from_wrong_start_values_finds_the_truth(bag, capsys):
    path, truth = bag
    true = {name: row["value"] for name, row in truth["parameters"].items()}
    options = {"actuation": truth["actuation"]} if "actuation" in truth else {}
    table = build(truth["model"], **options).parameters
    rng = np.random.default_rng(0)
    start = {p.name: true[p.name] * FACTOR ** rng.uniform(-1.0, 1.0) for p in table if not p.fixed}
    start |= {"k_t": true["k_t"]} if "k_t" not in start else {}
    command = ["fit", str(path), "--model", truth["model"], "--json"]
    for name, value in start.items():
        command += ["--set", f"{name}={value!r}"]
    with pytest.raises(SystemExit) as end:
        app(command, prog_name="joint-id")
    out, err = capsys.readouterr()
    assert end.value.code == 0, err
    rows = {row["name"]: row for row in json.loads(out)["parameters"]}
    for p in table:
        if not p.fixed:
            row, error = rows[p.name], abs(rows[p.name]["value"] - true[p.name])
            assert row["verdict"] == "estimated"
            assert error < max(4.0 * row["std_dev"], 0.01 * true[p.name]), (p.name, row, true[p.name])
