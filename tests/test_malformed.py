"""Some hundred malformed inputs, each through the command line: one sentence, exit code 2, nothing written.

What each sentence says is tested beside the room that says it; here stands that there is no other way to fail.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from matlab_files import save_v73
from scipy.io import savemat
from strong_motion_files import cosmos, smc

from bwbn_bayes.cli import main
from bwbn_bayes.records.excitation import sine
from bwbn_bayes.records.readers import write_record

MODELS = Path(__file__).parents[1] / "models"
SDOF = MODELS / "sdof.py"
Make = Callable[[Path], tuple[object, ...]]
"""Writes what is malformed into a directory and gives the command's arguments."""

# --- options ---------------------------------------------------------------------------------------------------------

NUMBERS = ("-1", "nan", "many", "", "1e5", "0x10")
OPTIONS: list[tuple[object, ...]] = [
    *(("identify", SDOF, "--seed", value) for value in NUMBERS),
    *(("identify", SDOF, "--particles", value) for value in (*NUMBERS, "0", "99", "1000000000000")),
    *(("identify", SDOF, "--workers", value) for value in ("0", "-1", "1025", "two", "1.5")),
    *(("discover", SDOF, "--time-limit", value) for value in ("0", "-1", "nan", "inf", "soon", "")),
    *(("discover", SDOF, "--particles", value) for value in ("0", "nan", "10000001")),
    *(("discover", SDOF, "--held-out", value) for value in ("nowhere.csv", "END", "", "/")),
    *(("identify", SDOF, "--method", value) for value in ("", "mcmc", "TMCMC", "smc,nuts")),
    *(("identify", SDOF, "--engine", value) for value in ("", "gpu", "Lanes", "cvodes2")),
    *(("identify", SDOF, "--out", value) for value in ("o" * 300, "/proc/nowhere", "/dev/full", "/dev/null/x")),
    *(("identify", SDOF, "--sampler", value) for value in ("", "stan")),
    *(("identify", SDOF, "--variant", value) for value in ("", "fast")),
    *(("identify", value) for value in ("", "/", "nowhere.py", "nowhere.csv", "/dev/null", "o" * 5000, "a\x07.py")),
    *(("discover", value) for value in ("", ".", "nowhere.AT2", "/proc/self/mem")),
    *(("simulate", value) for value in ("", "nowhere", "~/nowhere.py")),
    *(("reproduce", value) for value in ("", "zhao2020", "zhao2019.pdf")),
    *(("reproduce", "zhao2019", "--table", value) for value in ("0", "8", "all", "1,2")),
    *(("reproduce", "zhao2019", "--sine-amplitude", value) for value in ("0", "-1", "nan", "inf", "1e400")),
    *(("reproduce", "zhao2019", "--sine-frequency", value) for value in ("0", "-2", "nan", "26")),
    *(("reproduce", "zhao2019", "--el-centro-scale", value) for value in ("0", "nan", "-inf")),
    *(("reproduce", "zhao2019", "--error-floor", value) for value in ("-1", "nan")),
    *(("reproduce", "zhao2019", "--damage-order", value) for value in ("", "12", "1234")),
    ("reproduce", "zhao2019", "--seeds", "0"),
    ("reproduce", "zhao2019", "--generations", "0"),
    *(("batch", value) for value in ("", "nowhere", "*.nothing", "/dev/null", "[", "**/nothing/*.csv")),
    ("batch", ".", "--model", "nowhere.py"),
    ("batch", ".", "--workers", "0"),
    *(("model", "--example", value) for value in ("", "nothing", "../sdof", "/etc/passwd")),
    ("model",),
    ("model", "nowhere.csv"),
    ("model", "nowhere.csv", "--examples"),
    *(("effects", value) for value in ("", "friction", "SlipLock")),
    *(("export", "opensees", value) for value in ("", "nowhere", "/", "nowhere.nc")),
    ("export",),
    ("export", "abaqus", SDOF),
    *(("model", "--example", "sdof", "--out", "o" * n) for n in (300, 5000)),
    *((*command, "o" * 5000) for command in (("batch",), ("export", "opensees"), ("model",), ("discover",))),
    ("dance",),
    ("identify",),
    ("identify", SDOF, SDOF),
    ("identify", SDOF, "--columns", "t = time"),
]

