"""The kernel cache among damage, other users and places that cannot be written."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines import cache_files, precompile
from bwbn_bayes.engines.cache_files import cache_directory, write_checked
from bwbn_bayes.engines.kept_code import remembered
from bwbn_bayes.engines.kernel import Kernel
from bwbn_bayes.engines.kernel_compiler import object_code
from bwbn_bayes.structures.shear_building import ShearBuilding

SOURCE = "def double(x: float) -> float:\n    return 2.0 * x\n"


@pytest.fixture(autouse=True)
def _fresh() -> Iterator[None]:
    """Each test as a process of its own would see it."""
    _forget()
    yield
    _forget()


def _forget() -> None:
    cache_files._first_usable.cache_clear()
    cache_files._TOLD.clear()


def _run() -> None:
    """What every run does: a kernel is loaded and solves, and something is remembered."""
    assert Kernel("probe", SOURCE).functions("double").double(1.0) == 2.0
    assert remembered("probe", "key", lambda: ["made"]) == ["made"]


DAMAGE = {
    "empty": lambda _: b"",
    "truncated": lambda whole: whole[: len(whole) // 2],
    "garbage": lambda _: b"\x80garbage" * 50,
    "flipped": lambda whole: whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:],
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
@pytest.mark.parametrize("name", ["probe*.py", "*.object", "*.kept"])
def test_a_damaged_file_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, damage
) -> None:  # type: ignore[no-untyped-def]
    """Eleven kinds of damage of eleven broke every later run, with a traceback that did not name the file."""
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "cache"))
    _run()
    (path,) = (tmp_path / "cache").rglob(name)
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    assert capsys.readouterr().err == ""
    _run()
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"kernel cache: {path} is made anew")
    assert path.read_bytes() == whole
    _run()
    assert capsys.readouterr().err == ""


def test_a_folder_in_the_place_of_a_file_costs_the_cache_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "cache"))
    _run()
    for path in [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]:
        path.unlink()
        path.mkdir()
    _run()
    assert "cannot be kept" in capsys.readouterr().err


def test_the_folder_is_the_users_own_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "cache"))
    _run()
    paths = [tmp_path / "cache", *(tmp_path / "cache").rglob("*")]
    assert len(paths) == 4
    assert not any(path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO) for path in paths)


def _plant(folder: Path, trace: Path) -> None:
    """In the place of every file another, with a hash as the package writes it: a kernel that does something else."""
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        if path.suffix == ".py":
            path.write_text(f"import os\nos.mkdir({str(trace)!r})\n")
        elif path.suffix == ".object":
            write_checked(path, object_code(SOURCE.replace("2.0", "3.0"), "double"))
        else:
            write_checked(path, b'["planted"]')


def test_what_is_planted_would_be_felt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Machine code is the user's own where the folder is: the tests below would see it run."""
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "cache"))
    _run()
    _plant(tmp_path / "cache", tmp_path / "trace")
    assert Kernel("probe", SOURCE).functions("double").double(1.0) == 3.0
    assert remembered("probe", "key", lambda: ["made"]) == ["planted"]


def test_a_folder_that_others_can_write_to_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What another user put into a folder of mode 1777 was executed, three times of three."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    open_to_all, trace = tmp_path / "open", tmp_path / "trace"
    monkeypatch.setenv("BWBN_CACHE_DIR", str(open_to_all))
    _run()
    _plant(open_to_all, trace)
    open_to_all.chmod(0o1777)
    _forget()
    _run()
    assert not trace.exists()
    instead = tmp_path / f"bwbn_bayes-{os.geteuid()}"
    assert capsys.readouterr().err == (
        f"compiled kernels cannot be kept in {open_to_all} (others may write to it): {instead} is used instead\n"
    )
    assert len(list(instead.rglob("*.object"))) == 1
    assert stat.S_IMODE(instead.stat().st_mode) == 0o700


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("whole_folder", [True, False])
def test_what_belongs_to_another_user_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], whole_folder: bool
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folder, trace = tmp_path / "cache", tmp_path / "trace"
    monkeypatch.setenv("BWBN_CACHE_DIR", str(folder))
    _run()
    _plant(folder, trace)
    for path in [folder, *folder.rglob("*")]:
        if whole_folder or path.is_file():
            os.chown(path, 65534, 65534)
    _forget()
    _run()
    assert not trace.exists()
    said = capsys.readouterr().err
    assert ("it belongs to another user" in said) == whole_folder
    assert ("others could have written it" in said) != whole_folder


