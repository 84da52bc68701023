"""The measured tests of ../shared/data and where each is parted; nothing is copied into the repository."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from bwbn_bayes import Record, UserError, read_record, starting_model
from bwbn_bayes.discovery.held_out import HeldOut, parting_time, repeat_cycles
from bwbn_bayes.parameters import Floats

DATA = Path(__file__).parents[3] / "shared" / "data"

CYCLIC = {
    "chiu_bracing": "chiu_bracing.csv",
    "clt_connection": "clt_connection_spc1.csv",
    "steel_damper": "steel_damper_ganey.csv",
    "friction_damper_sine": "friction_damper_sine_0p5hz.csv",
    "friction_damper_earthquake": "friction_damper_imperial_valley.csv",
}
FRAMES = {"frame_small": "shake_table_frame/fbgm152s1.csv", "frame_large": "shake_table_frame/fbgm152s3.csv"}
COLUMNS = "rc_columns"

LAST_SHARE = 0.3
"""Of the path, what is held out where the package's rule finds no end to hold out."""

_GRAVITY, _INCH = 9.80665, 0.0254
_FRAME_HEADER = "table_acceleration [g],base_displacement [inch],floor_1 [inch],floor_2 [inch],floor_3 [inch]"


@dataclass(frozen=True, kw_only=True)
class Label:
    """What the index of the columns says of one, for its whole record.

    Attributes
    ----------
    loops : str
        ``pinched`` or ``fat``.
    zero_force_ratio : float
        Force at zero drift over the half cycle's peak, as the index has it.
    failure : str
        Reported failure mode.
    """

    loops: str
    zero_force_ratio: float
    failure: str


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredTest:
    """One measured test and its split, which is the same for whatever is fitted to it.

    Attributes
    ----------
    name : str
    record : Record
        All of it.
    n_fitted : int
        Points of the first part, which is fitted; the others are held out.
    rule : str
        What parted it: ``parting_time`` or ``path``.
    label : Label or None
        Of a reinforced-concrete column.
    """

    name: str
    record: Record
    n_fitted: int
    rule: str
    label: Label | None = None

    @property
    def is_frame(self) -> bool:
        """Whether a ground motion drives it."""
        return self.record.excitation_kind == "ground_acceleration"

    @cached_property
    def repeats(self) -> HeldOut | None:
        """Its repeat cycles; None where there are too few to hold out."""
        try:
            return repeat_cycles(self.record)
        except UserError:
            return None

    @property
    def training(self) -> Record:
        """The part that is fitted."""
        return self.record.until((self.n_fitted - 1) * self.record.time_step)

    @property
    def pulled(self) -> tuple[Floats, Floats]:
        """Displacement [m] and force [N] ``(n_times,)`` of a cyclic test."""
        return self.record.excitation, self.record.channels["force"]


def names(folder: Path = DATA) -> tuple[str, ...]:
    """Names of all measured tests, in the order of the table.

    Raises
    ------
    UserError
        If the index of the columns is missing.
    """
    return (*CYCLIC, *FRAMES, *_index(folder))


def load(name: str, folder: Path = DATA) -> MeasuredTest:
    """Read a measured test and part it.

    Parameters
    ----------
    name : str
        One of :func:`names`.
    folder : Path
        The data.

    Raises
    ------
    UserError
        If there is no such test, or its file is missing or wrong.
    """
    labels = _index(folder)
    if name in FRAMES:
        record, label = read_frame(_present(folder / FRAMES[name])), None
    elif name in CYCLIC:
        record, label = read_record(_present(folder / CYCLIC[name])), None
    elif name in labels:
        record, label = read_record(_present(folder / COLUMNS / f"{name}.csv")), labels[name]
    else:
        raise UserError(f"there is no measured test {name!r}: the names are {', '.join(names(folder))}")
    n_fitted, rule = parted(record)
    return MeasuredTest(name=name, record=record, n_fitted=n_fitted, rule=rule, label=label)


def parted(record: Record) -> tuple[int, str]:
    """Points of the first part, and the rule that gave them.

    The package's rule where it finds a part to hold out that moves as strongly as the whole; else the last 30 % of the
    path of the imposed displacement, or of the highest floor's.

    Returns
    -------
    n_fitted : int
    rule : str
        ``parting_time`` or ``path``.
    """
    try:
        time = parting_time(starting_model(record), record)
    except UserError:
        moved = record.excitation if record.excitation_kind == "displacement" else list(record.channels.values())[-1]
        path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(moved)))])
        return int(np.searchsorted(path, (1.0 - LAST_SHARE) * path[-1])) + 1, "path"
    return int(np.floor(time / record.time_step + 1e-6)) + 1, "parting_time"


def read_frame(path: Path) -> Record:
    """Read a shake-table run: table acceleration, and floor displacements relative to the base.

    Raises
    ------
    UserError
        If the file is not such a run.
    """
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = dict(_comment(line) for line in lines if line.startswith("#"))
    rows = [line for line in lines if not line.startswith("#")]
    if rows[:1] != [_FRAME_HEADER] or "time_step" not in comments:
        raise UserError(f"{path}: this is no shake-table run, it needs '# time_step: ...' and {_FRAME_HEADER}")
    try:
        table = np.array([[float(cell) for cell in row.split(",")] for row in rows[1:]])
        time_step = float(comments["time_step"])
    except ValueError as error:
        raise UserError(f"{path}: a cell is not a number ({error})") from None
    relative = _INCH * (table[:, 2:] - table[:, 1:2])
    return Record(
        name=path.stem,
        time_step=time_step,
        excitation=_GRAVITY * table[:, 0],
        channels={f"displacement_{floor}": relative[:, floor - 1] for floor in (1, 2, 3)},
        provenance={"displacements": "relative to the base, from absolute ones"},
    )


def nrmse(measured: Sequence[Floats] | Floats, predicted: Sequence[Floats] | Floats) -> float:
    """Error in per cent: root mean square over channels of rms error over rms signal, ``(n_channels, n_times)`` each.

    Infinite where the prediction is not finite.
    """
    truth, guess = np.atleast_2d(measured), np.atleast_2d(predicted)
    if not np.all(np.isfinite(guess)):
        return float("inf")
    with np.errstate(over="ignore"):
        shares = np.mean(np.square(truth - guess), axis=1) / np.mean(np.square(truth), axis=1)
    return float(100.0 * np.sqrt(np.mean(shares)))


def both_errors(test: MeasuredTest, predicted: Floats) -> tuple[float, float]:
    """Errors [%] of a prediction ``(n_channels, n_times)`` of the whole record, on the fitted part and after it."""
    measured, n = test.record.measured, test.n_fitted
    return nrmse(measured[:, :n], predicted[:, :n]), nrmse(measured[:, n:], predicted[:, n:])


def _index(folder: Path) -> Mapping[str, Label]:
    with _present(folder / COLUMNS / "index.csv").open(encoding="utf-8", newline="") as file:
        return {
            row["file"].removesuffix(".csv"): Label(
                loops=row["loops"], zero_force_ratio=float(row["zero_force_ratio"]), failure=row["failure"]
            )
            for row in csv.DictReader(file)
        }


def _present(path: Path) -> Path:
    if not path.is_file():
        raise UserError(f"{path}: no such file, the measured tests are read from {DATA} and are not in the repository")
    return path


def _comment(line: str) -> tuple[str, str]:
    key, _, value = line.lstrip("# ").partition(":")
    return key.strip(), value.strip()
