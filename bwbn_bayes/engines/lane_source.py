"""The source of a lane kernel: sixteen draws advance together, one per lane of flat arrays.

Arrays are flat and indexed ``row * LANES + lane``, so that the innermost loops vectorise. A building's state rows are,
storey by storey, drift, drift rate, hysteretic displacement, energy, added states. Observation rows are the drifts,
drift rates, hysteretic displacements, energies, storey forces and total floor accelerations, each for all storeys.
"""

from __future__ import annotations

import re

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, StoreyLaw
from bwbn_bayes.engines.codegen import LawPrograms, Program, print_expression

LANES = 16
OBSERVED_KINDS = ("drift", "drift_rate", "hysteretic_displacement", "hysteretic_energy", "force", "acceleration")
FLAGS = 'error_model="numpy", fastmath={"contract", "reassoc", "arcp", "nsz"}, nogil=True, cache=True'

_MATHEMATICS = '''\
import math
import numpy as np
from numba import njit, types
from numba.extending import intrinsic

LANES = {lanes}


@intrinsic
def _bits(typing_context, value):
    """The bit pattern of a double as an integer."""
    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.int64))
    return types.int64(types.float64), generate


@intrinsic
def _from_bits(typing_context, value):
    """The double with the given bit pattern."""
    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.float64))
    return types.float64(types.int64), generate


@njit({flags})
def _exp(x):
    """Exponential to 1e-15 relative; the power of two is assembled from bits, so that the loop vectorises."""
    x = x if x > -708.0 else -708.0
    x = x if x < 708.0 else 708.0
    k = np.floor(x * 1.4426950408889634 + 0.5)
    r = x - k * 0.693147180369123816490 - k * 1.90821492927058770002e-10
    p = 1.6059043836821613e-10
    p = p * r + 2.08767569878681e-09
    p = p * r + 2.505210838544172e-08
    p = p * r + 2.755731922398589e-07
    p = p * r + 2.7557319223985893e-06
    p = p * r + 2.48015873015873e-05
    p = p * r + 0.0001984126984126984
    p = p * r + 0.001388888888888889
    p = p * r + 0.008333333333333333
    p = p * r + 0.041666666666666664
    p = p * r + 0.16666666666666666
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return p * _from_bits(_bits(k + 4503599627371519.0) << 52)


@njit({flags})
def _log(x):
    """Natural logarithm of a positive number to 1e-15; exponent and mantissa are split by bits."""
    b = _bits(x)
    e = _from_bits((b >> 52) | 0x4330000000000000) - 4503599627371519.0
    m = _from_bits((b & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000)
    large = m > 1.4142135623730951
    m = 0.5 * m if large else m
    e = e + 1.0 if large else e
    s = (m - 1.0) / (m + 1.0)
    q = s * s
    p = 0.09523809523809523
    p = p * q + 0.10526315789473684
    p = p * q + 0.11764705882352941
    p = p * q + 0.13333333333333333
    p = p * q + 0.15384615384615385
    p = p * q + 0.18181818181818182
    p = p * q + 0.2222222222222222
    p = p * q + 0.2857142857142857
    p = p * q + 0.4
    p = p * q + 0.6666666666666666
    p = p * q + 2.0
    return e * 0.6931471805599453 + s * p
'''