OPTIONS += [
    *(("identify", SDOF, "--engine", "cuda", *more) for more in ((), ("--method", "ga"), ("--workers", "2"))),
    *((command, SDOF, "--sequence") for command in ("identify", "discover")),
    *(("identify", SDOF, "--unnamed-force", "--method", method) for method in ("ga", "ipv")),
    ("export", "opensees", SDOF, "--engine", "cuda"),
    *(("batch", pattern) for pattern in ("**a/*.csv", "\x00*.csv", "~nobody/*.csv", "//")),
    ("identify", SDOF, "--method", "ipv", "--checkpoint", "ck"),
]

# --- model files -----------------------------------------------------------------------------------------------------

HEAD = "from bwbn_bayes import *\n"
MOVED = "truth = {'k': 40.0}\nexcitation = sine(duration=4.0)\n"
"""So that nothing else is missing."""
STOREY = "BoucWen(k=Uniform(20, 60), c=0.2, alpha=0.1, A=1.0, beta=2.0, gamma=1.0, n=1.5)"


def _of(masses: str = "[1.0]", storey: str = STOREY, more: str = "") -> str:
    return f"{HEAD}model = ShearBuilding(masses={masses}, storey={storey}){more}\n"


FILES: list[bytes] = [
    *(text.encode() for text in ("", "\n", "model = None\n", "x = 1\n", "model = [\n", "def model(): pass\n", "1/0\n")),
    *(f"{kind}\n".encode() for kind in ("raise SystemExit", "raise KeyboardInterrupt", "raise BaseException('x')")),
    *(
        f"{kind}\n".encode()
        for kind in ("raise MemoryError", "import nothing_of_this_name", "def f(): f()\nf()", "é = [")
    ),
    *(
        b"\x00",
        b"\xff\xfe",
        b"model = '\x80'\n",
        b"\x1b[31m",
        b"PK\x03\x04",
        b"# coding: nothing\nmodel = 1\n",
        b"\t\n x",
    ),
    *(
        _of(masses).encode()
        for masses in ("[]", "[0.0]", "[-1.0]", "[float('nan')]", "['a']", "None", "[1e400]", "1.0")
    ),
    *(
        _of(masses).encode()
        for masses in ("[[1.0]]", "[Uniform(1, 2)]", "{}", "[1.0, 0.0]", "[10**400]", "b'ab'", "[1e-320]")
    ),
    *(
        text.encode()
        for text in (
            "class Mute(Exception):\n    def __str__(self):\n        1 / 0\nraise Mute\n",
            # What a class of the user's does when it is asked what it is: it ended with exit code 0, and nothing said.
            "class M:\n    def __getattribute__(self, name): raise SystemExit\nmodel = M()\n",
            "class M:\n    __class__ = property(lambda self: 1 / 0)\nmodel = M()\n",
            _of() + "class D(dict):\n    def values(self): raise SystemExit\ntruth = D()\n",
            "raise ValueError('x' * 10**6)\n",
            "raise ExceptionGroup('a', [ValueError('b\\n\\x1b[31mc')])\n",
            "import sys\nsys.setrecursionlimit(10**6)\ndef f(): return f()\nf()\n",
            "(" * 500 + ")" * 500,
        )
    ),
    *(
        _of(storey=STOREY.replace(old, new)).encode()
        for old, new in (
            *(("Uniform(20, 60)", f"Uniform({ends})") for ends in ("60, 20", "20, 20", "nan, 1", "'a', 'b'", "20")),
            *(
                ("Uniform(20, 60)", value)
                for value in (
                    *(
                        "-1.0",
                        "'k'",
                        "None",
                        "float('nan')",
                        "[20.0]",
                        "PerStorey([])",
                        "PerStorey",
                        "Uniform",
                        "1 + 2j",
                    ),
                    *(
                        "10**400",
                        "Uniform(10**400, 10**401)",
                        "Uniform(0, float('inf'))",
                        "Uniform(0, 1e-320)",
                        "Uniform(-1e308, 1e308)",
                    ),
                    *("Uniform(1e308, 1.7e308)", "Uniform", "True", "b'1'", "{1: 2}", "range(3)", "float('inf')"),
                )
            ),
            *(("Uniform(20, 60)", f"PerStorey({value})") for value in ("[1.0, 2.0]", "None", "['a']")),
            *(("c=0.2", f"c={value}") for value in ("-0.2", "'c'", "float('inf')", "True")),
            *(("alpha=0.1", f"alpha={value}") for value in ("2.0", "-1.0", "float('nan')")),
            *(("n=1.5", f"n={value}") for value in ("0.0", "-1.0", "float('nan')", "'n'")),
            ("gamma=1.0", "gamma=1.0, rho=1.0"),
            ("gamma=1.0", "gamma=1.0, sigma=1.0"),
            ("gamma=1.0", "gamma=1.0, gamma=1.0"),
            ("beta=2.0, ", ""),
        )
    ),
    *(
        _of(more=f".with_effect({effect})").encode()
        for effect in (
            *(
                "None",
                "SlipLock",
                "SlipLock()",
                "SlipLock(delta_s=-1.0, sigma=0.1)",
                "SlipLock(delta_s=0.1, sigma=0.0)",
            ),
            *("StrengthDegradation(delta_nu=-1.0)", "StrengthDegradation(delta_nu='a')", "StrengthDegradation(nu=1.0)"),
            *("StiffnessDegradation(delta_eta=float('nan'))", "CubicStiffness(k3='a')", "GapImpact()"),
            *("SlipLock(delta_s=0.1, sigma=0.1), storeys=[2]", "SlipLock(delta_s=0.1, sigma=0.1), storeys=[]"),
            *("SlipLock(delta_s=0.1, sigma=0.1), storeys=[0]", "SlipLock(delta_s=0.1, sigma=0.1), storeys='all'"),
        )
    ),
    *((_of() + f"truth = {value}\n").encode() for value in ("1.0", "[]", "{'k': 'a'}", "{'q': 1.0}", "{'k': 1e5}")),
    *((_of() + f"truth = {value}\n").encode() for value in ("{1: 40.0}", "{'k': float('nan')}", "{'k': 1 + 2j}")),
    *((_of() + f"snr_db = {value}\n").encode() for value in ("'a'", "float('nan')", "-1e6", "10**400", "[30]")),
    *((_of() + f"excitation = {value}\n").encode() for value in ("1.0", "'el_centro'", "[0.0]", "sine()")),
    *((_of() + f"excitation = {value}\n").encode() for value in ("el_centro('x')", "el_centro(duration=-1.0)")),
    *((_of() + f"assumptions = {value}\n").encode() for value in ("'a'", "1", "[1]", "{'a': 1}")),
    *((_of() + f"record = {value}\n").encode() for value in ("1", "'r.csv'", "read_record('nowhere.csv')")),
    (_of() + "held_out = 1\n").encode(),
    *(
        _of(more=f".with_effect({effect})\n{MOVED}").encode()
        for effect in (
            *(f"ViscousDamper(F_v=1.0, p_v=0.5, v_v={v})" for v in ("0.0", "-0.1", "1e-320", "PerStorey([1.0, 2.0])")),
            *(f"ViscousDamper(F_v=1.0, p_v={p}, v_v=0.1)" for p in ("0.0", "'a'", "float('nan')", "1e6")),
            *("ViscousDamper(F_v=1.0, p_v=0.5)", "ViscousDamper(F_v=1e300, p_v=0.5, v_v=0.1)"),
            *("StrengthDegradation(theta_nu=-1.0)", "StrengthDegradation(theta_nu=1.0, delta_nu=1.0)"),
            *("StiffnessDegradation(theta_eta=None)", "StiffnessDegradation(theta_nu=1.0)"),
            *("StrengthDegradation(theta_nu=1e308)", "StrengthDegradation(theta_nu=LogNormal(0.0, 1.0))"),
        )
    ),
    *(
        f"{_of()}{MOVED}one = sine(duration=0.99, time_step=0.01)\nperiods_until_repeated({asked})\n".encode()
        for asked in (
            *(
                f"model, one, {{'k': 40.0}}, within={within}"
                for within in ("0.0", "float('nan')", "float('inf')", "'a'")
            ),
            *(f"model, one, {values}" for values in ("{}", "{'q': 1.0}", "{'k': 1e300}", "None")),
            *("model, None, {'k': 40.0}", "model, join_records([one, one]), {'k': 40.0}"),
        )
    ),
    *(
        f"{_of()}{MOVED}excitation = periodic(sine(), periods={n})\n".encode()
        for n in ("0", "-1", "1.5", "'a'", "float('nan')")
    ),
    *(
        (_of() + f"{MOVED}excitation = join_records({records})\n").encode()
        for records in ("[]", "'ab'", "[sine(), None]")
    ),
    *((_of() + f"{MOVED}columns = {value}\n").encode() for value in ("5", "['a']")),
    (HEAD + "model = Specimen(storey=1.0)\n").encode(),
    (HEAD + "model = Oscillator(mass=-1.0, spring=Linear(k=1.0))\n").encode(),
    (HEAD + "model = Oscillator(mass=1.0, spring=Linear(k='a'))\n").encode(),
    _of(more=".with_link(Linear(k=1.0), joins=(0, 5))").encode(),
    _of(more=".with_link(Linear(k=1.0), joins=(1, 1))").encode(),
    _of(more=".with_link(None, joins=(0, 1))").encode(),
]

