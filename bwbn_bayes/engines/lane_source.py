"""The source of a lane kernel: sixteen draws advance together, one per lane of flat arrays.

A row is ``LANES`` numbers, one per draw, so that the innermost loops vectorise. All that a link needs stands in one
block of rows of the array ``w``, and with it the node that the link carries. Blocks run down: an empty one, links that
carry no node, the others from the roof down, the ground, which holds the states of the base where there is one.
Which nodes a link joins is data (``joints``, one row for each link): the block of the node that it stands on, that of
the node where it ends, and for both whether the node has been pulled at in this stage already. The link that carries a
node comes after all others that join it, so that one sweep finds all accelerations. Forces are gathered in the node's
``pull``, but for one that is alone there and stands in the block before, as in a chain: it is read where it stands, and
-1 says so. The fifth number is the block of the link that it runs on from, or 0: where forces depend on how much a
storey drifts beyond its neighbours, a link tells the one below in its row ``bending``, which is read and emptied there.
The sixth says whether nothing acts on the link but its element: then it is solved as if the law had nothing else.
The distance between rows is a constant, so that the compiler needs no check for overlap. Derivatives stand in ``t``,
one building of smaller blocks per direction. Each stage of a Runge-Kutta scheme uses the rates of the stage before
only: state ``y + share * step * rate``, result ``y + sum(weight * step * rate)``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.elements.law import (
    BENDING_DRIFT,
    DRIFT,
    DRIFT_RATE,
    NET_FORCE,
    RECORDED_ACCELERATION,
    TIME,
    StoreyLaw,
)
from bwbn_bayes.engines.codegen import INPUT_NAMES, INVERSE_MASS, OFFSET, LawPrograms, Part, Program, print_expression
from bwbn_bayes.engines.lane_template import (
    COMMON,
    MARCH,
    MATHEMATICS,
    ON_BASE,
    ON_BASE_TANGENT,
    ON_GROUND,
    ON_GROUND_TANGENT,
    PREPARE,
    SINGLE_MATHEMATICS,
    SIZES,
    STAGE,
    SUMMARY,
    SUMS,
)
from bwbn_bayes.engines.step_rules import MARGIN, MOST_STEPS, REACH, has_kink

LANES = 16
WITH_TANGENTS = "_with_tangents"
"""How the names of functions end that carry derivatives."""


@dataclass(frozen=True, kw_only=True)
class LaneLayout:
    """Rows of a storey's block in ``w``; the rows up to and including ``bending`` open its block in ``t`` too.

    Attributes
    ----------
    n_states : int
        States of a storey; they come first, then their rates, then the sum of the scheme's stages.
    n_columns : int
        Columns of the table of partial derivatives: the law's variables, one of zeros (``nowhere``), and one for what
        the lanes of a direction move where that differs (``own``).
    force, acceleration, pull, bending, inverse_mass, parameters, derived, happened, sharpness, before, slope : int
        First row of each kind; ``pull`` is the force on the node but for its own link's; ``bending`` is ``pull`` where
        forces do not depend on other drifts; ``sharpness`` is one over the width of each sharp feature.
    block : int
        Rows of a block of ``w``.
    """

    n_states: int
    n_columns: int
    force: int
    acceleration: int
    pull: int
    bending: int
    inverse_mass: int
    parameters: int
    derived: int
    happened: int
    sharpness: int
    before: int
    slope: int
    block: int

    @property
    def nowhere(self) -> int:
        """Column of zeros."""
        return self.n_columns - 2

    @property
    def own(self) -> int:
        """Column of what the lanes of a direction move, where that differs."""
        return self.n_columns - 1

    @property
    def tangent_block(self) -> int:
        """Rows of a block of ``t``."""
        return self.bending + 1

    def observed(self, kind: NDArray[np.int64]) -> NDArray[np.int64]:
        """Row of each observed kind, numbered as in :data:`~bwbn_bayes.engines.base.OBSERVED_KINDS`.

        One more is the displacement of the base, in the ground's block.
        """
        return np.array([0, 1, 2, 3, self.force, self.acceleration, 0])[kind]


def lane_layout(law: StoreyLaw, programs: LawPrograms) -> LaneLayout:
    """Lay out the rows of one storey law."""
    n_states = 2 + len(law.states)
    pull = 3 * n_states + 2
    bending = pull if programs.bending is None else pull + 1
    parameters = bending + 2
    derived = parameters + len(law.parameters)
    happened = derived + (programs.bare or programs.parts[-1]).end
    sharpness = happened + len(law.events)
    before = sharpness + len(law.sharp_features)
    n_columns = len(programs.variables) + 2
    return LaneLayout(
        n_states=n_states,
        n_columns=n_columns,
        force=3 * n_states,
        acceleration=3 * n_states + 1,
        pull=pull,
        bending=bending,
        inverse_mass=bending + 1,
        parameters=parameters,
        derived=derived,
        happened=happened,
        sharpness=sharpness,
        before=before,
        slope=before + n_states,
        block=before + n_states + programs.n_rows * n_columns,
    )


def lane_source(
    law: StoreyLaw,
    programs: LawPrograms,
    *,
    driven: bool,
    single: bool = False,
    lanes: int = LANES,
    block: int | None = None,
) -> str:
    """Source of the kernel module of one storey law.

    Parameters
    ----------
    law : StoreyLaw
        The law; its parameters set the rows of a block.
    programs : LawPrograms
        The law as straight-line code.
    driven : bool
        True for a specimen whose displacement is given, False for a base-excited building.
    single : bool
        Whether it computes with numbers of 32 bits.
    lanes : int
        Draws that advance together.
    block : int, optional
        Rows of a block of ``w``, all of them where left out; what marches without derivatives does with those before
        ``slope``.
    """
    place = lane_layout(law, programs)
    n, bare = place.n_states, None if driven else programs.bare
    fields: dict[str, object] = {
        "lanes": lanes,
        "bits": 32 if single else 64,
        "near": 1e-5 if single else 1e-9,
        "arrived": 1e-6 if single else 1e-12,
        "block": place.block if block is None else block,
        "tangent_block": place.tangent_block,
        "n_states": n,
        "n_states2": 2 * n,
        "n_rows": programs.n_rows,
        "n_columns": place.n_columns,
        "own": place.own,
        "slope": place.slope,
        "before": place.before,
        "happened": place.happened,
        "force": place.force,
        "acceleration": place.acceleration,
        "pull": place.pull,
        "prepare": _prepare(law, programs, place, bare),
        "n_blocks": "n_links + 1" if law.base_states else "n_links",
        "acceleration_of_drift": n + 1,
        "ground_drift": "0.0" if driven else f"w[a + {place.acceleration} * LANES + l] - ground[l]",
        "ground_drift_tangent": "0.0" if driven else "acceleration",
        "refine": _refine(law, place),
        "refine_base": _refine_base(law, place),
        "turn": _turn(law, place),
        "limit": _indent(_limit(law, place), 4),
        "next_event": _indent(_next_event(law, place), 3),
    }
    stages = STAGE.format(
        law=_where_bare(partial(_law, law, programs, place, with_slopes=False), bare, 2),
        tangent_law=_where_bare(partial(_law, law, programs, place, with_slopes=True), bare, 2),
        chain=_where_bare(partial(_chain, law, programs, place), bare, 3),
        **_neighbours(programs),
        base=_base(law, programs, place, fields, with_slopes=False),
        tangent_base=_base(law, programs, place, fields, with_slopes=True),
        **fields,
    )
    marches = [
        MARCH.format(
            tangents=suffix,
            strike=_indent(_strike(law, place, suffix), 2),
            drive=_indent(_drive(place, suffix), 2) if driven else "",
            **fields,
        )
        for suffix in ("", WITH_TANGENTS)
    ]
    opening = SIZES.format(**fields) + (SINGLE_MATHEMATICS if single else MATHEMATICS)
    whole = "".join([opening, PREPARE.format(**fields), stages, COMMON.format(**fields), SUMS, *marches])
    return whole.replace(OFFSET, _SINGLE_OFFSET) if single else whole


_SINGLE_OFFSET = "1e-20"
"""What singles have room for: ``|x|^n / |x|`` at zero is 1e-10 for n = 1.5 and finite for n > -0.9."""


def summary_source(*, single: bool) -> str:
    """Source of the kernel that sums what was stored, the same for every law."""
    return f"LANES = {LANES}\nBITS = {32 if single else 64}\n{SUMS}{SUMMARY}"


_HEAD = (
    "rate = step[l] * {array}[{rate}]",
    "summed = {array}[{total}] + weight * rate",
    "{array}[{total}] = summed",
    "{name} = inside * ({array}[{state}] + share * rate) + (1.0 - inside) * summed",
    "{array}[{state}] = inside * {array}[{state}] + (1.0 - inside) * summed",
)
"""A state at a stage; the rates of the stage before join the sum, which is the state at the step's end.