_RATES = '''

@njit({flags})
def prepare(n_storeys, par, derived):
    for i in range(n_storeys):
        p = i * {n_par} * LANES
        d = i * {n_derived} * LANES
        for l in range(LANES):
{prepare}


@njit({flags})
def rates(n_storeys, y, ground, par, derived, happened, inv_mass, force, acceleration, dy):
    for i in range(n_storeys):
        b = i * {n_rows} * LANES
        p = i * {n_par} * LANES
        d = i * {n_derived} * LANES
        e = i * {n_events} * LANES
        f = i * LANES
        for l in range(LANES):
{rates}
{assembly}


@njit({flags})
def tangents(n_storeys, n_directions, y, par, derived, happened, inv_mass, seed, slope, force, acceleration, dy):
    for i in range(n_storeys):
        b = i * {n_rows} * LANES
        p = i * {n_par} * LANES
        d = i * {n_derived} * LANES
        e = i * {n_events} * LANES
        for l in range(LANES):
{slopes}
        for k in range(n_directions):
            o = b + (k + 1) * n_storeys * {n_rows} * LANES
            f = ((k + 1) * (n_storeys + 1) + i) * LANES
            c = seed[i * n_directions + k] * LANES
            for l in range(LANES):
{chain}
    for k in range(n_directions):
        for i in range(n_storeys):
            f = ((k + 1) * (n_storeys + 1) + i) * LANES
            a = ((k + 1) * n_storeys + i) * LANES
            for l in range(LANES):
                acceleration[a + l] = (force[f + LANES + l] - force[f + l]) * inv_mass[i * LANES + l]
{tangent_assembly}


@njit({flags})
def differentiate(n_storeys, n_directions, y, ground, par, derived, happened, inv_mass, seed, slope, force,
                  acceleration, dy):
    rates(n_storeys, y, ground, par, derived, happened, inv_mass, force, acceleration, dy)
    if n_directions > 0:
        tangents(n_storeys, n_directions, y, par, derived, happened, inv_mass, seed, slope, force, acceleration, dy)
'''

_BUILDING = '''\
    for i in range(n_storeys):
        f = i * LANES
        for l in range(LANES):
            acceleration[f + l] = (force[f + LANES + l] - force[f + l]) * inv_mass[f + l]
    for l in range(LANES):
        dy[LANES + l] = acceleration[l] - ground[l]
    for i in range(1, n_storeys):
        b = (i * {n_rows} + 1) * LANES
        f = i * LANES
        for l in range(LANES):
            dy[b + l] = acceleration[f + l] - acceleration[f - LANES + l]
'''

_BUILDING_TANGENT = '''\
    for k in range(n_directions):
        for i in range(n_storeys):
            o = ((k + 1) * n_storeys + i) * {n_rows} * LANES + LANES
            a = ((k + 1) * n_storeys + i) * LANES
            for l in range(LANES):
                below = acceleration[a - LANES + l] if i > 0 else 0.0
                dy[o + l] = acceleration[a + l] - below
'''

_DRIVEN = '''\
    for l in range(LANES):
        dy[LANES + l] = 0.0
'''

_DRIVEN_TANGENT = '''\
    for k in range(n_directions):
        o = ((k + 1) * {n_rows} + 1) * LANES
        for l in range(LANES):
            dy[o + l] = 0.0
'''

