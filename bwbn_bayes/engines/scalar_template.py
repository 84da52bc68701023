"""The text of a scalar kernel that is the same for every law; names in braces are filled by ``scalar_source``.

The law, its slopes and directions; events, the driven top and what is observed; the Runge-Kutta march.
"""

LAW = '''\
import numpy as np
from math import exp2 as _exp2, log2 as _log2
from bwbn_bayes.engines.kernel_cache import njit


@njit({flags})
def prepare(data):
    """What the law needs that changes at events alone."""
    for i in range(int(data[0])):
        here = {head} + i * {block}
{prepare}


@njit({inner_flags})
def gather(force, pull, data):
    """The links' forces on each node into row ``pull`` of its block; returns the force on what the building stands on.

    Links pull down where they end and up where they begin.
    """
    first = 0.0
    for i in range(int(data[0])):
        data[{head} + i * {block} + pull] = 0.0
    for i in range(int(data[0])):
        here = {head} + i * {block}
        lower = int(data[here + {lower}])
        data[{head} + (int(data[here + {upper}]) - 1) * {block} + pull] -= data[here + force]
        if lower > 0:
            data[{head} + (lower - 1) * {block} + pull] += data[here + force]
        else:
            first += data[here + force]
    return first


@njit({inner_flags})
def part(below, acceleration, dy, data):
    """The rates of the drift rates, from the accelerations of the nodes and of what the building stands on."""
    for i in range(int(data[0])):
        here = {head} + i * {block}
        lower = int(data[here + {lower}])
        under = data[{head} + (lower - 1) * {block} + acceleration] if lower > 0 else below
        dy[i * {n_rows} + 1] = {drift_rate_rate}


@njit({inner_flags})
def compare(bending, y, data):
    """Into row ``bending`` of each link's block its drift less that of the one it runs on from and of those above."""
    for i in range(int(data[0])):
        data[{head} + i * {block} + bending] = 0.0
    for i in range(int(data[0])):
        below = int(data[{head} + i * {block} + {runs_on_from}]) - 1
        if below >= 0:
            apart = y[i * {n_rows}] - y[below * {n_rows}]
            data[{head} + i * {block} + bending] += apart
            data[{head} + below * {block} + bending] -= apart


@njit({flags})
def rates(y, ground, dy, data):
    n_links = int(data[0])
{bend}    for i in range(n_links):
        base = i * {n_rows}
        here = {head} + i * {block}
{rates}
    net = gather({force}, {pull}, data)
{below}
    for i in range(n_links):
        base = i * {n_rows}
        here = {head} + i * {block}
        net = data[here + {pull}] + data[here + {applied}]
{floor}
        data[here + {acceleration}] = acceleration
    part(below, {acceleration}, dy, data)


@njit({flags})
def slopes(y, ground, data):
    n_links = int(data[0])
{bend}    for i in range(n_links):
        base = i * {n_rows}
        here = {head} + i * {block}
{slopes}
{around_slopes}


@njit({flags})
def direction(k, t, dt_, data):
    """Derivative of the rates in direction k, once ``slopes`` has filled the table of partial derivatives.

    In direction -1 the parameters stay as they are.
    """
    n_links = int(data[0])
    n_directions = int(data[3])
{bend_slope}    for i in range(n_links):
        base = i * {n_rows}
        here = {head} + i * {block}
{moved}
{chain}
    net = gather({force_slope}, {pull_slope}, data)
{below_slope}
    for i in range(n_links):
        base = i * {n_rows}
        here = {head} + i * {block}
        net = data[here + {pull_slope}]
{floor_slope}
        data[here + {acceleration_slope}] = acceleration
    part(below, {acceleration_slope}, dt_, data)


@njit({flags})
def jacobian(y, matrix, data):
    """Derivative of the rates with respect to the states: ``matrix[column, row]``."""
    slopes(y, 0.0, data)
    unit = np.zeros_like(y)
    for column in range(y.shape[0]):
        unit[column] = 1.0
        direction(-1, unit, matrix[column], data)
        unit[column] = 0.0


@njit({flags})
def ground_at(t, data):
    """The ground acceleration at time t; forces from outside go to the blocks of their nodes."""
    dt = data[1]
    n_times = int(data[2])
    o = {head} + int(data[0]) * ({block} + int(data[3]))
    j = min(max(int(t / dt), 0), n_times - 2)
    for i in range(int(data[0])):
        here = {head} + i * {block}
        m = o + int(data[here + {force_row}]) * n_times + j
        if m >= o + n_times:
            data[here + {applied}] = data[m] + (data[m + 1] - data[m]) * (t / dt - j)
    return data[o + j] + (data[o + j + 1] - data[o + j]) * (t / dt - j)


@njit({flags})
def rhs(t, y, dy, data):
    """Rates at time t; returns 1 where one of them is not finite."""
    rates(y, ground_at(t, data), dy, data)
    return 0 if np.isfinite(np.sum(dy)) else 1
'''

