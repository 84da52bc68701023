"""The text of a lane kernel that is the same for every law; names in braces are filled by ``lane_source``.

Mathematics, a building's quantities before its first step, a stage of a Runge-Kutta scheme, and the march through time.
The march stands in a kernel twice, with derivatives (``_with_tangents``) and without: each compiles when first called.
Numbers are doubles or singles; times since the start, those of events and sums over samples are doubles in both.
What may stand here says :mod:`~bwbn_bayes.engines.kernel_compiler`.
"""

SIZES = """\
LANES = {lanes}
BLOCK = {block} * LANES
TANGENT_BLOCK = {tangent_block} * LANES
BITS = {bits}
# Shares of an interval between two samples, a few roundings of a sum of steps: a step that would leave less than NEAR
# goes on to the interval's end, an event that is less than NEAR ahead has come, and ARRIVED from the end is at it.
NEAR = {near}
ARRIVED = {arrived}
"""

MATHEMATICS = '''

def _exp2(x):
    """Two to the power x, to 2e-14 relative; the power's whole part is put together from bits."""
    x = -1021.0 if x < -1021.0 else x
    x = 1023.0 if x > 1023.0 else x
    k = np.rint(x)
    r = x - k
    p = 1.0150337260976417e-07
    p = p * r + 1.3259405611204192e-06
    p = p * r + 1.5252984835578367e-05
    p = p * r + 0.00015403434948081424
    p = p * r + 0.0013333557617609879
    p = p * r + 0.009618129192067202
    p = p * r + 0.05550410866868558
    p = p * r + 0.24022650695649653
    p = p * r + 0.693147180559871
    p = p * r + 1.0000000000000127
    return p * _from_bits(_bits(k + 4503599627371519.0) << 52)


def _log2(x):
    """Logarithm to base two of a positive number, to 3e-14; exponent and mantissa in [0.7, 1.4] are split by bits."""
    b = _bits(x)
    above = b - 0x3FE6A09E667F3BCD
    e = _from_bits((above >> 52) + 0x4338000000000000) - 6755399441055744.0
    m = _from_bits(b - (above & -0x10000000000000))
    s = (m - 1.0) / (m + 1.0)
    q = s * s
    p = 0.282899281459652
    p = p * q + 0.31990575510624353
    p = p * q + 0.4122092510534761
    p = p * q + 0.5770779423768015
    p = p * q + 0.9617966941133066
    p = p * q + 2.88539008177785
    return e + s * p
'''

SINGLE_MATHEMATICS = '''

def _exp2(x):
    """Two to the power x, to 1e-7 relative, not below 2**-100: products of smaller ones would leave singles."""
    x = -100.0 if x < -100.0 else x
    x = 127.0 if x > 127.0 else x
    k = np.rint(x)
    r = x - k
    p = 0.0001534581242594868
    p = p * r + 0.0013399930903688073
    p = p * r + 0.009618489071726799
    p = p * r + 0.05550328642129898
    p = p * r + 0.24022646248340607
    p = p * r + 0.6931471824645996
    p = p * r + 1.0
    return p * _from_bits(_bits(k + 8388735.0) << 23)


def _log2(x):
    """Logarithm to base two of a positive number, to 1e-7 or its last place, as that of doubles is found."""
    b = _bits(x)
    above = b - 0x3F3504F3
    m = _from_bits(b - (above & -0x800000))
    s = (m - 1.0) / (m + 1.0)
    q = s * s
    p = 0.43174800276756287
    p = p * q + 0.5767138600349426
    p = p * q + 0.9617988467216492
    p = p * q + 2.885390043258667
    return float(above >> 23) + s * p
'''

PREPARE = """

def prepare(n_links, w):
    # What the law needs that changes at events alone.
    for i in range(n_links):
        a = i * BLOCK
        for l in range(LANES):
{prepare}
"""