_ADVANCE = '''

@njit({flags})
def plan(n_storeys, dt, y, dy, par, substeps, resolution, length):
    for l in range(LANES):
        length[l] = substeps
{plan}
    for l in range(LANES):
        length[l] = dt / length[l]


@njit({flags})
def next_step(n_storeys, dt, start, position, par, happened, length, step):
    for l in range(LANES):
        remaining = dt - position[l]
        h = length[l]
        h = remaining if remaining - h < 1e-9 * dt else h
        step[l] = h if remaining > 1e-12 * dt else 0.0
{limit}
    longest = 0.0
    for l in range(LANES):
        if step[l] > longest:
            longest = step[l]
    return longest


@njit({flags})
def arrive(n_storeys, start, tolerance, position, par, happened, flipped):
    any_flipped = 0.0
    for r in range(n_storeys * {n_events} * LANES):
        flipped[r] = 0.0
{arrive}
    for r in range(n_storeys * {n_events} * LANES):
        any_flipped += flipped[r]
    return any_flipped > 0.0


@njit({flags})
def first_half(n_links, y, dy, step, total, trial):
    for i in range(n_links):
        b = i * {n_rows} * LANES
        for l in range(LANES):
{first_half}


@njit({flags})
def second_half(n_links, y, dy, step, share, total, trial):
    for i in range(n_links):
        b = i * {n_rows} * LANES
        for l in range(LANES):
{second_half}


@njit({flags})
def finish(n_links, y, dy, step, total):
    for i in range(n_links):
        b = i * {n_rows} * LANES
        for l in range(LANES):
{finish}


@njit({flags})
def rk4(n_storeys, n_directions, dt, ground_0, ground_1, position, step, y, dy, trial, total, ground, par, derived,
        happened, inv_mass, seed, slope, force, acceleration):
    n_links = n_storeys * (1 + n_directions)
    first_half(n_links, y, dy, step, total, trial)
    for l in range(LANES):
        ground[l] = ground_0 + (ground_1 - ground_0) * ((position[l] + 0.5 * step[l]) / dt)
    differentiate(n_storeys, n_directions, trial, ground, par, derived, happened, inv_mass, seed, slope, force,
                  acceleration, dy)
    second_half(n_links, y, dy, step, 0.5, total, trial)
    differentiate(n_storeys, n_directions, trial, ground, par, derived, happened, inv_mass, seed, slope, force,
                  acceleration, dy)
    second_half(n_links, y, dy, step, 1.0, total, trial)
    for l in range(LANES):
        ground[l] = ground_0 + (ground_1 - ground_0) * ((position[l] + step[l]) / dt)
    differentiate(n_storeys, n_directions, trial, ground, par, derived, happened, inv_mass, seed, slope, force,
                  acceleration, dy)
    finish(n_links, y, dy, step, total)


@njit({flags})
def jump(n_storeys, n_directions, y, dy, before, seed, flipped):
    width = n_storeys * {n_rows}
    for i in range(n_storeys):
        for k in range(n_directions):
            number = {event_of_seed}
            if number < 0:
                continue
            m = (i * {n_events} + number) * LANES
            for r in range(width):
                o = r * LANES
                t = ((k + 1) * width + r) * LANES
                for l in range(LANES):
                    y[t + l] += flipped[m + l] * (before[o + l] - dy[o + l])


@njit({flags})
def observe(n_storeys, n_directions, y, force, acceleration, seen):
    n = n_storeys * LANES
    for k in range(n_directions + 1):
        for i in range(n_storeys):
            b = (k * n_storeys + i) * {n_rows} * LANES
            f = (k * (n_storeys + 1) + i) * LANES
            a = (k * n_storeys + i) * LANES
            s = k * 6 * n + i * LANES
            for l in range(LANES):
                seen[s + l] = y[b + l]
                seen[s + n + l] = y[b + LANES + l]
                seen[s + 2 * n + l] = y[b + 2 * LANES + l]
                seen[s + 3 * n + l] = y[b + 3 * LANES + l]
                seen[s + 4 * n + l] = force[f + l]
                seen[s + 5 * n + l] = acceleration[a + l]


@njit({flags})
def combine_channels(n_storeys, n_directions, starts, row, coefficient, ground_part, ground_now, seen, value):
    n_channels = ground_part.shape[0]
    for k in range(n_directions + 1):
        for c in range(n_channels):
            o = (k * n_channels + c) * LANES
            offset = ground_part[c] * ground_now if k == 0 else 0.0
            for l in range(LANES):
                value[o + l] = offset
            for term in range(starts[c], starts[c + 1]):
                s = (k * 6 * n_storeys + row[term]) * LANES
                weight = coefficient[term]
                for l in range(LANES):
                    value[o + l] += weight * seen[s + l]


@njit({flags})
def accumulate(n_channels, n_directions, j, measured, value, misfit, gram):
    for c in range(n_channels):
        o = c * LANES
        for l in range(LANES):
            value[o + l] = measured[c, j] - value[o + l]
            misfit[o + l] += value[o + l] * value[o + l]
        g = c * (n_directions * (n_directions + 3) // 2) * LANES
        for a in range(1, n_directions + 1):
            left = (a * n_channels + c) * LANES
            for b in range(a + 1):
                right = (b * n_channels + c) * LANES
                for l in range(LANES):
                    gram[g + l] += value[left + l] * value[right + l]
                g += LANES
'''

