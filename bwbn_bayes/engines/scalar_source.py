"""The source of a scalar kernel: one draw's right-hand side, its Jacobian, its sensitivities and a Runge-Kutta solve.

All functions share one flat array ``data``: a head (number of storeys, time step, number of samples, number of
directions), then a block per storey (law parameters, values derived from them, event indicators, inverse mass, force,
acceleration, their derivatives in the direction at hand, partial derivatives of the law), then the direction of each
identified parameter, then the excitation. One array is what a C callback can carry. State rows are, storey by storey,
drift, drift rate, hysteretic displacement, energy, added states.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, StoreyLaw
from bwbn_bayes.engines.codegen import LawPrograms, Program, print_expression
from bwbn_bayes.engines.step_rules import MARGIN, MOST_STEPS, REACH, has_kink

HEAD = 4
FLAGS = 'error_model="numpy", fastmath={"contract", "reassoc", "arcp", "nsz"}, nogil=True, cache=True'


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Where things stand inside a storey's block of ``data``, and the sizes that follow from the law.

    Attributes
    ----------
    n_rows : int
        State rows of a storey.
    n_columns : int
        Columns of the table of partial derivatives: the law's variables, and one of zeros.
    derived, happened, inverse_mass, force, acceleration, force_slope, acceleration_slope, slope, block : int
        Offsets in a storey's block; ``block`` is its length. Parameters come first.
    """

    n_rows: int
    n_columns: int
    derived: int
    happened: int
    inverse_mass: int
    force: int
    acceleration: int
    force_slope: int
    acceleration_slope: int
    slope: int
    block: int

    def seed(self, n_storeys: int) -> int:
        """Where the columns that each direction moves begin, storey by storey."""
        return HEAD + n_storeys * self.block

    def excitation(self, n_storeys: int, n_directions: int) -> int:
        """Where the excitation begins."""
        return self.seed(n_storeys) + n_storeys * n_directions


def layout(law: StoreyLaw, programs: LawPrograms) -> Layout:
    """Lay out ``data`` for one storey law."""
    derived = len(law.parameters)
    happened = derived + len(programs.rates.hoisted) + len(programs.tangent.hoisted)
    inverse_mass = happened + len(law.events)
    n_columns = len(programs.variables) + 1
    slope = inverse_mass + 5
    return Layout(
        n_rows=2 + len(law.states),
        n_columns=n_columns,
        derived=derived,
        happened=happened,
        inverse_mass=inverse_mass,
        force=inverse_mass + 1,
        acceleration=inverse_mass + 2,
        force_slope=inverse_mass + 3,
        acceleration_slope=inverse_mass + 4,
        slope=slope,
        block=slope + (1 + len(law.states)) * n_columns,
    )


_LAW = '''\
import numpy as np
from math import exp2 as _exp2, log2 as _log2
from numba import njit


@njit({flags})
def prepare(data):
    """What the law needs that changes at events alone."""
    for i in range(int(data[0])):
        here = {head} + i * {block}
{prepare}


@njit({flags})
def rates(y, ground, dy, data):
    n_storeys = int(data[0])
    for i in range(n_storeys):
        base = i * {n_rows}
        here = {head} + i * {block}
{rates}
    below = ground
    for i in range(n_storeys):
        here = {head} + i * {block}
        above = data[here + {block} + {force}] if i + 1 < n_storeys else 0.0
        acceleration = (above - data[here + {force}]) * data[here + {inverse_mass}]
        data[here + {acceleration}] = acceleration
        dy[i * {n_rows} + 1] = {drift_rate_rate}
        below = acceleration


@njit({flags})
def slopes(y, data):
    for i in range(int(data[0])):
        base = i * {n_rows}
        here = {head} + i * {block}
{slopes}


@njit({flags})
def direction(k, t, dt_, data):
    """Derivative of the rates in direction k, once ``slopes`` has filled the table of partial derivatives."""
    n_storeys = int(data[0])
    n_directions = int(data[3])
    for i in range(n_storeys):
        base = i * {n_rows}
        here = {head} + i * {block}
        moved = here + int(data[{head} + n_storeys * {block} + i * n_directions + k])
{chain}
    below = 0.0
    for i in range(n_storeys):
        here = {head} + i * {block}
        above = data[here + {block} + {force_slope}] if i + 1 < n_storeys else 0.0
        acceleration = (above - data[here + {force_slope}]) * data[here + {inverse_mass}]
        data[here + {acceleration_slope}] = acceleration
        dt_[i * {n_rows} + 1] = {drift_rate_rate}
        below = acceleration


@njit({flags})
def jacobian(y, matrix, data):
    """Derivative of the rates with respect to the states: ``matrix[column, row]``."""
    n_storeys = int(data[0])
    matrix[:, :] = 0.0
    slopes(y, data)
    for i in range(n_storeys):
        base = i * {n_rows}
        here = {head} + i * {block}
        matrix[base + 1, base] = 1.0
{jacobian}


@njit({flags})
def ground_at(t, data):
    dt = data[1]
    n_times = int(data[2])
    o = {head} + int(data[0]) * ({block} + int(data[3]))
    j = min(max(int(t / dt), 0), n_times - 2)
    return data[o + j] + (data[o + j + 1] - data[o + j]) * (t / dt - j)


@njit({flags})
def rhs(t, y, dy, data):
    """Rates at time t; returns 1 where one of them is not finite."""
    rates(y, ground_at(t, data), dy, data)
    return 0 if np.isfinite(np.sum(dy)) else 1
'''