``inside`` is 1 before the end and 0 at it: one function for both, since the law in it takes seconds to compile.
"""


def _used(names: list[str], lines: list[str]) -> list[str]:
    words = set(re.findall(r"[A-Za-z_]\w*", "\n".join(lines)))
    return [name for name in names if name in words]


def _indent(lines: list[str], depth: int) -> str:
    return "\n".join(" " * 4 * depth + line for line in lines or ["pass"])


def _where_bare(lines: Callable[[Part | None], list[str]], bare: Part | None, depth: int) -> str:
    """Lines for every lane: what is left of them where nothing acts on a link but its element, and the whole."""

    def of(part: Part | None, depth: int) -> str:
        return f"{' ' * 4 * depth}for l in range(LANES):\n{_indent(lines(part), depth + 1)}"

    if bare is None:
        return of(None, depth)
    is_bare, other = (_indent([line], depth) for line in ("if joints[i, 5] > 0:", "else:"))
    return "\n".join([is_bare, of(bare, depth + 1), other, of(None, depth + 1)])


def _rows(law: StoreyLaw, bare: Part | None) -> dict[str, int]:
    """Rows of a link's states; where nothing acts on it but its element, those of the element and the floor."""
    own = (DRIFT, DRIFT_RATE, *law.states)
    idle = () if bare is None else law.states[len(bare.rows) - 1 : law.n_storey_states]
    return {str(state): row for row, state in enumerate(own) if state not in idle}