_RUN = '''

@njit({flags})
def run(n_storeys, n_directions, dt, excitation, par, inv_mass, seed, substeps, resolution, starts, row, coefficient,
        ground_part, measured, misfit, gram, store, stored):
    n_times = excitation.shape[0]
    n_rows = n_storeys * {n_rows} * (1 + n_directions)
    n_channels = ground_part.shape[0]
    y = np.zeros(n_rows * LANES)
    dy = np.zeros(n_rows * LANES)
    trial = np.zeros(n_rows * LANES)
    total = np.zeros(n_rows * LANES)
    before = np.zeros(n_storeys * {n_rows} * LANES)
    derived = np.zeros(n_storeys * {n_derived} * LANES)
    happened = np.zeros(n_storeys * {n_events} * LANES)
    slope = np.zeros({n_outputs} * {n_columns} * LANES)
    force = np.zeros((n_storeys + 1) * (n_directions + 1) * LANES)
    acceleration = np.zeros(n_storeys * (n_directions + 1) * LANES)
    seen = np.zeros(6 * n_storeys * (n_directions + 1) * LANES)
    value = np.zeros(n_channels * (n_directions + 1) * LANES)
    ground = np.zeros(LANES)
    position = np.zeros(LANES)
    length = np.zeros(LANES)
    step = np.zeros(LANES)
    flipped = np.zeros(n_storeys * {n_events} * LANES)
    uniform = resolution <= 0.0 and {no_events}
    prepare(n_storeys, par, derived)
    arrive(n_storeys, 0.0, 1e-9 * dt, position, par, happened, flipped)
    for j in range(n_times):
        ground_0 = excitation[j]
        ground_1 = excitation[j + 1] if j + 1 < n_times else excitation[j]
        for l in range(LANES):
            position[l] = 0.0
            ground[l] = ground_0
{drive}
        differentiate(n_storeys, n_directions, y, ground, par, derived, happened, inv_mass, seed, slope, force,
                      acceleration, dy)
        observe(n_storeys, n_directions, y, force, acceleration, seen)
        combine_channels(n_storeys, n_directions, starts, row, coefficient, ground_part, ground_0, seen, value)
        if store:
            o = j * n_channels * (n_directions + 1) * LANES
            for r in range(n_channels * (n_directions + 1) * LANES):
                stored[o + r] = value[r]
        else:
            accumulate(n_channels, n_directions, j, measured, value, misfit, gram)
        if j + 1 == n_times:
            break
        if uniform:
            for l in range(LANES):
                step[l] = dt / substeps
            for s in range(substeps):
                if s > 0:
                    for l in range(LANES):
                        position[l] = s * step[l]
                        ground[l] = ground_0 + (ground_1 - ground_0) * (position[l] / dt)
                    differentiate(n_storeys, n_directions, y, ground, par, derived, happened, inv_mass, seed, slope,
                                  force, acceleration, dy)
                rk4(n_storeys, n_directions, dt, ground_0, ground_1, position, step, y, dy, trial, total, ground, par,
                    derived, happened, inv_mass, seed, slope, force, acceleration)
            continue
        plan(n_storeys, dt, y, dy, par, substeps, resolution, length)
        first = True
        while next_step(n_storeys, dt, j * dt, position, par, happened, length, step) > 0.0:
            if not first:
                for l in range(LANES):
                    ground[l] = ground_0 + (ground_1 - ground_0) * (position[l] / dt)
                differentiate(n_storeys, n_directions, y, ground, par, derived, happened, inv_mass, seed, slope, force,
                              acceleration, dy)
            first = False
            rk4(n_storeys, n_directions, dt, ground_0, ground_1, position, step, y, dy, trial, total, ground, par,
                derived, happened, inv_mass, seed, slope, force, acceleration)
            for l in range(LANES):
                position[l] += step[l]
                ground[l] = ground_0 + (ground_1 - ground_0) * (position[l] / dt)
            if {no_events}:
                continue
            if n_directions > 0:
                rates(n_storeys, y, ground, par, derived, happened, inv_mass, force, acceleration, dy)
                for r in range(n_storeys * {n_rows} * LANES):
                    before[r] = dy[r]
            if arrive(n_storeys, j * dt, 1e-9 * dt, position, par, happened, flipped) and n_directions > 0:
                rates(n_storeys, y, ground, par, derived, happened, inv_mass, force, acceleration, dy)
                jump(n_storeys, n_directions, y, dy, before, seed, flipped)
'''