STAGE = """

def gather(first, seed, w):
    # The partial derivatives by what each lane's direction moves, as a column of the table.
    for r in range({n_rows}):
        row = first + r * {n_columns} * LANES
        for l in range(LANES):
            w[row + {own} * LANES + l] = w[row + seed[l] * LANES + l]


def handed_on(i, joints):
    # Whether the link before is all that pulls at the node of this one.
    return i > 0 and joints[i - 1, 2] < 0


def hold(a, u, sign, kept, rows):
    # A link's force pulls up at the node where it begins and down at the one where it ends.
    for l in range(LANES):
        pulled = kept * rows[u + {pull} * LANES + l]
        rows[u + {pull} * LANES + l] = pulled + sign * rows[a + {force} * LANES + l]


def between(a, b, u, rows):
    # The rate of a link's drift rate, once the accelerations of both its ends are known.
    for l in range(LANES):
        upper = rows[u + {acceleration} * LANES + l]
        rows[a + {acceleration_of_drift} * LANES + l] = upper - rows[b + {acceleration} * LANES + l]


def stage(n_links, n_directions, weight, share, inside, step, ground, joints, forced, seed, column, active, w, t):
    for f in range(forced.shape[0]):
        for l in range(LANES):
            w[forced[f] * BLOCK + {pull} * LANES + l] = ground[(f + 1) * LANES + l]
    for i in range(n_links):
        a = i * BLOCK
        p = a + {force} * LANES if handed_on(i, joints) else a + BLOCK + {pull} * LANES
{neighbour}{law}
        if joints[i, 2] >= 0:
            hold(a + BLOCK, joints[i, 0] * BLOCK, 1.0, float(joints[i, 2]), w)
        if joints[i, 1] != i + 1:
            hold(a + BLOCK, joints[i, 1] * BLOCK, -1.0, float(joints[i, 3]), w)
{base}
    for i in range(n_links):
        if joints[i, 0] != i + 2 or joints[i, 1] != i + 1:
            between((i + 1) * BLOCK, joints[i, 0] * BLOCK, joints[i, 1] * BLOCK, w)


def stage_with_tangents(n_links, n_directions, weight, share, inside, step, ground, joints, forced, seed, column,
                        active, w, t):
    for f in range(forced.shape[0]):
        for l in range(LANES):
            w[forced[f] * BLOCK + {pull} * LANES + l] = ground[(f + 1) * LANES + l]
        for k in range(n_directions):
            for l in range(LANES):
                t[(k * (n_links + 2) + forced[f]) * TANGENT_BLOCK + {pull} * LANES + l] = 0.0
    for i in range(n_links):
        a = i * BLOCK
        p = a + {force} * LANES if handed_on(i, joints) else a + BLOCK + {pull} * LANES
{neighbour}{tangent_law}
        if joints[i, 2] >= 0:
            hold(a + BLOCK, joints[i, 0] * BLOCK, 1.0, float(joints[i, 2]), w)
        if joints[i, 1] != i + 1:
            hold(a + BLOCK, joints[i, 1] * BLOCK, -1.0, float(joints[i, 3]), w)
        for k in range(n_directions):
            o = (k * (n_links + 2) + i) * TANGENT_BLOCK
            p = o + {force} * LANES if handed_on(i, joints) else o + TANGENT_BLOCK + {pull} * LANES
            m = k * n_links + i
            if column[m] == {own}:
                gather(a + BLOCK + {slope} * LANES, seed[m * LANES:], w)
            moved = w[a + column[m] * LANES:]
            moves = active[m * LANES:]
{tangent_neighbour}{chain}
            if joints[i, 2] >= 0:
                u = (k * (n_links + 2) + joints[i, 0]) * TANGENT_BLOCK
                hold(o + TANGENT_BLOCK, u, 1.0, float(joints[i, 2]), t)
            if joints[i, 1] != i + 1:
                u = (k * (n_links + 2) + joints[i, 1]) * TANGENT_BLOCK
                hold(o + TANGENT_BLOCK, u, -1.0, float(joints[i, 3]), t)
{tangent_base}
    for i in range(n_links):
        if joints[i, 0] != i + 2 or joints[i, 1] != i + 1:
            between((i + 1) * BLOCK, joints[i, 0] * BLOCK, joints[i, 1] * BLOCK, w)
            for k in range(n_directions):
                o = k * (n_links + 2) * TANGENT_BLOCK
                a = o + (i + 1) * TANGENT_BLOCK
                between(a, o + joints[i, 0] * TANGENT_BLOCK, o + joints[i, 1] * TANGENT_BLOCK, t)
"""

ON_GROUND = """\
    a = n_links * BLOCK
    for l in range(LANES):
        w[a + BLOCK + {acceleration} * LANES + l] = ground[l]
        w[a + {acceleration_of_drift} * LANES + l] = {ground_drift}"""

ON_GROUND_TANGENT = (
    ON_GROUND
    + """
    for k in range(n_directions):
        o = (k * (n_links + 2) + n_links) * TANGENT_BLOCK
        for l in range(LANES):
            acceleration = t[o + {acceleration} * LANES + l]
            t[o + {acceleration_of_drift} * LANES + l] = {ground_drift_tangent}"""
)

ON_BASE = """\
    a = n_links * BLOCK
    p = a + {force} * LANES if handed_on(n_links, joints) else a + BLOCK + {pull} * LANES
    for l in range(LANES):
{base_law}"""

ON_BASE_TANGENT = (
    ON_BASE
    + """
    for k in range(n_directions):
        o = (k * (n_links + 2) + n_links) * TANGENT_BLOCK
        p = o + {force} * LANES if handed_on(n_links, joints) else o + TANGENT_BLOCK + {pull} * LANES
        m = (k + 1) * n_links - 1
        if column[m] == {own}:
            gather(a + BLOCK + {slope} * LANES, seed[m * LANES:], w)
        moved = w[a + column[m] * LANES:]
        moves = active[m * LANES:]
        for l in range(LANES):
{base_chain}"""
)

