"""Records from and to files: CSV, netCDF, and PEER ``.AT2`` ground motions. A data file never executes anything.

CSV: optional ``# key: value`` lines, a header that names each quantity and its unit, then numbers::

    # name: shake table run 4
    # true k[1]: 20.0
    # noise_sd acceleration_1: 0.003
    time [s],ground_acceleration [m/s^2],acceleration_1 [g]
    0.00,0.000,0.0001

The keys ``name``, ``time_step`` [s], ``true <label>`` and ``noise_sd <channel>`` [both SI] have a meaning; any other
goes to the provenance. A cyclic test has ``displacement [mm],force [kN]``, with or without ``time``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.columns import (
    Column,
    Labels,
    Source,
    excitation_kind_of,
    printed_quantum,
    record_from_columns,
)
from bwbn_bayes.records.hdf5 import require_hdf5
from bwbn_bayes.records.record import MIN_TIMES, RESERVED_KEYS, Record, si_unit
from bwbn_bayes.records.units import si_factor

_HEADER_CELL = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)\s*(?:\[([^\[\]]*)\])?", re.ASCII)
_AT2_COUNT = re.compile(r"NPTS\s*=\s*(\d{1,12})\s*,\s*DT\s*=\s*([0-9.Ee+-]+)", re.IGNORECASE)
_AT2_COUNT_OLD = re.compile(r"\s*(\d{1,12})\s+([0-9.Ee+-]+)\s+NPTS\s*,\s*DT", re.IGNORECASE)
_AT2_UNIT = re.compile(r"ACCELERATION.*UNITS\s+OF\s+(.+)", re.IGNORECASE)


def read_record(path: Path | str) -> Record:
    """Read a record from a ``.csv``, ``.nc`` or ``.AT2`` file.

    Parameters
    ----------
    path : Path or str
        The file; its suffix decides the format (upper or lower case).

    Raises
    ------
    UserError
        If the file is missing or wrong: one sentence that names the file, the line and the column.
    """
    readers: dict[str, Callable[[Path], Record]] = {".csv": read_csv, ".nc": read_netcdf, ".at2": read_at2}
    suffix = Path(path).suffix.lower()
    if suffix not in readers:
        raise UserError(f"{path}: the suffix {suffix!r} is not known, use .csv, .nc or .AT2")
    return readers[suffix](Path(path))


def write_record(record: Record, path: Path | str) -> None:
    """Write a record to a ``.csv`` or ``.nc`` file; reading it gives an equal record.

    Raises
    ------
    UserError
        If the suffix is another one or the file cannot be written.
    """
    writers: dict[str, Callable[[Record, Path], None]] = {".csv": write_csv, ".nc": write_netcdf}
    suffix = Path(path).suffix.lower()
    if suffix not in writers:
        raise UserError(f"{path}: the suffix {suffix!r} cannot be written, use .csv or .nc")
    writers[suffix](record, Path(path))


def read_csv(path: Path | str) -> Record:
    """Read a record from CSV text (format in the module's docstring).

    Times may be rounded as printed; a sample that is missing is an error. Without a time column a cyclic test is a
    path whose points are taken 1 s apart: ``has_time`` is false, and the provenance says so.

    Raises
    ------
    UserError
        One sentence naming file, line and column.
    """
    lines = _text(Path(path)).split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    start = next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), None)
    if start is None:
        raise UserError(f"{path}: the file is empty, it needs a header and at least {MIN_TIMES} rows of numbers")
    labels = _comment_labels(lines[:start], Path(path))
    header = f"{path}, line {start + 1}"
    names, factors = _header_columns(lines[start], header)
    excitation_kind_of(names, header)
    source = Source(file=str(path), header=header, place=lambda row: f"line {start + 2 + row}")
    if len(lines) - start - 1 < MIN_TIMES:
        raise UserError(f"{path}: the record has {len(lines) - start - 1} points, at least {MIN_TIMES} are needed")
    table = _table(lines[start + 1 :], names, source)
    quantum = 0.0
    if "time" in names:
        position = names.index("time")
        quantum = printed_quantum([line.split(",")[position] for line in lines[start + 1 :]])
    columns = [Column(*item) for item in zip(names, factors, table.T, strict=True)]
    return record_from_columns(columns, labels, source, quantum)


def write_csv(record: Record, path: Path | str) -> None:
    """Write a record as CSV in SI units, every number with all its digits; without ``time`` where it has none.

    Raises
    ------
    UserError
        If the file cannot be written.
    """
    stated = {"name": record.name, "time_step": repr(record.time_step), **record.provenance}
    stated |= {f"true {label}": repr(value) for label, value in record.truth.items()}
    stated |= {f"noise_sd {channel}": repr(value) for channel, value in record.noise_sd.items()}
    times = {"time": record.times} if record.has_time else {}
    columns = {**times, record.excitation_kind: record.excitation, **record.channels}
    lines = [f"# {key}: {value}" for key, value in stated.items()]
    lines.append(",".join(f"{name} [{si_unit(name)}]" for name in columns))
    table = np.stack(list(columns.values()), axis=1)
    lines += [",".join(map(repr, row)) for row in table.tolist()]
    try:
        Path(path).write_bytes(("\n".join(lines) + "\n").encode())
    except OSError as error:
        raise UserError(f"{path}: the file cannot be written ({error.strerror})") from None


def as_dataset(record: Record) -> xr.Dataset:
    """The record as an xarray dataset over ``time`` with units; what :func:`write_netcdf` stores."""
    arrays = {record.excitation_kind: record.excitation, **record.channels}
    facts = {
        "name": record.name,
        "time_step": record.time_step,
        "channels": list(record.channels),
        "provenance": dict(record.provenance),
        "truth": dict(record.truth),
        "noise_sd": dict(record.noise_sd),
        "has_time": record.has_time,
    }
    return xr.Dataset(
        {name: ("time", values, {"units": si_unit(name)}) for name, values in arrays.items()},
        coords={"time": ("time", record.times, {"units": "s"})},
        attrs={"record": json.dumps(facts)},
    )


def write_netcdf(record: Record, path: Path | str) -> None:
    """Write a record as netCDF, exactly.

    Raises
    ------
    UserError
        If the file cannot be written.
    """
    try:
        # By way of memory: HDF5 on a full disk ends in pages of its own.
        contents = bytes(as_dataset(record).to_netcdf(engine="h5netcdf"))
        Path(path).write_bytes(contents)
    except OSError as error:
        raise UserError(f"{path}: the file cannot be written ({error.strerror or error})") from None


def read_netcdf(path: Path | str) -> Record:
    """Read a record from netCDF: variables named and in units as in CSV, over one dimension.

    Raises
    ------
    UserError
        One sentence naming file and variable.
    """
    _bytes(Path(path))
    try:
        require_hdf5(path)
        # decode_cf would turn a time in "seconds" into a timedelta.
        dataset = xr.load_dataset(path, engine="h5netcdf", decode_cf=False)
    except (OSError, ValueError, KeyError, RuntimeError):
        raise UserError(f"{path}: the file is not netCDF-4, or it is damaged") from None
    labels, order = _dataset_labels(dataset, Path(path))
    names = [str(name) for name in dataset.variables]
    names.sort(key=lambda name: order.index(name) if name in order else -1)
    kind = excitation_kind_of(names, str(path))
    columns = [_variable_column(dataset.variables[name], name, Path(path)) for name in names]
    for column in columns:
        if len(column.values) != dataset.variables[kind].size:
            raise UserError(
                f"{path}, column {column.name}: {len(column.values)} points where {kind} has "
                f"{dataset.variables[kind].size}, they must be equal"
            )
    single = "time" in names and dataset.variables["time"].dtype == np.float32
    quantum = (
        float(np.spacing(np.float32(np.max(np.abs(dataset.variables["time"].values), initial=0.0)))) if single else 0.0
    )
    source = Source(file=str(path), header=str(path), place=lambda row: f"point {row + 1}")
    return record_from_columns(columns, labels, source, quantum)


def read_at2(path: Path | str) -> Record:
    """Read a ground motion in PEER's ``.AT2`` format, old or new header.

    Parameters
    ----------
    path : Path or str
        Four header lines (the third names the unit, the fourth ``NPTS`` and ``DT``), then numbers.

    Returns
    -------
    Record
        Without channels; ``excitation`` in m/s^2, one g being 9.80665 m/s^2.

    Raises
    ------
    UserError
        If the header is not understood, a number is wrong, or there are more or fewer than ``NPTS`` numbers.
    """
    lines = _bytes(Path(path)).decode("utf-8", errors="replace").split("\n")
    unit = _AT2_UNIT.search(lines[2]) if len(lines) > 3 else None
    if unit is None:
        raise UserError(
            f"{path}, line 3: no 'ACCELERATION ... IN UNITS OF', the file is not a PEER acceleration record"
        )
    count = _AT2_COUNT.search(lines[3]) or _AT2_COUNT_OLD.match(lines[3])
    if count is None:
        raise UserError(f"{path}, line 4: no 'NPTS= ..., DT= ...', the file is not a PEER acceleration record")
    try:
        factor = si_factor("ground_acceleration", unit.group(1).strip())
    except UserError as error:
        raise UserError(f"{path}, line 3: {error}") from None
    time_step = _number(count.group(2), f"{path}, line 4, DT")
    numbers = [
        _number(cell, f"{path}, line {i}, column {position}")
        for i, line in enumerate(lines[4:], start=5)
        for position, cell in enumerate(line.split(), start=1)
    ]
    if len(numbers) != int(count.group(1)):
        fault = "truncated" if len(numbers) < int(count.group(1)) else "too long"
        raise UserError(
            f"{path}, line 4: NPTS is {count.group(1)} but {len(numbers)} numbers follow, the file is {fault}"
        )
    try:
        return Record(
            name=Path(path).stem,
            time_step=time_step,
            excitation=factor * np.array(numbers, dtype=np.float64),
            provenance={"database": lines[0], "event": lines[1]},
        )
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def _bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except OSError as error:
        raise UserError(f"{path}: the file cannot be read ({error.strerror})") from None
    if not data.strip():
        raise UserError(f"{path}: the file is empty")
    return data


def _text(path: Path) -> str:
    data = _bytes(path)
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise UserError(f"{path}, line {line}: the text is not UTF-8, save the file as UTF-8") from None


def _number(cell: str, place: str) -> float:
    """A finite number from text; UserError where it is none."""
    text = cell.strip()
    if not text:
        raise UserError(f"{place}: the cell is blank, every cell needs a number")
    try:
        value = float(text)
    except ValueError:
        value = None
    if value is None or "_" in text:
        raise UserError(f"{place}: {text[:40]!r} is not a number")
    if not np.isfinite(value):
        raise UserError(f"{place}: the value is {text[:40]}, every value must be a finite number")
    return value


def _comment_labels(lines: Sequence[str], path: Path) -> Labels:
    """What the ``# key: value`` lines say; a line without a colon is kept as a remark."""
    stated: dict[str, tuple[int, str]] = {}
    remarks: list[str] = []
    for number, line in enumerate(lines, start=1):
        text = line.strip().lstrip("#").strip()
        key, colon, value = (part.strip() for part in text.partition(":"))
        if not colon or not key:
            remarks += [text] if text else []
        elif key in stated:
            raise UserError(
                f"{path}, line {number}: the key {key!r} was given in line {stated[key][0]} already, keep one"
            )
        else:
            stated[key] = (number, value)

    def numbers(prefix: str) -> dict[str, float]:
        chosen = {key: entry for key, entry in stated.items() if key.startswith(prefix)}
        return {
            key.removeprefix(prefix): _number(value, f"{path}, line {number}, key {key!r}")
            for key, (number, value) in chosen.items()
        }

    step = stated.get("time_step")
    provenance = {
        key: value
        for key, (_, value) in stated.items()
        if key not in RESERVED_KEYS and not key.startswith(("true ", "noise_sd "))
    }
    if remarks:
        provenance["remarks"] = "; ".join([*([provenance["remarks"]] if "remarks" in provenance else []), *remarks])
    return Labels(
        name=stated["name"][1] if "name" in stated else path.stem,
        time_step=None if step is None else _number(step[1], f"{path}, line {step[0]}, key 'time_step'"),
        provenance=provenance,
        truth=numbers("true "),
        noise_sd=numbers("noise_sd "),
    )


def _header_columns(line: str, header: str) -> tuple[list[str], list[float]]:
    """Names and SI factors of the columns that a header line announces."""
    matches = []
    for position, cell in enumerate(line.split(","), start=1):
        match = _HEADER_CELL.fullmatch(cell.strip())
        if match is None:
            raise UserError(
                f"{header}, column {position}: {cell.strip()[:40]!r} is not a column name, write a name and its unit, "
                "such as acceleration_1 [m/s^2], separated by commas"
            )
        matches.append(match)
    names = [match.group(1).lower() for match in matches]
    excitation_kind_of(names, header)
    factors = []
    for name, match in zip(names, matches, strict=True):
        if match.group(2) is None:
            raise UserError(f"{header}, column {name}: the unit is missing, write {name} [{si_unit(name)}]")
        factors.append(_factor(name, match.group(2), header))
    return names, factors


def _factor(name: str, unit: str, header: str) -> float:
    try:
        return si_factor(name, unit)
    except UserError as error:
        raise UserError(f"{header}, column {name}: {error}") from None


def _table(lines: Sequence[str], names: Sequence[str], source: Source) -> Floats:
    """Numbers ``(n_times, n_columns)`` of the rows below the header."""
    rows = []
    for row, line in enumerate(lines):
        cells = line.split(",")
        if len(cells) != len(names):
            found = len(cells) if line.strip() else 0
            raise UserError(
                f"{source.file}, {source.place(row)}: {found} cells where the header has {len(names)} columns, "
                "give one number for each"
            )
        rows.append(
            [
                _number(cell, f"{source.file}, {source.place(row)}, column {name}")
                for cell, name in zip(cells, names, strict=True)
            ]
        )
    return np.array(rows, dtype=np.float64)


def _dataset_labels(dataset: xr.Dataset, path: Path) -> tuple[Labels, list[str]]:
    """Labels and the order of the channels from a dataset's ``record`` attribute, where it has one."""
    try:
        facts = json.loads(dataset.attrs.get("record", "{}"))
        stated = facts.get("time_step")
        labels = Labels(
            name=str(facts.get("name", path.stem)),
            time_step=None if stated is None else float(stated),
            provenance={str(key): str(value) for key, value in facts.get("provenance", {}).items()},
            truth={str(key): float(value) for key, value in facts.get("truth", {}).items()},
            noise_sd={str(key): float(value) for key, value in facts.get("noise_sd", {}).items()},
            has_time=bool(facts.get("has_time", True)),
        )
        return labels, [str(name) for name in facts.get("channels", [])]
    except (ValueError, TypeError, AttributeError):
        raise UserError(f"{path}: the attribute 'record' is damaged, remove it or write the file anew") from None


def _variable_column(variable: xr.Variable, name: str, path: Path) -> Column:
    unit = variable.attrs.get("units")
    if not isinstance(unit, str):
        raise UserError(f"{path}, column {name}: the unit is missing, set the attribute units to {si_unit(name)!r}")
    if variable.ndim != 1 or variable.dtype.kind not in "fiu":
        raise UserError(f"{path}, column {name}: it must hold one number for each time")
    values = variable.values.astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise UserError(
            f"{path}, point {bad[0] + 1}, column {name}: the value is {values[bad[0]]}, every value must be a finite "
            "number"
        )
    return Column(name, _factor(name, unit, str(path)), values)