def lane_source(law: StoreyLaw, programs: LawPrograms, *, driven: bool) -> str:
    """Source of the kernel module of one storey law.

    Parameters
    ----------
    law : StoreyLaw
        The law; its parameters set the rows of ``par``.
    programs : LawPrograms
        The law as straight-line code.
    driven : bool
        True for a specimen whose displacement is given, False for a base-excited building.
    """
    n_rows = 2 + len(law.states)
    n_par = len(law.parameters)
    n_events = max(len(law.events), 1)
    rates, tangent = programs.rates, programs.tangent
    n_derived = max(len(rates.hoisted) + len(tangent.hoisted), 1)
    n_columns = len(programs.variables) + 1
    fields = {
        "flags": FLAGS,
        "lanes": LANES,
        "n_rows": n_rows,
        "n_par": n_par,
        "n_events": n_events,
        "n_derived": n_derived,
        "n_outputs": 1 + len(law.states),
        "n_columns": n_columns,
        "no_events": str(not law.events),
        "prepare": _prepare(law, rates, 0) + _prepare(law, tangent, len(rates.hoisted)),
        "rates": _rates(law, rates),
        "slopes": _slopes(law, programs, len(rates.hoisted), n_columns),
        "chain": _chain(law, programs, n_columns),
        "assembly": (_DRIVEN if driven else _BUILDING).format(n_rows=n_rows).rstrip(),
        "tangent_assembly": (_DRIVEN_TANGENT if driven else _BUILDING_TANGENT).format(n_rows=n_rows).rstrip(),
        "plan": _plan(law, n_rows),
        "limit": _limit(law),
        "arrive": _arrive(law),
        "event_of_seed": _event_of_seed(law),
        "first_half": _by_row(
            n_rows,
            "total[{o}] = y[{o}] + step[l] / 6.0 * dy[{o}]",
            "trial[{o}] = y[{o}] + 0.5 * step[l] * dy[{o}]",
        ),
        "second_half": _by_row(
            n_rows,
            "total[{o}] += step[l] / 3.0 * dy[{o}]",
            "trial[{o}] = y[{o}] + share * step[l] * dy[{o}]",
        ),
        "finish": _by_row(n_rows, "y[{o}] = total[{o}] + step[l] / 6.0 * dy[{o}]"),
        "drive": _drive() if driven else "",
    }
    return "".join(part.format(**fields) for part in (_MATHEMATICS, _RATES, _ADVANCE, _RUN))


def _used(names: list[str], lines: list[str]) -> list[str]:
    words = set(re.findall(r"[A-Za-z_]\w*", "\n".join(lines)))
    return [name for name in names if name in words]


def _indent(lines: list[str], depth: int) -> str:
    return "\n".join(" " * 4 * depth + line for line in lines) + ("\n" if lines else "")


def _loads(law: StoreyLaw, program: Program, first_derived: int, lines: list[str]) -> list[str]:
    """Lines that load what the given lines use: states, parameters, hoisted values, event indicators."""
    states = [str(s) for s in (DRIFT, DRIFT_RATE, *law.states)]
    parameters = [str(s) for s in law.symbols]
    derived = [name for name, _ in program.hoisted]
    events = [str(event.indicator) for event in law.events]
    loads = [f"{s} = y[b + {states.index(s)} * LANES + l]" for s in _used(states, lines)]
    loads += [f"{s} = par[p + {parameters.index(s)} * LANES + l]" for s in _used(parameters, lines)]
    loads += [f"{s} = derived[d + {first_derived + derived.index(s)} * LANES + l]" for s in _used(derived, lines)]
    loads += [f"{s} = happened[e + {events.index(s)} * LANES + l]" for s in _used(events, lines)]
    return loads


def _prepare(law: StoreyLaw, program: Program, first: int) -> str:
    sources = [source for _, source in program.hoisted]
    parameters = [str(s) for s in law.symbols]
    lines = [f"{s} = par[p + {parameters.index(s)} * LANES + l]" for s in _used(parameters, sources)]
    for position, (name, source) in enumerate(program.hoisted):
        lines += [f"{name} = {source}", f"derived[d + {first + position} * LANES + l] = {name}"]
    return _indent(lines or ["pass"], 3)


def _rates(law: StoreyLaw, program: Program) -> str:
    body = [f"{name} = {source}" for name, source in program.lines]
    ends = [f"force[f + l] = {program.outputs[0]}", "dy[b + l] = v"]
    ends += [f"dy[b + {2 + i} * LANES + l] = {source}" for i, source in enumerate(program.outputs[1:])]
    return _indent(_loads(law, program, 0, body + ends) + body + ends, 3)