COMMON = """

def drive(now, slope, share, position, step, ground):
    # What drives each lane at a share of its step.
    for r in range(now.shape[0]):
        g = r * LANES
        first = now[r]
        rise = slope[r]
        for l in range(LANES):
            elapsed = position[l] + share * step[l]
            ground[g + l] = first + rise * elapsed


def plan(n_links, dt, substeps, resolution, length, w):
    # Length of each lane's steps in the next interval.
    for l in range(LANES):
        length[l] = substeps
    for i in range(n_links):
        a = i * BLOCK
{refine}{refine_base}
    for l in range(LANES):
        length[l] = dt / length[l]


def next_step(n_links, dt, cut, start, event, times, position, length, step, w):
    # The next step of each lane, zero where it has arrived; returns whether every lane then is at the interval's end.
    for l in range(LANES):
        remaining = dt - position[l]
        h = length[l]
        h = remaining if remaining - h < NEAR * dt else h
        step[l] = h if remaining > ARRIVED * dt else 0.0
    if cut:
        for i in range(n_links):
            a = i * BLOCK
{turn}
    if event < start + dt:
        for i in range(n_links):
            a = i * BLOCK
            for l in range(LANES):
{limit}
    left = 0.0
    for l in range(LANES):
        left += 1.0 if dt - position[l] - step[l] > ARRIVED * dt else 0.0
    return left == 0.0


def next_event(n_links, times, w):
    found = double(np.inf)
    for i in range(n_links):
        a = i * BLOCK
        for l in range(LANES):
{next_event}
    return found


def observe(n_links, n_directions, starts, block, row, coefficient, ground_part, ground_now, w, t, value):
    n_channels = ground_part.shape[0]
    for k in range(n_directions + 1):
        for c in range(n_channels):
            m = (k * n_channels + c) * LANES
            offset = ground_part[c] * ground_now if k == 0 else 0.0
            for l in range(LANES):
                value[m + l] = offset
            for term in range(starts[c], starts[c + 1]):
                factor = coefficient[term]
                if k == 0:
                    observed = w[block[term] * BLOCK + row[term] * LANES:]
                else:
                    observed = t[((k - 1) * (n_links + 2) + block[term]) * TANGENT_BLOCK + row[term] * LANES:]
                for l in range(LANES):
                    value[m + l] += factor * observed[l]
"""

SUMS = """

def accumulate(n_channels, n_directions, j, measured, value, misfit, gram):
    for c in range(n_channels):
        o = c * LANES
        now = measured[c, j]
        for l in range(LANES):
            value[o + l] = now - value[o + l]
            misfit[o + l] += value[o + l] * value[o + l]
        g = c * (n_directions * (n_directions + 3) // 2) * LANES
        for a in range(1, n_directions + 1):
            left = (a * n_channels + c) * LANES
            for b in range(a + 1):
                right = (b * n_channels + c) * LANES
                for l in range(LANES):
                    gram[g + l] += value[left + l] * value[right + l]
                g += LANES
"""

SUMMARY = """

def summarise(n_channels: int, n_directions: int, n_parts: int, measured: floats_2d, stored: floats, width: int,
              source: integers, gram: doubles, value: floats):
    # What ``run`` sums when it does not store, from what it stored, ``width`` numbers a sample, of one draw: its
    # residual and derivatives stand where ``run`` has draws, in parts of as many as there are lanes.
    for j in range(measured.shape[1]):
        for c in range(n_channels):
            first = c * n_parts * LANES
            for r in range(n_directions + 1):
                value[r] = stored[j * width + source[first + r]] if source[first + r] >= 0 else 0.0
            value[0] = measured[c, j] - value[0]
            for a in range(n_directions + 1):
                g = (c * (n_directions + 1) + a) * n_parts * LANES
                left = value[a]
                for k in range(n_parts):
                    o = k * LANES
                    if o <= a:
                        for l in range(LANES):
                            gram[g + o + l] += left * value[o + l]
"""