def _states(names: Mapping[str, int], array: str, first: str, place: LaneLayout) -> list[str]:
    n = place.n_states
    return [
        line.format(
            name=name,
            array=array,
            state=f"{first} + {r} * LANES + l",
            rate=f"{first} + {n + r} * LANES + l",
            total=f"{first} + {2 * n + r} * LANES + l",
        )
        for name, r in names.items()
        for line in _HEAD
    ]


def _constants(
    law: StoreyLaw, program: Program, place: LaneLayout, first_derived: int, lines: list[str], block: str = "a + BLOCK"
) -> list[str]:
    """Lines that load the parameters, hoisted values and event indicators that the given lines use."""
    rows = {str(s): place.parameters + i for i, s in enumerate(law.symbols)}
    rows |= {name: place.derived + first_derived + i for i, (name, _) in enumerate(program.hoisted)}
    rows |= {str(event.indicator): place.happened + i for i, event in enumerate(law.events)}
    rows |= {str(INVERSE_MASS): place.inverse_mass}
    return [f"{name} = w[{block} + {rows[name]} * LANES + l]" for name in _used(list(rows), lines)]


def _code(
    law: StoreyLaw,
    part: Part,
    place: LaneLayout,
    outputs: list[str],
    end: list[str],
    block: str = "a + BLOCK",
    *,
    with_slopes: bool,
) -> list[str]:
    """A part of a law: its lines, what becomes of its outputs (``target = {}``), then its partial derivatives."""
    program, first = (part.tangent, part.first_tangent) if with_slopes else (part.rates, part.first_rates)
    body = [f"{name} = {source}" for name, source in program.lines]
    body += [line.format(source) for line, source in zip(outputs, program.outputs[: len(part.rows)], strict=True)]
    body += end
    lines = _constants(law, program, place, first, body, block) + body
    return lines + (_slopes(law, part, place, block) if with_slopes else [])


def _neighbours(programs: LawPrograms) -> dict[str, str]:
    """Lines that say which link the one at hand runs on from, where a force depends on it."""
    if programs.bending is None:
        return {"neighbour": "", "tangent_neighbour": ""}
    lines = ["b = joints[i, 4] * BLOCK", "runs_on = 1.0 if joints[i, 4] > 0 else 0.0"]
    return {
        "neighbour": _indent(lines, 2) + "\n",
        "tangent_neighbour": _indent(["b = (k * (n_links + 2) + joints[i, 4]) * TANGENT_BLOCK"], 3) + "\n",
    }