# --- records ---------------------------------------------------------------------------------------------------------

_ROWS = [f"{0.02 * i:.2f},{np.sin(i):.4f},{np.cos(i):.4f}" for i in range(40)]
_TOP = "time [s],ground_acceleration [m/s^2],acceleration_1 [m/s^2]"


def _table(top: str = _TOP, rows: list[str] | None = None, end: str = "\n") -> bytes:
    return (end.join([top, *(_ROWS if rows is None else rows)]) + end).encode()


def _with(row: int, text: str) -> list[str]:
    return [*_ROWS[:row], text, *_ROWS[row + 1 :]]


TABLES: list[bytes] = [
    *(b"", b"\n", b"\x00" * 100, b"\xff" * 100, b"a", b"# name: x\n", b"\xef\xbb\xbf", b"PK\x03\x04", b"%PDF-1.4\n"),
    *(_table(rows=_ROWS[:n]) for n in (0, 1, 2, 7)),
    *(_table(rows=_with(5, text)) for text in ("", "0.1", "0.1,1", "0.1,1,2,3", "a,b,c", "0.1,,1", "0.1,1,nan")),
    *(_table(rows=_with(5, text)) for text in ("0.1,inf,1", "0.1,1,1e400", "nan,1,1", "0.1,1,--1", "0.1,1,1;2")),
    *(_table(rows=_with(5, text)) for text in ("0.00,1,1", "99,1,1", "-0.1,1,1", "0.1,1,٣x")),
    *(_table(_TOP.replace("[s]", unit)) for unit in ("[m]", "[]", "[parsec]", "[s", "[s^2]", "[__import__('os')]")),
    *(_table(_TOP.replace("[m/s^2]", unit, 1)) for unit in ("[s]", "[N]", "[m/s^]", "[1/0]", "[m**m]", "[%]")),
    *(_table(_TOP.replace("acceleration_1", name)) for name in ("acceleration_0", "acceleration_-1", "acceleration_x")),
    *(_table(_TOP.replace("acceleration_1", name)) for name in ("acceleration_2", "velocity_1", "", "time", "drift_9")),
    *(_table(_TOP.replace("acceleration_1", name)) for name in ("ground_acceleration", "acceleration_" + "9" * 500)),
    *(_table(top) for top in ("", "time [s]", "a,b,c", _TOP + ",x", "0,0,0", _TOP.replace(",", ";"))),
    _table(rows=[f"{1e-302 * i!r},{i},{i}" for i in range(40)]),
    _table(rows=[f"{1e300 * i!r},{i},{i}" for i in range(40)]),
    _table(rows=[f"0.0,{i},{i}" for i in range(40)]),
    _table(rows=[row.rsplit(",", 1)[0] + ",1.0" for row in _ROWS]),
    _table(rows=[f"{0.02 * i:.2f},0.0,{i}" for i in range(40)]),
    _table(end="\r\r"),
    _table().replace(b"\n", b"\x00"),
    _table()[:-9] + b"\xff\xff\n",
    _table(rows=[f"{0.02 * i:.2f},{1e200 * np.sin(i)},{1e200 * np.cos(i)}" for i in range(40)]),
    _table(rows=[f"{-0.02 * i:.2f},{i},{i}" for i in range(40)]),
    *(_table().decode().encode(kind) for kind in ("utf-16", "utf-32", "utf-16-le")),
    *(_table(_TOP.replace("[m/s^2]", f"[{unit}]", 1)) for unit in ("m*" * 5000 + "m", "nan m/s^2", "0 m/s^2", "degC")),
    # The ground moves by 1e60 m/s^2, and by 1e-200: it was told when the search had begun, or never.
    _table(_TOP.replace("[m/s^2]", "[Ym/as^2]", 1)),
    _table(rows=[f"{0.02 * i:.2f},{np.sin(i):.4f}e-200,{np.cos(i)}" for i in range(40)]),
    _table(_TOP + ",acceleration_1 [m/s^2]", [row + ",1" for row in _ROWS]),
    _table(rows=_with(20, "0.10,1,1")),
    _table(rows=[*_ROWS, *_ROWS]),
    _table(rows=_with(5, "0.10 s,1,1")),
    _table(rows=_with(5, "\ufeff0.10,1,1")),
    _table(rows=_with(5, "0.10,1\x00,1")),
    _table(rows=_with(5, "0.10,1e99999999999,1")),
    _table(rows=_with(5, "0.10,#DIV/0!,1")),
    _table(rows=["m,s,kg", *_ROWS]),
    b"# time_step: nan\n" + _table(),
    b"# noise_sd acceleration_1: -1\n" + _table(),
    b"# name: a\n# name: b\n" + _table(),
    *(b"1," * 10**5, b"\n" * 10**5, b"#" * 10**5, b"# a: b\n" * 10**4),
    ("time [s]," * 3000 + "\n" + "0," * 3000 + "\n").encode(),
]