def _slopes(law: StoreyLaw, programs: LawPrograms, first_derived: int, n_columns: int) -> str:
    program = programs.tangent
    body = [f"{name} = {source}" for name, source in program.lines]
    sources = program.outputs[1 + len(law.states) :]
    ends = [
        f"slope[{output * n_columns + variable} * LANES + l] = {source}"
        for (output, variable), source in zip(programs.partials, sources, strict=True)
    ]
    return _indent(_loads(law, program, first_derived, body + ends) + body + ends, 3)


def _chain(law: StoreyLaw, programs: LawPrograms, n_columns: int) -> str:
    n_states = 2 + len(law.states)
    lines = [f"t{i} = y[o + {i} * LANES + l]" for i in range(n_states)]
    lines.append("dy[o + l] = t1")
    for output in range(1 + len(law.states)):
        terms = [f"slope[{output * n_columns} * LANES + c + l]"]
        terms += [
            f"slope[{output * n_columns + variable} * LANES + l] * t{variable}"
            for row, variable in programs.partials
            if row == output and variable < n_states
        ]
        target = "force[f + l]" if output == 0 else f"dy[o + {1 + output} * LANES + l]"
        lines.append(f"{target} = {' + '.join(terms)}")
    return _indent(lines, 4)


def _plan(law: StoreyLaw, n_rows: int) -> str:
    if not law.sharp_features:
        return ""
    names = [str(s) for s in (DRIFT, DRIFT_RATE, *law.states)]
    parameters = [str(s) for s in law.symbols]
    lines = []
    for feature in law.sharp_features:
        state = names.index(str(feature.state))
        width = print_expression(feature.width)
        lines += [f"{s} = par[p + {parameters.index(s)} * LANES + l]" for s in _used(parameters, [width])]
        lines += [
            f"width = {width}",
            f"change = abs(dy[b + {state} * LANES + l]) * dt",
            f"needed = np.ceil(change / (resolution * width)) if abs(y[b + {state} * LANES + l]) < change + 3.0 * width else 1.0",
            "needed = needed if needed < 64.0 else 64.0",
            "length[l] = length[l] if length[l] > needed else needed",
        ]
    head = [
        "if resolution > 0.0:",
        "    for i in range(n_storeys):",
        f"        b = i * {n_rows} * LANES",
        f"        p = i * {len(parameters)} * LANES",
        "        for l in range(LANES):",
    ]
    return _indent(head + ["            " + line for line in lines], 1)


def _limit(law: StoreyLaw) -> str:
    lines = []
    for number, column in enumerate(law.event_parameters):
        lines += [
            "for i in range(n_storeys):",
            "    for l in range(LANES):",
            f"        until = par[(i * {len(law.parameters)} + {column}) * LANES + l] - start - position[l]",
            f"        pending = happened[(i * {len(law.events)} + {number}) * LANES + l] == 0.0",
            "        step[l] = until if pending and until < step[l] else step[l]",
        ]
    return _indent(lines, 1)


def _arrive(law: StoreyLaw) -> str:
    lines = []
    for number, column in enumerate(law.event_parameters):
        lines += [
            "for i in range(n_storeys):",
            "    for l in range(LANES):",
            f"        until = par[(i * {len(law.parameters)} + {column}) * LANES + l] - start - position[l]",
            f"        o = (i * {len(law.events)} + {number}) * LANES + l",
            "        if happened[o] == 0.0 and until <= tolerance:",
            "            happened[o] = 1.0",
            "            flipped[o] = 1.0",
        ]
    return _indent(lines, 1)


def _event_of_seed(law: StoreyLaw) -> str:
    first = 2 + len(law.states)
    text = "-1"
    for number, column in enumerate(law.event_parameters):
        text = f"({number} if seed[i * n_directions + k] == {first + column} else {text})"
    return text


def _by_row(n_rows: int, *statements: str) -> str:
    """Statements repeated for each state row of a link: one long loop body vectorises better than many short ones."""
    return _indent([s.format(o=f"b + {r} * LANES + l") for r in range(n_rows) for s in statements], 3)


def _drive() -> str:
    return _indent(
        [
            "for l in range(LANES):",
            "    y[l] = ground_0",
            "    y[LANES + l] = (ground_1 - ground_0) / dt",
        ],
        2,
    )