def _bending(place: LaneLayout, array: str, own: str, drift: str) -> list[str]:
    """A link's drift beyond its neighbours'; the one below, whose turn comes later, is told.

    The drift below is what ``_HEAD`` will make of it.
    """
    n, row = place.n_states, f"{place.bending} * LANES + l"
    return [
        f"rate = step[l] * {array}[b + {n} * LANES + l]",
        f"below = inside * ({array}[b + l] + share * rate)",
        f"below = below + (1.0 - inside) * ({array}[b + {2 * n} * LANES + l] + weight * rate)",
        f"apart = runs_on * ({drift} - below)",
        f"{INPUT_NAMES[BENDING_DRIFT]} = apart - {array}[{own} + {row}]",
        f"{array}[{own} + {row}] = 0.0",
        f"{array}[b + {row}] = {array}[b + {row}] + apart",
    ]


def _law(
    law: StoreyLaw, programs: LawPrograms, place: LaneLayout, bare: Part | None, *, with_slopes: bool
) -> list[str]:
    """Rates of one link but for its drift rate's, and the acceleration of the node that it carries."""
    part = bare or programs.storey
    rates = [f"w[a + BLOCK + {place.n_states + 2 + i} * LANES + l] = {{}}" for i in range(len(law.states))]
    own = [
        f"w[a + BLOCK + {place.n_states} * LANES + l] = v",
        f"w[a + BLOCK + {place.force} * LANES + l] = force",
    ]
    net = "w[p + l] - force"
    plain = f"acceleration = ({net}) * w[a + BLOCK + {place.inverse_mass} * LANES + l]"
    joined = [
        f"w[a + BLOCK + {place.acceleration} * LANES + l] = acceleration",
        f"w[a + {place.n_states + 1} * LANES + l] = w[a + {place.acceleration} * LANES + l] - acceleration",
    ]
    storey = ["force = {}", *rates[: len(part.rows) - 1]]
    end = own if programs.floor is not None else [*own, plain, *joined]
    lines = _states(_rows(law, bare), "w", "a + BLOCK", place)
    if programs.bending is not None:
        lines += _bending(place, "w", "a + BLOCK", str(DRIFT))
    lines += _code(law, part, place, storey, end, with_slopes=with_slopes)
    if programs.floor is not None:
        lines += [f"{INPUT_NAMES[NET_FORCE]} = {net}", _RECORDED]
        floor = ["acceleration = {}", *rates[law.n_storey_states :]]
        lines += _code(law, programs.floor, place, floor, joined, with_slopes=with_slopes)
    return lines


_RECORDED = f"{INPUT_NAMES[RECORDED_ACCELERATION]} = ground[l]"


def _base(
    law: StoreyLaw,
    programs: LawPrograms,
    place: LaneLayout,
    fields: dict[str, object],
    *,
    with_slopes: bool,
) -> str:
    """The acceleration of what the building stands on."""
    if programs.base is None:
        return (ON_GROUND_TANGENT if with_slopes else ON_GROUND).format(**fields)
    n, base_states = place.n_states, {str(s): row for row, s in enumerate(law.base_states)}
    lines = _states(base_states, "w", "a + BLOCK", place)
    lines += [f"{INPUT_NAMES[NET_FORCE]} = w[p + l]", _RECORDED]
    rates = [f"w[a + BLOCK + {n + r} * LANES + l] = {{}}" for r in range(len(base_states))]
    end = [
        f"w[a + BLOCK + {place.acceleration} * LANES + l] = below",
        f"w[a + {n + 1} * LANES + l] = w[a + {place.acceleration} * LANES + l] - below",
    ]
    lines += _code(law, programs.base, place, ["below = {}", *rates], end, "a", with_slopes=with_slopes)
    chain = _states({f"t{r}": r for r in range(len(base_states))}, "t", "o + TANGENT_BLOCK", place)
    tangents = {r: f"t{r}" for r in range(len(base_states))}
    tangents[len(programs.variables) - 1] = "net"
    chain += ["net = t[p + l]"]
    chain += [f"below = {_slope(programs.base, 0, place, tangents)}"]
    chain += [
        f"t[o + TANGENT_BLOCK + {n + r} * LANES + l] = {_slope(programs.base, 1 + r, place, tangents)}"
        for r in range(len(base_states))
    ]
    chain += [f"t[o + TANGENT_BLOCK + {place.acceleration} * LANES + l] = below"]
    chain += [f"t[o + {n + 1} * LANES + l] = t[o + {place.acceleration} * LANES + l] - below"]
    template = ON_BASE_TANGENT if with_slopes else ON_BASE
    return template.format(base_law=_indent(lines, 2), base_chain=_indent(chain, 3), **fields)


