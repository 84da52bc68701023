"""The text of a scalar kernel that is the same for every law; names in braces are filled by ``scalar_source``.

The law, its slopes and directions; events, the driven top and what is observed; the Runge-Kutta march.
What may stand here says :mod:`~bwbn_bayes.engines.kernel_compiler`.
"""

SIZES = """\
HEAD = {head}
BLOCK = {block}
ROWS = {n_rows}
BASE_ROWS = {n_base_rows}
DRIVEN = {driven}
WITH_TANGENTS = {with_tangents}
"""

LAW = """

def _exp2(x):
    return np.exp2(x)


def _log2(x):
    return np.log2(x)


def prepare(data: floats):
    # What the law needs that changes at events alone.
    for i in range(int(data[0])):
        here = HEAD + i * BLOCK
{prepare}


def gather(force, pull, data):
    # The links' forces on each node into row ``pull`` of its block; returns the force on what the building stands on.
    # Links pull down where they end and up where they begin.
    first = 0.0
    for i in range(int(data[0])):
        data[HEAD + i * BLOCK + pull] = 0.0
    for i in range(int(data[0])):
        here = HEAD + i * BLOCK
        lower = int(data[here + {lower}])
        data[HEAD + (int(data[here + {upper}]) - 1) * BLOCK + pull] -= data[here + force]
        if lower > 0:
            data[HEAD + (lower - 1) * BLOCK + pull] += data[here + force]
        else:
            first += data[here + force]
    return first


def part(below, acceleration, dy, data):
    # The rates of the drift rates, from the accelerations of the nodes and of what the building stands on.
    for i in range(int(data[0])):
        here = HEAD + i * BLOCK
        lower = int(data[here + {lower}])
        under = data[HEAD + (lower - 1) * BLOCK + acceleration] if lower > 0 else below
        dy[i * ROWS + 1] = {drift_rate_rate}


def compare(bending, y, data):
    # Into row ``bending`` of each link's block its drift less that of the one it runs on from and of those above.
    for i in range(int(data[0])):
        data[HEAD + i * BLOCK + bending] = 0.0
    for i in range(int(data[0])):
        below = int(data[HEAD + i * BLOCK + {runs_on_from}]) - 1
        if below >= 0:
            apart = y[i * ROWS] - y[below * ROWS]
            data[HEAD + i * BLOCK + bending] += apart
            data[HEAD + below * BLOCK + bending] -= apart


def rates(y: floats, ground: float, dy: floats, data: floats):
    n_links = int(data[0])
{bend}    for i in range(n_links):
        base = i * ROWS
        here = HEAD + i * BLOCK
{rates}
    net = gather({force}, {pull}, data)
{below}
    for i in range(n_links):
        base = i * ROWS
        here = HEAD + i * BLOCK
        net = data[here + {pull}] + data[here + {applied}]
{floor}
        data[here + {acceleration}] = acceleration
    part(below, {acceleration}, dy, data)


def slopes(y: floats, ground: float, data: floats):
    n_links = int(data[0])
{bend}    for i in range(n_links):
        base = i * ROWS
        here = HEAD + i * BLOCK
{slopes}
{around_slopes}


def direction(k: int, t: floats, dt_: floats, data: floats):
    # Derivative of the rates in direction k, once ``slopes`` has filled the table of partial derivatives.
    # In direction -1 the parameters stay as they are.
    n_links = int(data[0])
    n_directions = int(data[3])
{bend_slope}    for i in range(n_links):
        base = i * ROWS
        here = HEAD + i * BLOCK
{moved}
{chain}
    net = gather({force_slope}, {pull_slope}, data)
{below_slope}
    for i in range(n_links):
        base = i * ROWS
        here = HEAD + i * BLOCK
        net = data[here + {pull_slope}]
{floor_slope}
        data[here + {acceleration_slope}] = acceleration
    part(below, {acceleration_slope}, dt_, data)


def jacobian(y: floats, matrix: floats_2d, unit: floats, data: floats):
    # Derivative of the rates with respect to the states: ``matrix[column, row]``.
    slopes(y, 0.0, data)
    for row in range(y.shape[0]):
        unit[row] = 0.0
    for column in range(y.shape[0]):
        unit[column] = 1.0
        direction(-1, unit, matrix[column], data)
        unit[column] = 0.0


def ground_at(t: float, data: floats) -> float:
    # The ground acceleration at time t; forces from outside go to the blocks of their nodes.
    dt = data[1]
    n_times = int(data[2])
    o = HEAD + int(data[0]) * (BLOCK + int(data[3]))
    j = min(max(int(t / dt), 0), n_times - 2)
    for i in range(int(data[0])):
        here = HEAD + i * BLOCK
        m = o + int(data[here + {force_row}]) * n_times + j
        if m >= o + n_times:
            data[here + {applied}] = data[m] + (data[m + 1] - data[m]) * (t / dt - j)
    return data[o + j] + (data[o + j + 1] - data[o + j]) * (t / dt - j)


def rhs(y: floats, dy: floats, data: floats, t: float) -> int:
    # Rates at time t; returns 1 where one of them is not finite.
    rates(y, ground_at(t, data), dy, data)
    total = 0.0
    for row in range(dy.shape[0]):
        total += dy[row]
    return 0 if abs(total) < np.inf else 1
"""