_EVENTS = '''

@njit({flags})
def next_event(now, tolerance, data):
    """Time of the next event that has not happened, infinite where there is none."""
    found = np.inf
    for i in range(int(data[0])):
        here = {head} + i * {block}
{next_event}
    return found


@njit({flags})
def strike(until, ground, y, tangents, before, after, data):
    """Let the events that are due at ``until`` happen, one by one.

    Each adds ``(rate before - rate after) d time / d parameter`` to the tangents; a time that several events share
    collects all their terms.
    """
    n_storeys = int(data[0])
    n_directions = tangents.shape[0]
    for i in range(n_storeys):
        here = {head} + i * {block}
        seed = {head} + n_storeys * {block} + i * n_directions
{strike}


@njit({flags})
def drive(j, y, data):
    """State of a driven specimen at sample j: the given displacement and the slope of the segment that begins.

    The last sample keeps the slope of the segment that ends there.
    """
    if {driven}:
        o = {head} + int(data[0]) * ({block} + int(data[3]))
        ahead = min(j + 1, int(data[2]) - 1)
        y[0] = data[o + j]
        y[1] = (data[o + ahead] - data[o + ahead - 1]) / data[1]


@njit({flags})
def observe(j, y, tangents, starts, row, coefficient, ground_part, data, out):
    """Channels and their derivatives at a sample, ``out[direction + 1, channel]``, from ``rates`` just evaluated."""
    n_storeys = int(data[0])
    n_directions = int(data[3])
    o = {head} + n_storeys * ({block} + n_directions)
    channels(y, {force}, {acceleration}, data[o + j], starts, row, coefficient, ground_part, data, out[0])
    if n_directions > 0:
        slopes(y, data)
        rate = np.empty_like(y)
        for k in range(n_directions):
            direction(k, tangents[k], rate, data)
            channels(tangents[k], {force_slope}, {acceleration_slope}, 0.0, starts, row, coefficient, ground_part,
                     data, out[k + 1])


@njit({flags})
def channels(y, force, acceleration, ground, starts, row, coefficient, ground_part, data, out):
    n_storeys = int(data[0])
    for c in range(ground_part.shape[0]):
        total = ground_part[c] * ground
        for term in range(starts[c], starts[c + 1]):
            kind = row[term] // n_storeys
            storey = row[term] - kind * n_storeys
            here = {head} + storey * {block}
            if kind < 4:
                value = y[storey * {n_rows} + kind]
            elif kind == 4:
                value = data[here + force]
            else:
                value = data[here + acceleration]
            total += coefficient[term] * value
        out[c] = total
'''