def test_source_is_compared_with_what_was_generated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even a file of the user's own is not executed where it is not what the package would write."""
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "cache"))
    _run()
    paths = list((tmp_path / "cache").glob("*.py"))
    whole = [path.read_text() for path in paths]
    for path in paths:
        path.write_text(f"import os\nos.mkdir({str(tmp_path / 'trace')!r})\n")
    _run()
    assert not (tmp_path / "trace").exists()
    assert [path.read_text() for path in paths] == whole


_PLACES = {
    "a file": lambda folder: (folder / "file").write_text("taken") and folder / "file",
    "below a file": lambda folder: (folder / "file").write_text("taken") and folder / "file" / "cache",
    "no such device": lambda _: Path("/proc/nowhere"),
    "full disk": lambda _: Path("/dev/full"),
    "too long a name": lambda folder: folder / ("n" * 300),
}


@pytest.mark.parametrize("place", _PLACES.values(), ids=_PLACES)
def test_a_place_that_cannot_be_written_gives_way_to_a_temporary_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], place
) -> None:  # type: ignore[no-untyped-def]
    """HOME unset, not writable or a file, and a full disk each ended in a traceback."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("BWBN_CACHE_DIR", str(place(tmp_path)))
    _run()
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("compiled kernels cannot be kept in ")
    assert said.endswith(f"{tmp_path / f'bwbn_bayes-{os.geteuid()}'} is used instead")


def test_without_a_home_kernels_are_kept_among_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def nobody(_: str) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("pathlib.Path.expanduser", nobody)
    monkeypatch.setattr("pathlib.Path.home", lambda: nobody(""))
    for name in ("BWBN_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    _run()
    assert "there is no home directory" in capsys.readouterr().err
    assert cache_directory() == tmp_path / f"bwbn_bayes-{os.geteuid()}"


def test_where_nothing_can_be_written_kernels_stay_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("taken")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "file"))
    _run()
    (said,) = capsys.readouterr().err.splitlines()
    assert said.endswith("nothing is kept, and every run compiles anew")
    law = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0)).law
    assert precompile.precompile({law: True}, driven=False) is None


def test_a_disk_that_fills_up_costs_the_cache_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "cache"))
    cache_directory()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    _run()
    said = capsys.readouterr().err.splitlines()
    assert all("No space left on device" in line for line in said)
    assert not [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]


def test_what_a_killed_process_never_finished_is_swept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old, new = tmp_path / "probe.py.1.2.tmp", tmp_path / "probe.py.3.4.tmp"
    for path, age in ((old, 7200.0), (new, 60.0)):
        path.write_text("half")
        os.utime(path, (time.time() - age,) * 2)
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path))
    cache_directory()
    assert (old.exists(), new.exists()) == (False, True)


def test_compiling_ahead_imports_nothing_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The child had the current folder on its path: a `numba.py` lying there was executed."""
    for name in ("numba", "sympy", "bwbn_bayes"):
        (tmp_path / f"{name}.py").write_text(f"import os\nos.mkdir({str(tmp_path / 'trace')!r})\n")
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    law = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0)).law
    compiling = precompile.precompile({law: False}, driven=False)
    assert compiling is not None
    compiling.join(timeout=300)
    assert not (tmp_path / "trace").exists()
    assert list((tmp_path / "cache").rglob("*.object"))


_STARTS_COMPILING = """
import os
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock
from bwbn_bayes.engines.precompile import precompile
from bwbn_bayes.structures.shear_building import ShearBuilding

building = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0))
precompile({building.with_effect(SlipLock(delta_s=0.02, sigma=0.05)).law: True}, driven=False)
print("started", flush=True)
input()
"""


def test_no_child_outlives_its_parent(tmp_path: Path) -> None:
    """A parent that was killed left its child compiling."""
    environment = {**os.environ, "BWBN_CACHE_DIR": str(tmp_path)}
    parent = subprocess.Popen(
        [sys.executable, "-c", _STARTS_COMPILING], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert parent.stdin is not None
    assert parent.stdout is not None
    with parent.stdin, parent.stdout:
        assert parent.stdout.readline() == b"started\n"
        children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children").read_text().split()
        assert len(children) == 1
        parent.kill()
        parent.wait()
    deadline = time.monotonic() + 30.0
    while _alive(int(children[0])):
        assert time.monotonic() < deadline, "the child still compiles"
        time.sleep(0.1)


def _alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False