def _prepare(law: StoreyLaw, programs: LawPrograms, place: LaneLayout, bare: Part | None) -> str:
    lines: list[str] = []
    for part in (*programs.parts, *([] if bare is None else [bare])):
        for program, first in ((part.rates, part.first_rates), (part.tangent, part.first_tangent)):
            lines += _constants(law, program, place, first, [source for _, source in program.hoisted])
            for position, (name, source) in enumerate(program.hoisted):
                row = place.derived + first + position
                lines += [f"{name} = {source}", f"w[a + BLOCK + {row} * LANES + l] = {name}"]
    for position, feature in enumerate(law.sharp_features):
        width = print_expression(feature.width)
        lines += _constants(law, programs.storey.rates, place, 0, [width])
        lines.append(f"w[a + BLOCK + {place.sharpness + position} * LANES + l] = 1.0 / ({width})")
    return _indent(lines, 3)


def _slopes(law: StoreyLaw, part: Part, place: LaneLayout, block: str) -> list[str]:
    lines = [
        f"w[a + BLOCK + {place.slope + output * place.n_columns + variable} * LANES + l] = {source}"
        for (output, variable), source in zip(part.partials, part.slopes, strict=True)
    ]
    return _constants(law, part.tangent, place, part.first_tangent, lines, block) + lines


def _slope(part: Part, row: int, place: LaneLayout, tangents: dict[int, str]) -> str:
    """Derivative of one output in the direction at hand, given those of the variables it is a function of."""
    first = place.slope + row * place.n_columns
    terms = [f"moves[l] * moved[BLOCK + {first} * LANES + l]"]
    terms += [
        f"w[a + BLOCK + {first + variable} * LANES + l] * {tangents[variable]}"
        for output, variable in part.partials
        if output == row and variable in tangents
    ]
    return " + ".join(terms)


def _chain(law: StoreyLaw, programs: LawPrograms, place: LaneLayout, bare: Part | None) -> list[str]:
    """Rates of a direction's tangents at one link, as :func:`_law` has those of the states."""
    n, part = place.n_states, bare or programs.storey
    tangents = {r: f"t{r}" for r in _rows(law, bare).values()}
    lines = _states({name: r for r, name in tangents.items()}, "t", "o + TANGENT_BLOCK", place)
    if programs.bending is not None:
        lines += _bending(place, "t", "o + TANGENT_BLOCK", "t0")
        tangents[programs.bending] = INPUT_NAMES[BENDING_DRIFT]
    targets = [
        "force",
        *(f"t[o + TANGENT_BLOCK + {n + 1 + row} * LANES + l]" for row in range(1, n - 1)),
        "acceleration",
    ]
    lines += [f"{targets[row]} = {_slope(part, row, place, tangents)}" for row in part.rows]
    lines += [
        f"t[o + TANGENT_BLOCK + {n} * LANES + l] = t1",
        f"t[o + TANGENT_BLOCK + {place.force} * LANES + l] = force",
    ]
    lines.append("net = t[p + l] - force")
    if programs.floor is None:
        lines.append(f"acceleration = net * w[a + BLOCK + {place.inverse_mass} * LANES + l]")
    else:
        tangents[len(programs.variables) - 1] = "net"
        lines += [f"{targets[row]} = {_slope(programs.floor, row, place, tangents)}" for row in programs.floor.rows]
    lines += [
        f"t[o + TANGENT_BLOCK + {place.acceleration} * LANES + l] = acceleration",
        f"t[o + {n + 1} * LANES + l] = t[o + {place.acceleration} * LANES + l] - acceleration",
    ]
    return lines


def _refine(law: StoreyLaw, place: LaneLayout) -> str:
    names = [str(s) for s in (DRIFT, DRIFT_RATE, *law.states)]
    lines = []
    for position, feature in enumerate(law.sharp_features):
        if feature.state in law.base_states:
            continue
        if feature.state == TIME:
            lines += _needed(place, position, "a", "dt") + _MORE
            continue
        state = names.index(str(feature.state))
        lines += _needed(place, position, "a", _travel(f"a + BLOCK + {place.n_states + state} * LANES"))
        if not feature.everywhere:
            lines += [
                f"        distance = abs(w[a + BLOCK + {state} * LANES + l]) * sharpness",
                f"        needed = needed if distance < change + {REACH} else 1.0",
            ]
        lines += _MORE
    if not lines:
        return ""
    return _indent(["if resolution > 0.0:", "    for l in range(LANES):", *lines], 2)


