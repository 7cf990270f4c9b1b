"""Recordings and tables in object storage and on a web server."""

from __future__ import annotations

import http.server
import threading
import urllib.request
from functools import partial
from pathlib import Path

import fsspec
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from joint_id_core import formats
from joint_id_core.batch.recordings import find
from joint_id_core.errors import JointIdError
from joint_id_core.formats.remote import RemotePath

from .bag_parts import joint_state
from .many_recordings import recordings, rows, run_here, write_bags

KEPT = ("joint", "status", "message", "parameters", "free", "covariance", "samples", "size_bytes")


def same(output, other) -> bool:
    """Whether two tables have the same results."""
    found, expected = rows(output), rows(other)
    return [{k: r[k] for k in KEPT} for r in found] == [{k: r[k] for k in KEPT} for r in expected]


def ask(address: str, data: bytes = b"") -> None:
    """Tell the server what it is to do."""
    kind = {"Content-Type": "text/plain"}
    urllib.request.urlopen(urllib.request.Request(address, data=data, headers=kind, method="POST")).close()


@pytest.fixture
def storage(monkeypatch):
    """A server that speaks S3, with a bucket: its address, and the file system of fsspec for it."""
    moto = pytest.importorskip("moto.server")
    pytest.importorskip("s3fs")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    address = "http://{}:{}".format(*server.get_host_and_port())
    for name, value in (
        ("AWS_ENDPOINT_URL", address), ("AWS_ACCESS_KEY_ID", "key"), ("AWS_SECRET_ACCESS_KEY", "secret"),
        ("AWS_DEFAULT_REGION", "us-east-1"), ("AWS_MAX_ATTEMPTS", "1"),
    ):  # fmt: skip
        monkeypatch.setenv(name, value)
    files = fsspec.filesystem("s3", skip_instance_cache=True)
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    files.mkdir("fleet")
    yield address, files
    ask(f"{address}/moto-api/reset")
    server.stop()
    fsspec.get_filesystem_class("s3").clear_instance_cache()


@pytest.fixture
def memory():
    files = fsspec.filesystem("memory")
    yield files
    files.store.clear()
    files.pseudo_dirs[:] = [""]


def test_bags_and_the_table_may_be_in_object_storage(tmp_path, storage):
    _, files = storage
    bags = write_bags(tmp_path / "ur_1", 2)
    formats.write_csv(tmp_path / "ur_1/log.csv", recordings(3)[2])
    files.put(str(tmp_path / "ur_1"), "fleet/ur_1", recursive=True)
    run_here([*bags, tmp_path / "ur_1/log.csv"], tmp_path / "here.parquet")
    pattern, output = "s3://fleet/{robot}/**", "s3://fleet/out.parquet"
    done = run_here([pattern], output)
    assert (done.fitted, done.rows) == (3, {"converged": 3})
    files.get("fleet/out.parquet", str(tmp_path / "there.parquet"))
    assert same(tmp_path / "there.parquet", tmp_path / "here.parquet")
    found = rows(tmp_path / "there.parquet")
    assert [r["recording"] for r in found] == [f"s3://fleet/ur_1/{n}" for n in ("a_0", "a_1", "log.csv")]
    assert {r["robot"] for r in found} == {"ur_1"} and found[2]["message"].startswith("Converged")
    assert sorted(n for n in files.find("fleet") if "parquet" in n) == ["fleet/out.parquet"]
    assert run_here([pattern], output).before == 3
    files.pipe("fleet/ur_1/log.csv", files.cat("fleet/ur_1/log.csv") + b"\n")
    assert run_here([pattern], output).fitted == 1


def test_a_half_written_table_in_object_storage_is_kept_aside(tmp_path, storage):
    _, files = storage
    (bag,) = write_bags(tmp_path, 1)
    files.pipe("fleet/out.parquet", b"PAR1 half")
    done = run_here([bag], "s3://fleet/out.parquet")
    assert "kept as s3://fleet/out.parquet.damaged" in done.said[0]
    assert files.cat("fleet/out.parquet.damaged") == b"PAR1 half"


def test_a_bucket_without_rights_or_that_is_not_there_is_said(tmp_path, storage, run):
    address, files = storage
    (bag,) = write_bags(tmp_path, 1)
    files.put(str(bag), "fleet/a_0", recursive=True)
    output = tmp_path / "out.parquet"
    run_here([bag], output)
    before = output.read_bytes()
    code, _, err = run("batch", "s3://nowhere/**", "-o", output)
    assert code == 2 and "s3://nowhere" in err
    ask(f"{address}/moto-api/reset-auth", b"0")
    try:
        for words in (("s3://fleet/**", "-o", output), (bag, "-o", "s3://fleet/out.parquet")):
            code, _, err = run("batch", *words)
            assert code == 2 and "s3://fleet" in err and "access denied" in err and "check keys and rights" in err
    finally:
        ask(f"{address}/moto-api/reset-auth", b"inf")
    assert output.read_bytes() == before