MARCH = """

def advance{tangents}(n_links, n_directions, shares, weights, now, slope, position, step, ground, joints, forced, seed,
                      column, active, w, t):
    # One step of every lane's own length, and the rates at its end.
    for s in range(shares.shape[0]):
        drive(now, slope, shares[s], position, step, ground)
        stage{tangents}(n_links, n_directions, weights[s], shares[s], 1.0, step, ground, joints, forced, seed, column,
                        active, w, t)
    for l in range(LANES):
        position[l] += step[l]
    drive(now, slope, 0.0, position, step, ground)
    close{tangents}(n_links, n_directions, weights[shares.shape[0]], step, ground, joints, forced, seed, column, active,
                    w, t)


def close{tangents}(n_links, n_directions, weight, step, ground, joints, forced, seed, column, active, w, t):
    stage{tangents}(n_links, n_directions, weight, 0.0, 0.0, step, ground, joints, forced, seed, column, active, w, t)


def strike{tangents}(n_links, n_directions, dt, start, times, position, step, flipped, ground, joints, forced, seed,
                     column, active, w, t):
    # Events that are due happen one by one; each adds (rate before - rate after) d time / d parameter to the tangents.
    for i in range(n_links):
        a = i * BLOCK
{strike}


def flip{tangents}(n_links, n_directions, link, event, time, step, flipped, ground, joints, forced, seed, column,
                   active, w, t):
    for l in range(LANES):
        step[l] = 0.0
    for i in range({n_blocks}):
        a = (i + 1) * BLOCK
        for r in range({n_states} * LANES):
            w[a + {before} * LANES + r] = w[a + {n_states} * LANES + r]
    a = (link + 1) * BLOCK + ({happened} + event) * LANES
    for l in range(LANES):
        w[a + l] += flipped[l]
    prepare(n_links, w)
    close{tangents}(n_links, n_directions, 0.0, step, ground, joints, forced, seed, column, active, w, t)
    for k in range(n_directions):
        moved = seed[(k * n_links + link) * LANES:]
        hit = 0.0
        for l in range(LANES):
            hit += 1.0 if moved[l] == time else 0.0
        if hit > 0.0:
            for i in range({n_blocks}):
                a = (i + 1) * BLOCK
                o = (k * (n_links + 2) + i + 1) * TANGENT_BLOCK
                for r in range({n_states}):
                    b = a + r * LANES
                    m = o + r * LANES
                    for l in range(LANES):
                        own = flipped[l] if moved[l] == time else 0.0
                        jump = own * (w[b + {before} * LANES + l] - w[b + {n_states} * LANES + l])
                        t[m + l] += jump
                        t[m + {n_states2} * LANES + l] += jump
    if n_directions > 0:
        close{tangents}(n_links, n_directions, 0.0, step, ground, joints, forced, seed, column, active, w, t)


def run{tangents}(n_links: int, n_directions: int, interval: double, times: doubles, excitation: floats_2d,
                  joints: integers_2d, forced: integers, w: floats, t: floats, seed: integers, column: integers,
                  active: floats, shares: floats, weights: floats, substeps: integers, resolution: float, cut: bool,
                  starts: integers, block: integers, row: integers, coefficient: floats, ground_part: floats,
                  measured: floats_2d, misfit: doubles, gram: doubles, store: bool, stored: floats, value: floats,
                  ground: floats, room: floats):
    dt = float(interval)
    n_times = excitation.shape[0]
    n_channels = ground_part.shape[0]
    n_inputs = excitation.shape[1]
    position = room[0:]
    length = room[LANES:]
    step = room[2 * LANES:]
    flipped = room[3 * LANES:]
    slope = room[4 * LANES:]
    for r in range(n_inputs):
        for l in range(LANES):
            ground[r * LANES + l] = excitation[0, r]
    prepare(n_links, w)
    start = double(0.0)
    strike{tangents}(n_links, 0, dt, start, times, position, step, flipped, ground, joints, forced, seed, column,
                     active, w, t)
    event = next_event(n_links, times, w)
    close{tangents}(n_links, n_directions, 0.0, step, ground, joints, forced, seed, column, active, w, t)
    for j in range(n_times):
        now = excitation[j]
        ahead = min(j + 1, n_times - 1)
        for r in range(n_inputs):
            slope[r] = (excitation[ahead, r] - excitation[ahead - 1, r]) / dt
{drive}
        observe(n_links, n_directions, starts, block, row, coefficient, ground_part, now[0], w, t, value)
        if store:
            o = j * n_channels * (n_directions + 1) * LANES
            for r in range(n_channels * (n_directions + 1) * LANES):
                stored[o + r] = value[r]
        else:
            accumulate(n_channels, n_directions, j, measured, value, misfit, gram)
        if j + 1 == n_times:
            break
        for l in range(LANES):
            position[l] = 0.0
        start = j * interval
        plan(n_links, dt, substeps[j], resolution, length, w)
        arrived = False
        while not arrived:
            arrived = next_step(n_links, dt, cut, start, event, times, position, length, step, w)
            advance{tangents}(n_links, n_directions, shares, weights, now, slope, position, step, ground, joints,
                              forced, seed, column, active, w, t)
            if event < start + dt * (1.0 + NEAR):
                strike{tangents}(n_links, n_directions, dt, start, times, position, step, flipped, ground, joints,
                                 forced, seed, column, active, w, t)
                event = next_event(n_links, times, w)
"""
