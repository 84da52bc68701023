"""COSMOS and SMC files written from the descriptions of the formats."""

from __future__ import annotations

import numpy as np


def fixed(values: list[float], per_line: int, form: str) -> list[str]:
    cells = [form.format(value) for value in values]
    return ["".join(cells[i : i + per_line]) for i in range(0, len(cells), per_line)]


def cosmos(
    channels: dict[str, np.ndarray], *, step_ms: float = 5.0, raw_step: float = -999.0, unit: str = "cm/sec2(04)"
) -> str:
    """Corrected acceleration and velocity of each station channel; 100 integers, 100 reals, comments, data."""
    lines: list[str] = []
    for channel, values in channels.items():
        lines += ["Corrected acceleration    (Format v01.20 with 13 text lines)", "Record of an Earthquake"]
        lines += ["Hypocenter: unknown", "Origin: unknown", "Statn No: 05- 47380 Code:XX-ABC   a street, a city"]
        lines += ["Coords:", "Recorder:", "Rcrd start time:"]
        lines += [
            f"Sta Chan {channel:>3}: 90 deg   (Rcrdr Chan  1) Location: Roof",
            "Raw",
            "Processed",
            "Filtered",
            "-999",
        ]
        lines += [" 100 Integer-header values follow on  10 lines, Format= (10I8)", *fixed([-999] * 100, 10, "{:8d}")]
        reals = [-999.0] * 100
        reals[33], reals[61] = raw_step, step_ms
        lines += [" 100 Real-header values follow on  20 lines, Format= (5F15.6)", *fixed(reals, 5, "{:15.6f}")]
        lines += ['   1 Comment line(s) follow, each starting with a "|":', "| 7 acceleration pts, but not here"]
        seconds = round(len(values) * (step_ms / 1e3 if step_ms > 0 else raw_step))
        for kind, name in (("acceleration", unit), ("velocity", "cm/sec(05)")):
            head = f"{len(values):8d} {kind} pts, approx {seconds:4d} secs, units={name},Format=(8F10.3)"
            lines += [head, *fixed(values.tolist(), 8, "{:10.3f}"), f"End-of-data for Chan {channel:>2} {kind}"]
    return "\n".join(lines) + "\n"


def smc(values: np.ndarray, rate: float = 200.0, first: str = "2 CORRECTED ACCELEROGRAM") -> str:
    """11 lines of text, 48 integers, 50 reals, comments; numbers of ten characters that touch."""
    text = [first, "*", "ABC0A", "     1989  10  18    0004 Somewhere", "*", "station = Hall", *["*"] * 5]
    integers = [-32768] * 48
    integers[15], integers[16] = 2, len(values)
    reals = [1.7e38] * 50
    reals[1] = rate
    body = [*fixed(integers, 8, "{:10d}"), *fixed(reals, 5, "{:15.7E}"), "|", "|a comment"]
    # 1.5057E+0 with a blank or a sign before it: FORTRAN writes one digit of the exponent.
    cells = [f"{value: .4E}".replace("E+0", "E+").replace("E-0", "E-") for value in values.tolist()]
    return "\r\n".join([*text, *body, *("".join(cells[i : i + 8]) for i in range(0, len(cells), 8)), ""])