EVENTS = """

def next_event(data: floats) -> float:
    # Time of the next event that has not happened, infinite where there is none.
    found = np.inf
    for i in range(int(data[0])):
        here = HEAD + i * BLOCK
{next_event}
    return found


def strike(until: float, ground: float, y: floats, tangents: floats_2d, before: floats, after: floats, data: floats):
    # Let the events that are due at ``until`` happen, one by one.
    # Each adds ``(rate before - rate after) d time / d parameter`` to the tangents; a time that several events share
    # collects all their terms.
    n_links = int(data[0])
    n_directions = tangents.shape[0]
    for i in range(n_links):
        here = HEAD + i * BLOCK
        seed = HEAD + n_links * BLOCK + i * n_directions
{strike}


def jump(tangent, before, after):
    for row in range(tangent.shape[0]):
        tangent[row] += before[row] - after[row]


def drive(y: floats, data: floats, j: int):
    # State of a driven specimen at sample j: the given displacement and the slope of the segment that begins.
    # The last sample keeps the slope of the segment that ends there.
    if DRIVEN:
        o = HEAD + int(data[0]) * (BLOCK + int(data[3]))
        ahead = min(j + 1, int(data[2]) - 1)
        y[0] = data[o + j]
        y[1] = (data[o + ahead] - data[o + ahead - 1]) / data[1]


def see(y: floats, starts: integers, row: integers, coefficient: floats, ground_part: floats, data: floats, out: floats,
        j: int):
    # Channels at a sample, from ``rates`` just evaluated.
    o = HEAD + int(data[0]) * (BLOCK + int(data[3]))
    channels(y, {force}, {acceleration}, data[o + j], starts, row, coefficient, ground_part, data, out)


def observe(y: floats, tangents: floats_2d, starts: integers, row: integers, coefficient: floats, ground_part: floats,
            data: floats, rate: floats, out: floats_2d, j: int):
    # Channels and their derivatives at a sample, ``out[direction + 1, channel]``, from ``rates`` just evaluated.
    see(y, starts, row, coefficient, ground_part, data, out[0], j)
    if WITH_TANGENTS:
        slopes(y, data[HEAD + int(data[0]) * (BLOCK + int(data[3])) + j], data)
        for k in range(int(data[3])):
            direction(k, tangents[k], rate, data)
            channels(tangents[k], {force_slope}, {acceleration_slope}, 0.0, starts, row, coefficient, ground_part,
                     data, out[k + 1])


def channels(y, force, acceleration, ground, starts, row, coefficient, ground_part, data, out):
    n_links = int(data[0])
    for c in range(ground_part.shape[0]):
        total = ground_part[c] * ground
        for term in range(starts[c], starts[c + 1]):
            kind = row[term] // n_links
            link = row[term] - kind * n_links
            here = HEAD + link * BLOCK
            if kind < 4:
                value = y[link * ROWS + kind]
            elif kind == 6:
                value = y[n_links * ROWS]
            elif kind == 4:
                value = data[here + force]
            else:
                value = data[here + acceleration]
            total += coefficient[term] * value
        out[c] = total
"""

RUNGE_KUTTA = """

def all_rates(y, ground, dy, data):
    # Rates of the state ``y[0]`` and of its derivatives ``y[1:]``.
    rates(y[0], ground, dy[0], data)
    if WITH_TANGENTS:
        slopes(y[0], ground, data)
        for k in range(y.shape[0] - 1):
            direction(k, y[k + 1], dy[k + 1], data)


def rk4(t, h, y, dy, trial, total, data):
    # One step from t to t + h; ``dy`` holds the rates at t and is overwritten.
    flat = np.ravel(y)
    rate = np.ravel(dy)
    ahead = np.ravel(trial)
    new = np.ravel(total)
    for r in range(flat.shape[0]):
        new[r] = flat[r] + h / 6.0 * rate[r]
        ahead[r] = flat[r] + 0.5 * h * rate[r]
    for stage in range(3):
        all_rates(trial, ground_at(t + h if stage == 2 else t + 0.5 * h, data), dy, data)
        if stage < 2:
            for r in range(flat.shape[0]):
                new[r] += h / 3.0 * rate[r]
                ahead[r] = flat[r] + (0.5 * h if stage == 0 else h) * rate[r]
    for r in range(flat.shape[0]):
        flat[r] = new[r] + h / 6.0 * rate[r]


def plan(substeps, resolution, y, dy, data):
    # Length of the steps in the next interval.
    dt = data[1]
    steps = float(substeps)
    for i in range(int(data[0])):
        base = i * ROWS
        here = HEAD + i * BLOCK
{refine}{refine_base}
    return dt / steps


def turned(h, y, dy, data):
    # The step h, or less where a drift rate is foretold to change sign inside it.
    for i in range(int(data[0])):
        base = i * ROWS
{turn}
    return h


def run_rk4(substeps: integers, resolution: float, starts: integers, row: integers, coefficient: floats,
            ground_part: floats, data: floats, y: floats_2d, dy: floats_2d, trial: floats_2d, total: floats_2d,
            out: floats_2d):
    dt = data[1]
    n_times = int(data[2])
    n_rows = 1 + int(data[3])
    tolerance = 1e-9 * dt
    prepare(data)
    strike(tolerance, 0.0, y[0], y[n_rows:], trial[0], total[0], data)
    event = next_event(data)
    for j in range(n_times):
        drive(y[0], data, j)
        all_rates(y, ground_at(j * dt, data), dy, data)
        observe(y[0], y[1:], starts, row, coefficient, ground_part, data, trial[0], out[j * n_rows:], j)
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
                strike(now + tolerance, ground_at(now, data), y[0], y[1:], trial[0], total[0], data)
                event = next_event(data)
            if dt - position > 1e-12 * dt:
                all_rates(y, ground_at(now, data), dy, data)
"""
