"""A file takes the place of an older one when it is whole."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from full_disk import full_at

from bwbn_bayes import UserError, sine, write_record
from bwbn_bayes.errors import replace_file

MOTION = sine(amplitude=1.0, frequency_hz=1.0, duration=6.0, time_step=0.02)


@pytest.mark.parametrize("name", ["record.csv", "record.nc"])
def test_a_full_disk_leaves_the_record_that_was_there(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    write_record(MOTION, path)
    before = path.read_bytes()
    with full_at(1000), pytest.raises(UserError, match="cannot be written"):
        write_record(MOTION.until(5.0), path)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == [name]


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "own").write_bytes(b"old")
    (tmp_path / "link").symlink_to("own")
    replace_file(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "own").read_bytes() == b"new"


def test_a_pipe_is_written_to(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    replace_file(pipe, b"through")
    reader.join(10.0)
    assert read == [b"through"]