def _refine_base(law: StoreyLaw, place: LaneLayout) -> str:
    """The same of what the base has, whose widths stand in every link's block."""
    names = [str(s) for s in law.base_states]
    lines = []
    for position, feature in enumerate(law.sharp_features):
        if feature.state in law.base_states:
            rate = place.n_states + names.index(str(feature.state))
            lines += _needed(place, position, "b", _travel(f"a + BLOCK + {rate} * LANES")) + _MORE
    if not lines:
        return ""
    blocks = ["a = n_links * BLOCK", "b = 0"]
    return "\n" + _indent([*blocks, "if resolution > 0.0:", "    for l in range(LANES):", *lines], 1)


def _travel(rate: str) -> str:
    """By how much a state with this rate moves between samples."""
    return f"abs(w[{rate} + l]) * dt"


def _needed(place: LaneLayout, position: int, block: str, travel: str) -> list[str]:
    """Steps that a sharp feature asks for."""
    return [
        f"        sharpness = w[{block} + BLOCK + {place.sharpness + position} * LANES + l]",
        f"        change = {travel} * sharpness",
        "        needed = np.ceil(change / resolution)",
    ]


_MORE = [
    f"        needed = needed if needed < {MOST_STEPS} else {MOST_STEPS}",
    "        length[l] = length[l] if length[l] > needed else needed",
]


def _turn(law: StoreyLaw, place: LaneLayout) -> str:
    if not has_kink(law, DRIFT_RATE):
        return _indent(["pass"], 3)
    row = f"w[a + BLOCK + {place.n_states + 1} * LANES + l]"
    lines = [
        "turning = 0.0",
        "for l in range(LANES):",
        f"    ahead = w[a + BLOCK + LANES + l] + step[l] * {row}",
        "    turning += 1.0 if ahead * w[a + BLOCK + LANES + l] < 0.0 else 0.0",
        "if turning > 0.0:",
        "    for l in range(LANES):",
        f"        until = -w[a + BLOCK + LANES + l] / {row}",
        f"        turns = until > {MARGIN} * step[l] and until < {1.0 - MARGIN} * step[l]",
        "        step[l] = until if turns else step[l]",
    ]
    return _indent(lines, 3)


def _until(law: StoreyLaw, number: int) -> str:
    """From where a lane is until an event: singles would round times since the start to a share of a step."""
    return f"float(times[(i * {len(law.events)} + {number}) * LANES + l] - start) - position[l]"


def _limit(law: StoreyLaw, place: LaneLayout) -> list[str]:
    lines = []
    for number in range(len(law.events)):
        lines += [
            f"until = {_until(law, number)}",
            f"pending = w[a + BLOCK + {place.happened + number} * LANES + l] == 0.0",
            "step[l] = until if pending and until < step[l] else step[l]",
        ]
    return lines


def _next_event(law: StoreyLaw, place: LaneLayout) -> list[str]:
    lines = []
    for number in range(len(law.events)):
        lines += [
            f"time = times[(i * {len(law.events)} + {number}) * LANES + l]",
            f"if w[a + BLOCK + {place.happened + number} * LANES + l] == 0.0 and time < found:",
            "    found = time",
        ]
    return lines


def _strike(law: StoreyLaw, place: LaneLayout, suffix: str) -> list[str]:
    lines = []
    for number, column in enumerate(law.event_parameters):
        lines += [
            "due = 0.0",
            "for l in range(LANES):",
            f"    until_then = {_until(law, number)}",
            f"    pending = w[a + BLOCK + {place.happened + number} * LANES + l] == 0.0",
            "    flipped[l] = 1.0 if pending and until_then <= NEAR * dt else 0.0",
            "    due += flipped[l]",
            "if due > 0.0:",
            f"    flip{suffix}(n_links, n_directions, i, {number}, {place.n_states + column}, step, flipped, ground,",
            "         joints, forced, seed, column, active, w, t)",
        ]
    return lines


def _drive(place: LaneLayout, suffix: str) -> list[str]:
    """The given displacement and the slope of the segment that begins; the last sample keeps the slope it came with."""
    n = place.n_states
    return [
        "for l in range(LANES):",
        "    step[l] = 0.0",
        "    w[BLOCK + l] = now[0]",
        "    w[BLOCK + LANES + l] = slope[0]",
        f"    w[BLOCK + {2 * n} * LANES + l] = now[0]",
        f"    w[BLOCK + {2 * n + 1} * LANES + l] = slope[0]",
        f"close{suffix}(n_links, n_directions, 0.0, step, ground, joints, forced, seed, column, active, w, t)",
    ]