def test_only_the_chunks_with_joints_are_read(tmp_path, storage, monkeypatch):
    """A camera fills most of a bag; its chunks are left where they are."""
    _, files = storage
    store, n = get_typestore(Stores.ROS2_JAZZY), 400
    image = store.types["std_msgs/msg/String"]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        joints = writer.add_connection("/link_states", "sensor_msgs/msg/JointState", typestore=store)
        camera = writer.add_connection("/camera", "std_msgs/msg/String", typestore=store)
        for k in range(n):
            stamp = k * 8_000_000
            state = joint_state(store, stamp, ["elbow"], [np.sin(k / 9)], [np.cos(k / 9)], [1.0])
            writer.write(joints, stamp, store.serialize_cdr(state, "sensor_msgs/msg/JointState"))
        for k in range(20):
            data = store.serialize_cdr(image("x" * 600_000), "std_msgs/msg/String")
            writer.write(camera, n * 8_000_000 + k, data)
    files.put(str(tmp_path / "bag"), "fleet/bag", recursive=True)
    import s3fs

    read, fetch = [], s3fs.S3File._fetch_range

    def counted(self, start, end):
        read.append(end - start)
        return fetch(self, start, end)

    monkeypatch.setattr(s3fs.S3File, "_fetch_range", counted)
    found = formats.read_joints("s3://fleet/bag").recordings["elbow"]
    size = sum(p.stat().st_size for p in (tmp_path / "bag").glob("*.mcap"))
    assert size > 12e6 and 0 < sum(read) < 2e6
    here = formats.read(tmp_path / "bag")
    assert np.array_equal(found["link_position"], here["link_position"]) and found.source == "s3://fleet/bag"


def test_what_is_in_the_memory_of_this_process(tmp_path, memory):
    (bag,) = write_bags(tmp_path, 1)
    memory.put(str(bag), "/logs/a_0", recursive=True)
    run_here([bag], tmp_path / "here.parquet")
    run_here(["memory://logs/*/*.mcap"], "memory://out.parquet")
    memory.get("/out.parquet", str(tmp_path / "there.parquet"))
    assert same(tmp_path / "there.parquet", tmp_path / "here.parquet")


def test_every_format_is_read_from_a_storage(tmp_path, memory):
    from scipy.io import savemat

    motion = recordings(1)[0]
    columns = {"time_s": motion.time, **motion.channels}
    savemat(tmp_path / "a.mat", columns)
    formats.write_csv(tmp_path / "a.csv", motion)
    formats.write_bag(tmp_path / "old", {"elbow": motion}, "sqlite3")
    memory.put(str(tmp_path), "/all", recursive=True)
    for name in ("a.mat", "a.csv", "old"):
        there = formats.read(f"memory://all/{name}")
        assert there.source == f"memory://all/{name}" and np.allclose(there["torque"], motion["torque"])
    assert formats.joints("memory://all/old") == ("elbow",)
    memory.pipe("/all/a.csv", b"a,b\n1,2\n")
    with pytest.raises(JointIdError, match=r"^memory://all/a.csv: no known time_s"):
        formats.read("memory://all/a.csv")
    memory.pipe("/all/cut.mcap", memory.cat("/all/old/metadata.yaml"))
    with pytest.raises(JointIdError, match=r"^memory://all/cut.mcap: not a readable bag"):
        formats.read("memory://all/cut.mcap")
    with pytest.raises(JointIdError, match=r"^memory://all/none.csv: no such file"):
        formats.read("memory://all/none.csv")


class Ranges(http.server.SimpleHTTPRequestHandler):
    """Serves files, and parts of them."""

    def do_GET(self):
        content = Path(self.translate_path(self.path)).read_bytes()
        asked = self.headers.get("Range")
        first, last = asked.removeprefix("bytes=").split("-") if asked else ("0", "")
        part = content[int(first) : int(last or len(content)) + 1]
        self.send_response(206 if asked else 200)
        self.send_header("Content-Length", str(len(part)))
        if asked:
            self.send_header("Content-Range", f"bytes {first}-{int(first) + len(part) - 1}/{len(content)}")
        self.end_headers()
        self.wfile.write(part)

    def send_head(self):
        path = Path(self.translate_path(self.path))
        self.send_response(200 if path.exists() else 404)
        self.send_header("Content-Length", str(path.stat().st_size if path.exists() else 0))
        self.send_header("Accept-Ranges", "bytes")
        self.end_headers()

    def log_message(self, *_):
        """Say nothing."""


def test_a_bag_on_a_web_server(tmp_path):
    pytest.importorskip("aiohttp")
    (bag,) = write_bags(tmp_path, 1)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Ranges, directory=str(bag)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        url = f"http://127.0.0.1:{server.server_port}/a_0.mcap"
        (one,) = find([url])
        assert (one.place, one.size_bytes) == (url, (bag / "a_0.mcap").stat().st_size)
        assert np.array_equal(formats.read(url).time, formats.read(bag).time)
        with pytest.raises(JointIdError, match=r"none.mcap: cannot be read"):
            find([url.replace("a_0", "none")])
    finally:
        server.shutdown()
        server.server_close()


def test_a_network_that_fails_is_not_taken_for_a_damaged_bag(tmp_path, memory, monkeypatch):
    (bag,) = write_bags(tmp_path, 1)
    memory.put(str(bag), "/logs/a_0", recursive=True)

    def fail(self, size=-1):
        raise OSError("the line is cut")

    monkeypatch.setattr("fsspec.implementations.memory.MemoryFile.read", fail)
    with pytest.raises(JointIdError, match=r"cannot be read \(the line is cut\): check address, keys and network"):
        formats.read("memory://logs/a_0/a_0.mcap")


def test_an_unknown_kind_of_address_is_said():
    with pytest.raises(JointIdError, match="gopher://a"):
        RemotePath("gopher://a/b.mcap")
