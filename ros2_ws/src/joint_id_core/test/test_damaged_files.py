"""Compressed tables that are damaged."""

import gzip

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.errors import JointIdError


def test_a_compressed_file_that_is_damaged_within_is_told_as_damaged(tmp_path):
    """Its text goes on as another one, so that a line has too few cells, or no text at all comes out."""
    path, random = tmp_path / "log.csv.gz", np.random.default_rng(0)
    rows = [f"{k / 500:.3f},{a:.6f}\n" for k, a in enumerate(random.normal(size=3000))]
    whole = gzip.compress("".join(["time_s,current\n", *rows]).encode())
    for place in random.integers(20, len(whole) - 8, 20):
        damaged = bytearray(whole)
        damaged[place] ^= 0x55
        path.write_bytes(damaged)
        with pytest.raises(JointIdError, match=r"log.csv.gz: the compressed file is damaged \(.*\): copy it again$"):
            formats.joints(path) or formats.read(path)
    path.write_bytes(gzip.compress(b"time_s,current\n0,1\n1\n1,2\n"))
    with pytest.raises(JointIdError, match=r"log.csv.gz: line 3 has 1 cells, the header has 2"):
        formats.read(path)