_RUNGE_KUTTA = '''

@njit({flags})
def all_rates(y, ground, dy, data):
    """Rates of the state ``y[0]`` and of its derivatives ``y[1:]``."""
    rates(y[0], ground, dy[0], data)
    if y.shape[0] > 1:
        slopes(y[0], data)
        for k in range(y.shape[0] - 1):
            direction(k, y[k + 1], dy[k + 1], data)


@njit({flags})
def rk4(t, h, y, dy, trial, total, data):
    """One step from t to t + h; ``dy`` holds the rates at t and is overwritten."""
    flat, rate, ahead, new = y.ravel(), dy.ravel(), trial.ravel(), total.ravel()
    for r in range(flat.shape[0]):
        new[r] = flat[r] + h / 6.0 * rate[r]
        ahead[r] = flat[r] + 0.5 * h * rate[r]
    middle = ground_at(t + 0.5 * h, data)
    for share in (0.5, 1.0):
        all_rates(trial, middle, dy, data)
        for r in range(flat.shape[0]):
            new[r] += h / 3.0 * rate[r]
            ahead[r] = flat[r] + share * h * rate[r]
    all_rates(trial, ground_at(t + h, data), dy, data)
    for r in range(flat.shape[0]):
        flat[r] = new[r] + h / 6.0 * rate[r]


@njit({flags})
def plan(substeps, resolution, y, dy, data):
    """Length of the steps in the next interval."""
    dt = data[1]
    steps = float(substeps)
    for i in range(int(data[0])):
        base = i * {n_rows}
        here = {head} + i * {block}
{refine}
    return dt / steps


@njit({flags})
def turned(h, y, dy, data):
    """The step h, or less where a drift rate is foretold to change sign inside it."""
    for i in range(int(data[0])):
        base = i * {n_rows}
{turn}
    return h


@njit({flags})
def run_rk4(substeps, resolution, starts, row, coefficient, ground_part, data, out):
    n_storeys, dt, n_times, n_directions = int(data[0]), data[1], int(data[2]), int(data[3])
    shape = (1 + n_directions, n_storeys * {n_rows})
    y, dy, trial, total = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    before = np.zeros(n_storeys * {n_rows})
    after = np.zeros(n_storeys * {n_rows})
    tolerance = 1e-9 * dt
    prepare(data)
    strike(tolerance, 0.0, y[0], y[:0], before, after, data)
    event = next_event(0.0, tolerance, data)
    for j in range(n_times):
        drive(j, y[0], data)
        all_rates(y, ground_at(j * dt, data), dy, data)
        observe(j, y[0], y[1:], starts, row, coefficient, ground_part, data, out[j])
        if j + 1 == n_times:
            break
        length = plan(substeps, resolution, y[0], dy[0], data)
        position = 0.0
        while dt - position > 1e-12 * dt:
            now = j * dt + position
            h = dt - position if dt - position - length < tolerance else length
            h = min(turned(h, y[0], dy[0], data), event - now)
            rk4(now, h, y, dy, trial, total, data)
            position += h
            now = j * dt + position
            if event <= now + tolerance:
                strike(now + tolerance, ground_at(now, data), y[0], y[1:], before, after, data)
                event = next_event(now, tolerance, data)
            if dt - position > 1e-12 * dt:
                all_rates(y, ground_at(now, data), dy, data)
'''


def scalar_source(law: StoreyLaw, programs: LawPrograms, *, driven: bool) -> str:
    """Source of the scalar kernel of one storey law.

    Parameters
    ----------
    law : StoreyLaw
        The law; its parameters open each storey's block of ``data``.
    programs : LawPrograms
        The law as straight-line code.
    driven : bool
        True for a specimen whose displacement is given, False for a base-excited building.
    """
    place = layout(law, programs)
    tangent_derived = place.derived + len(programs.rates.hoisted)
    fields = {
        "flags": FLAGS,
        "head": HEAD,
        "block": place.block,
        "n_rows": place.n_rows,
        "inverse_mass": place.inverse_mass,
        "force": place.force,
        "acceleration": place.acceleration,
        "force_slope": place.force_slope,
        "acceleration_slope": place.acceleration_slope,
        "driven": str(driven),
        "drift_rate_rate": "0.0" if driven else "acceleration - below",
        "prepare": _indent(
            _prepare(law, place, programs.rates, place.derived)
            + _prepare(law, place, programs.tangent, tangent_derived)
        ),
        "rates": _indent(_rates(law, programs.rates, place)),
        "slopes": _indent(_slopes(law, programs, place, tangent_derived)),
        "chain": _indent(_chain(law, programs, place)),
        "jacobian": _indent(_jacobian(programs, place, driven)),
        "next_event": _indent(_next_event(law, place)),
        "strike": _indent(_strike(law, place)),
        "refine": _indent(_refine(law)),
        "turn": _indent(_turn(law)),
    }
    return "".join(part.format(**fields) for part in (_LAW, _EVENTS, _RUNGE_KUTTA))


def _indent(lines: list[str]) -> str:
    return "\n".join("        " + line for line in lines or ["pass"])


def _loads(law: StoreyLaw, place: Layout, program: Program, first_derived: int, lines: list[str]) -> list[str]:
    words = set(re.findall(r"[A-Za-z_]\w*", "\n".join(lines)))
    sources = {str(symbol): f"y[base + {row}]" for row, symbol in enumerate((DRIFT, DRIFT_RATE, *law.states))}
    sources |= {str(symbol): f"data[here + {column}]" for column, symbol in enumerate(law.symbols)}
    sources |= {name: f"data[here + {first_derived + column}]" for column, (name, _) in enumerate(program.hoisted)}
    sources |= {str(event.indicator): f"data[here + {place.happened + e}]" for e, event in enumerate(law.events)}
    return [f"{name} = {source}" for name, source in sources.items() if name in words]


def _prepare(law: StoreyLaw, place: Layout, program: Program, first: int) -> list[str]:
    lines = _loads(law, place, program, first, [source for _, source in program.hoisted])
    for position, (name, source) in enumerate(program.hoisted):
        lines += [f"{name} = {source}", f"data[here + {first + position}] = {name}"]
    return lines