EVENTS = '''

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
    n_links = int(data[0])
    n_directions = tangents.shape[0]
    for i in range(n_links):
        here = {head} + i * {block}
        seed = {head} + n_links * {block} + i * n_directions
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
def see(j, y, starts, row, coefficient, ground_part, data, out):
    """Channels at a sample, from ``rates`` just evaluated."""
    o = {head} + int(data[0]) * ({block} + int(data[3]))
    channels(y, {force}, {acceleration}, data[o + j], starts, row, coefficient, ground_part, data, out)


@njit({flags})
def observe(j, y, tangents, starts, row, coefficient, ground_part, data, out):
    """Channels and their derivatives at a sample, ``out[direction + 1, channel]``, from ``rates`` just evaluated."""
    n_directions = int(data[3])
    see(j, y, starts, row, coefficient, ground_part, data, out[0])
    if n_directions > 0:
        slopes(y, data[{head} + int(data[0]) * ({block} + n_directions) + j], data)
        rate = np.empty_like(y)
        for k in range(n_directions):
            direction(k, tangents[k], rate, data)
            channels(tangents[k], {force_slope}, {acceleration_slope}, 0.0, starts, row, coefficient, ground_part,
                     data, out[k + 1])


@njit({inner_flags})
def channels(y, force, acceleration, ground, starts, row, coefficient, ground_part, data, out):
    n_links = int(data[0])
    for c in range(ground_part.shape[0]):
        total = ground_part[c] * ground
        for term in range(starts[c], starts[c + 1]):
            kind = row[term] // n_links
            link = row[term] - kind * n_links
            here = {head} + link * {block}
            if kind < 4:
                value = y[link * {n_rows} + kind]
            elif kind == 6:
                value = y[n_links * {n_rows}]
            elif kind == 4:
                value = data[here + force]
            else:
                value = data[here + acceleration]
            total += coefficient[term] * value
        out[c] = total
'''

RUNGE_KUTTA = '''

@njit({inner_flags})
def all_rates(y, ground, dy, data):
    """Rates of the state ``y[0]`` and of its derivatives ``y[1:]``."""
    rates(y[0], ground, dy[0], data)
    if y.shape[0] > 1:
        slopes(y[0], ground, data)
        for k in range(y.shape[0] - 1):
            direction(k, y[k + 1], dy[k + 1], data)


@njit({inner_flags})
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


@njit({inner_flags})
def plan(substeps, resolution, y, dy, data):
    """Length of the steps in the next interval."""
    dt = data[1]
    steps = float(substeps)
    for i in range(int(data[0])):
        base = i * {n_rows}
        here = {head} + i * {block}
{refine}{refine_base}
    return dt / steps


@njit({inner_flags})
def turned(h, y, dy, data):
    """The step h, or less where a drift rate is foretold to change sign inside it."""
    for i in range(int(data[0])):
        base = i * {n_rows}
{turn}
    return h


@njit({flags})
def run_rk4(substeps, resolution, starts, row, coefficient, ground_part, data, y, out):
    n_links, dt, n_times, n_directions = int(data[0]), data[1], int(data[2]), int(data[3])
    shape = (1 + n_directions, n_links * {n_rows} + {n_base_rows})
    dy, trial, total = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    before = np.zeros(shape[1])
    after = np.zeros(shape[1])
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
        length = plan(substeps[j], resolution, y[0], dy[0], data)
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
