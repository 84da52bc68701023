"""A file takes the place of an older one when it is whole."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from full_disk import full_at

from bwbn_bayes import UserError, sine, write_record
from bwbn_bayes.cli.files import write_example, write_new
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


def test_what_a_full_disk_cuts_off_is_not_in_the_way_of_the_next_try(tmp_path: Path) -> None:
    """A model file to start from, and an example with its records: `exists already`, it said then."""
    with full_at(100), pytest.raises(UserError, match="cannot be written"):
        write_new("x" * 1000, tmp_path / "model.py")
    with full_at(5000), pytest.raises(UserError, match="cannot be written"):
        write_example("hidden_effect", tmp_path / "hidden_effect.py")
    assert list(tmp_path.iterdir()) == []
    write_example("hidden_effect", tmp_path / "hidden_effect.py")
    with pytest.raises(UserError, match=r"hidden_effect.py exists already: give another name with --out"):
        write_example("hidden_effect", tmp_path / "hidden_effect.py")


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