def _rates(law: StoreyLaw, program: Program, place: Layout) -> list[str]:
    body = [f"{name} = {source}" for name, source in program.lines]
    body += [f"data[here + {place.force}] = {program.outputs[0]}", "dy[base] = v"]
    body += [f"dy[base + {2 + i}] = {source}" for i, source in enumerate(program.outputs[1:])]
    return _loads(law, place, program, place.derived, body) + body


def _slopes(law: StoreyLaw, programs: LawPrograms, place: Layout, first_derived: int) -> list[str]:
    program = programs.tangent
    body = [f"{name} = {source}" for name, source in program.lines]
    body += [
        f"data[here + {place.slope + output * place.n_columns + variable}] = {source}"
        for (output, variable), source in zip(programs.partials, program.outputs[1 + len(law.states) :], strict=True)
    ]
    return _loads(law, place, program, first_derived, body) + body


def _chain(law: StoreyLaw, programs: LawPrograms, place: Layout) -> list[str]:
    lines = ["dt_[base] = t[base + 1]"]
    for output in range(1 + len(law.states)):
        first = place.slope + output * place.n_columns
        terms = [f"data[moved + {first}]"]
        terms += [
            f"data[here + {first + variable}] * t[base + {variable}]"
            for row, variable in programs.partials
            if row == output and variable < place.n_rows
        ]
        target = f"data[here + {place.force_slope}]" if output == 0 else f"dt_[base + {1 + output}]"
        lines.append(f"{target} = {' + '.join(terms)}")
    return lines


def _jacobian(programs: LawPrograms, place: Layout, driven: bool) -> list[str]:
    """Each partial of the force pushes its own floor back and the floor below forward."""
    own = [(output, variable) for output, variable in programs.partials if variable < place.n_rows]
    lines = [
        f"matrix[base + {variable}, base + {1 + row}] = data[here + {place.slope + row * place.n_columns + variable}]"
        for row, variable in own
        if row > 0
    ]
    if driven:
        return lines
    lines += [
        f"inverse_mass = data[here + {place.inverse_mass}]",
        f"below = data[here - {place.block} + {place.inverse_mass}] if i > 0 else 0.0",
    ]
    for output, variable in own:
        if output == 0:
            lines += [
                f"slope = data[here + {place.slope + variable}]",
                f"matrix[base + {variable}, base + 1] = -slope * (inverse_mass + below)",
                "if i > 0:",
                f"    matrix[base + {variable}, base + 1 - {place.n_rows}] = slope * below",
                "if i + 1 < n_storeys:",
                f"    matrix[base + {variable}, base + 1 + {place.n_rows}] = slope * inverse_mass",
            ]
    return lines


def _next_event(law: StoreyLaw, place: Layout) -> list[str]:
    lines = []
    for number, column in enumerate(law.event_parameters):
        lines += [
            f"if data[here + {place.happened + number}] == 0.0:",
            f"    found = min(found, data[here + {column}])",
        ]
    return lines


def _strike(law: StoreyLaw, place: Layout) -> list[str]:
    lines = []
    for number, column in enumerate(law.event_parameters):
        happened = f"data[here + {place.happened + number}]"
        lines += [
            f"if {happened} == 0.0 and data[here + {column}] <= until:",
            "    if n_directions > 0:",
            "        rates(y, ground, before, data)",
            f"    {happened} = 1.0",
            "    prepare(data)",
            "    if n_directions > 0:",
            "        rates(y, ground, after, data)",
            "    for k in range(n_directions):",
            f"        if int(data[seed + k]) == {2 + len(law.states) + column}:",
            "            tangents[k] += before - after",
        ]
    return lines


def _refine(law: StoreyLaw) -> list[str]:
    names = [str(s) for s in (DRIFT, DRIFT_RATE, *law.states)]
    lines = []
    for feature in law.sharp_features:
        state, width = names.index(str(feature.state)), print_expression(feature.width)
        constants = {str(symbol): column for column, symbol in enumerate(law.symbols)}
        used = [name for name in constants if name in re.findall(r"[A-Za-z_]\w*", width)]
        lines += [f"{name} = data[here + {constants[name]}]" for name in used]
        lines += [
            f"change = abs(dy[base + {state}]) * dt / ({width})",
            f"if resolution > 0.0 and abs(y[base + {state}]) / ({width}) < change + {REACH}:",
            f"    steps = max(steps, min(np.ceil(change / resolution), {MOST_STEPS}))",
        ]
    return lines


def _turn(law: StoreyLaw) -> list[str]:
    if not has_kink(law, DRIFT_RATE):
        return []
    return [
        "if y[base + 1] * (y[base + 1] + h * dy[base + 1]) < 0.0:",
        "    until = -y[base + 1] / dy[base + 1]",
        f"    h = until if {MARGIN} * h < until < {1.0 - MARGIN} * h else h",
    ]