MAPS = [
    *("", " ", ",", "=", "a", "t = ", "= time", "t = time [", "t = time [s]]", "t == time", "t = time, t = time"),
    *("t = nothing", "x = acceleration_1", "time = time, ground_acceleration = acceleration_1", "t = time [parsec]"),
    *("acceleration_1 = acceleration_1 minus nothing", "acceleration_1 = acceleration_1 [N]", "t = time;", "\x00"),
    *(
        "time = time" * 5000,
        "acceleration_1 = drift_1 [m] minus base",
        "🙂 = time",
        *("column 0 = time", "column 99999999 = time", "256 = sampling_rate", "1e400 = sampling_rate [Hz]"),
        *("acceleration_1 = acceleration_1 [g] minus", "acceleration_1 = acceleration_\u0661", "time = time [s] [s]"),
        "acceleration_1 = acceleration_" + "9" * 400,
    ),
]

CHECKPOINTS = ["/", "/proc/x/ck", "/dev/full/ck", "c" * 300, "..", "."]
MOTION = np.round(np.sin(np.arange(24.0)), 3)


def _damaged(data: bytes) -> Iterator[bytes]:
    """Empty, cut short, its bytes in the middle overwritten, and nothing but noise."""
    yield from (
        b"",
        data[:20],
        data[: len(data) // 3],
        data[len(data) // 2 :],
        b"\x00" * len(data),
        b"\x89HDF\r\n\x1a\n",
    )
    yield np.random.default_rng(1).bytes(200)


def _whole(place: Path, suffix: str) -> Path:
    path = place / f"whole{suffix}"
    if suffix == ".AT2":
        path.write_text("a\nb\nACCELERATION TIME SERIES IN UNITS OF G\nNPTS= 12, DT= .01 SEC\n" + ".1 .2 .3\n" * 4)
    elif suffix == ".v2":
        path.write_text(cosmos({"1": MOTION}))
    elif suffix == ".smc":
        path.write_text(smc(MOTION))
    elif suffix == ".mat":
        savemat(path, {"t": 0.1 * np.arange(24), "data": np.ones((24, 2))})
    elif suffix == "v73.mat":
        save_v73(path, {"t": 0.1 * np.arange(24), "data": np.ones((24, 2))})
    elif suffix == ".mseed":
        path.write_bytes(b"000001D " + struct.pack(">12B", *range(12)) * 10)
    else:
        motion = sine(amplitude=1.0, frequency_hz=1.0, duration=0.5, time_step=0.05)
        write_record(motion.with_channels({"acceleration_1": np.array(motion.excitation)}), path)
    return path


AT2_HEADS = [
    *("NPTS= 12, DT= 0 SEC", "NPTS= 12, DT= -.01 SEC", "NPTS= 0, DT= .01 SEC", "NPTS= 13, DT= .01 SEC", "NPTS=, DT="),
    *(
        f"NPTS= {'9' * 5000}, DT= .01 SEC",
        "NPTS= 12, DT= 1e-320 SEC",
        "NPTS= 12, DT= nan SEC",
        "NPTS= 1e3, DT= .01 SEC",
    ),
]


def _record(suffix: str, data: bytes, *options: str) -> Make:
    def make(place: Path) -> tuple[object, ...]:
        (place / f"record{suffix}").write_bytes(data)
        return ("identify", SDOF, "--record", f"record{suffix}", *options)

    return make


def _damaged_record(suffix: str, number: int) -> Make:
    def make(place: Path) -> tuple[object, ...]:
        path = _whole(place, suffix)
        path.write_bytes(list(_damaged(path.read_bytes()))[number])
        return ("identify", SDOF, "--record", path.name)

    return make


def _model(data: bytes) -> Make:
    def make(place: Path) -> tuple[object, ...]:
        (place / "mine.py").write_bytes(data)
        # What no model says by itself is asked of its simulation.
        return ("simulate", "mine.py")

    return make


def _at2(head: str) -> Make:
    text = f"a\nb\nACCELERATION TIME SERIES IN UNITS OF G\n{head}\n" + ".1 .2 .3\n" * 4
    return _record(".AT2", text.encode())


def _several(command: str, *names: str) -> Make:
    def make(place: Path) -> tuple[object, ...]:
        for name in set(names):
            (place / name).write_bytes(_table())
        return (command, SDOF, *(word for name in names for word in ("--record", name)))

    return make


def _short(place: Path) -> tuple[object, ...]:
    """Of 36 points 30 were left to fit."""
    (place / "record.csv").write_bytes(_table(rows=_ROWS[:36]))
    return ("discover", SDOF, "--record", "record.csv", "--held-out", "end")


def _starting(floor: str) -> Make:
    def make(place: Path) -> tuple[object, ...]:
        (place / "record.csv").write_bytes(_table(_TOP.replace("acceleration_1", f"acceleration_{floor}")))
        return ("model", "record.csv")

    return make


def _over_a_search(*options: str) -> Make:
    """What an earlier search left stays as it is."""

    def make(place: Path) -> tuple[object, ...]:
        (place / ".unfinished.solves").write_bytes(b"mine")
        (place / "record.csv").write_bytes(_table())
        return ("discover", SDOF, "--record", "record.csv", "--out", ".", *options)

    return make


def _no_file(suffix: str) -> Make:
    def make(place: Path) -> tuple[object, ...]:
        os.mkfifo(place / f"record{suffix}")
        return ("identify", SDOF, "--record", f"record{suffix}")

    return make


def _result(number: int) -> Make:
    def make(place: Path) -> tuple[object, ...]:
        whole = (b"CDF\x01" + b"\x00" * 60) * 9
        (place / "result.nc").write_bytes(list(_damaged(whole))[number])
        return ("export", "opensees", "result.nc")

    return make


KINDS = (".nc", ".mat", "v73.mat", ".v2", ".smc", ".mseed", ".AT2")
CASES: list[tuple[str, Make]] = [
    *((f"option {i}", lambda _, arguments=arguments: arguments) for i, arguments in enumerate(OPTIONS)),
    *((f"model {i}", _model(data)) for i, data in enumerate(FILES)),
    *((f"table {i}", _record(".csv", data)) for i, data in enumerate(TABLES)),
    *((f"map {i}", _record(".csv", _table(), "--columns", text)) for i, text in enumerate(MAPS)),
    *((f"checkpoint {i}", _record(".csv", _table(), "--checkpoint", place)) for i, place in enumerate(CHECKPOINTS)),
    *((f"twice, {command}", _several(command, "a.csv", "b.csv")) for command in ("identify", "discover")),
    ("end of a short record", _short),
    *((f"floor of {len(floor)}", _starting(floor)) for floor in ("0", "1000", "9" * 20, "9" * 5000)),
    *((f"search {word}", _over_a_search(*word.split())) for word in ("--held-out x.csv", "--record x.csv", "--resume")),
    *((f"head {i}", _at2(head)) for i, head in enumerate(AT2_HEADS)),
    *((f"{suffix} {i}", _damaged_record(suffix, i)) for suffix in KINDS for i in range(7)),
    *((f"result {i}", _result(i)) for i in range(7)),
    *((f"named pipe{suffix}", _no_file(suffix)) for suffix in (".csv", ".nc", ".mat", ".v2", ".smc", ".AT2")),
]


def test_there_are_as_many_as_were_asked_for() -> None:
    assert len(CASES) >= 250


@pytest.mark.slow
@pytest.mark.parametrize("make", [make for _, make in CASES], ids=[name for name, _ in CASES])
def test_it_ends_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], make: Make
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = [str(argument) for argument in make(tmp_path)]
    before = _held(tmp_path)
    with pytest.raises(SystemExit) as leaving:
        main(arguments)
    said = capsys.readouterr()
    assert leaving.value.code == 2, said.err
    (line,) = said.err.splitlines()
    assert line.startswith("error: ")
    assert line.isprintable()
    assert said.out == ""
    assert _held(tmp_path) == before


def _held(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() if path.is_file() else b"" for path in place.iterdir()}
