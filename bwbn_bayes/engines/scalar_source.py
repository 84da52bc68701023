"""The source of a scalar kernel: one draw's right-hand side, its Jacobian, its sensitivities and a Runge-Kutta solve.

All functions share one flat array ``data``: a head (number of links, time step, number of samples, number of
directions, number of inputs), then a block per link and the node that it carries (law parameters, values derived from
them, event indicators, inverse mass, force, acceleration, their derivatives in the direction at hand, the nodes that
the link joins, the forces on the node, partial derivatives of the law, room for those of the base), then the direction
of each identified parameter, then the inputs: the excitation and each force from outside. One array is what a C
callback can carry. State rows are, link by link, drift, drift rate, hysteretic displacement, energy, added states; then
those of the base.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from bwbn_bayes.elements.law import (
    BENDING_DRIFT,
    DRIFT,
    DRIFT_RATE,
    NET_FORCE,
    RECORDED_ACCELERATION,
    TIME,
    StoreyLaw,
)
from bwbn_bayes.engines.codegen import INPUT_NAMES, INVERSE_MASS, LawPrograms, Part, Program, print_expression
from bwbn_bayes.engines.scalar_template import EVENTS, LAW, RUNGE_KUTTA, SIZES
from bwbn_bayes.engines.step_rules import MARGIN, MOST_STEPS, REACH, has_kink

HEAD = 5


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Where things stand inside a storey's block of ``data``, and the sizes that follow from the law.

    Attributes
    ----------
    n_rows : int
        State rows of a storey.
    n_base_rows : int
        State rows of the base.
    n_columns : int
        Columns of the table of partial derivatives: the law's variables, and one of zeros.
    derived, happened, inverse_mass, force, acceleration, force_slope, acceleration_slope : int
        Offsets in a storey's block, where parameters come first.
    lower, upper, pull, pull_slope, force_row, applied : int
        Likewise the nodes where the link begins and ends, the links' force on the node of the block and its derivative,
        the input that pushes at the node (0 where none does), and that force now.
    runs_on_from, bending, bending_slope : int
        Likewise the link (from 1, 0 for none) that this one runs on from, by how much the drift exceeds those of its
        neighbours and its derivative.
    slope, base_slope, block : int
        Likewise the tables of partial derivatives of storey and floor, and of the base, which stands in the block of
        storey 1; length of a block.
    """

    n_rows: int
    n_base_rows: int
    n_columns: int
    derived: int
    happened: int
    inverse_mass: int
    force: int
    acceleration: int
    force_slope: int
    acceleration_slope: int
    lower: int
    upper: int
    pull: int
    pull_slope: int
    force_row: int
    applied: int
    runs_on_from: int
    bending: int
    bending_slope: int
    slope: int
    base_slope: int
    block: int

    def n_states(self, n_links: int) -> int:
        """State rows of a building."""
        return n_links * self.n_rows + self.n_base_rows

    def seed(self, n_links: int) -> int:
        """Where the columns that each direction moves begin, link by link."""
        return HEAD + n_links * self.block

    def excitation(self, n_links: int, n_directions: int) -> int:
        """Where the excitation begins."""
        return self.seed(n_links) + n_links * n_directions


def layout(law: StoreyLaw, programs: LawPrograms) -> Layout:
    """Lay out ``data`` for one storey law."""
    derived = len(law.parameters)
    happened = derived + programs.n_hoisted
    inverse_mass = happened + len(law.events)
    n_columns = len(programs.variables) + 1
    slope = inverse_mass + 14
    base_slope = slope + programs.n_rows * n_columns
    return Layout(
        n_rows=2 + len(law.states),
        n_base_rows=len(law.base_states),
        n_columns=n_columns,
        derived=derived,
        happened=happened,
        inverse_mass=inverse_mass,
        force=inverse_mass + 1,
        acceleration=inverse_mass + 2,
        force_slope=inverse_mass + 3,
        acceleration_slope=inverse_mass + 4,
        lower=inverse_mass + 5,
        upper=inverse_mass + 6,
        pull=inverse_mass + 7,
        pull_slope=inverse_mass + 8,
        force_row=inverse_mass + 9,
        applied=inverse_mass + 10,
        runs_on_from=inverse_mass + 11,
        bending=inverse_mass + 12,
        bending_slope=inverse_mass + 13,
        slope=slope,
        base_slope=base_slope,
        block=base_slope + (len(programs.base.rows) * n_columns if programs.base is not None else 0),
    )


def scalar_source(law: StoreyLaw, programs: LawPrograms, *, driven: bool, with_tangents: bool) -> str:
    """Source of the scalar kernel of one storey law.

    Parameters
    ----------
    law : StoreyLaw
        The law; its parameters open each storey's block of ``data``.
    programs : LawPrograms
        The law as straight-line code.
    driven : bool
        True for a specimen whose displacement is given, False for a base-excited building.
    with_tangents : bool
        Whether what marches and observes does so with derivatives.
    """
    place = layout(law, programs)
    fields = {
        "head": HEAD,
        "block": place.block,
        "n_rows": place.n_rows,
        "n_base_rows": place.n_base_rows,
        "moved": _indent(_moved(place, "i")),
        "force": place.force,
        "acceleration": place.acceleration,
        "force_slope": place.force_slope,
        "acceleration_slope": place.acceleration_slope,
        "lower": place.lower,
        "upper": place.upper,
        "pull": place.pull,
        "pull_slope": place.pull_slope,
        "force_row": place.force_row,
        "applied": place.applied,
        "runs_on_from": place.runs_on_from,
        **_bending(programs, place),
        "driven": driven,
        "with_tangents": with_tangents,
        "drift_rate_rate": (
            "0.0" if driven else f"data[HEAD + (int(data[here + {place.upper}]) - 1) * BLOCK + acceleration] - under"
        ),
        "prepare": _indent(_prepare(law, place, programs)),
        "rates": _indent([*_rates(law, programs.storey, place, _storey_targets(law, place)), "dy[base] = v"]),
        "below": _below(law, programs, place),
        "floor": _indent(_floor(law, programs, place)),
        "slopes": _indent(_slopes(law, programs.storey, place, place.slope, [f"data[here + {place.force}]"])),
        "around_slopes": _around_slopes(law, programs, place),
        "chain": _indent(_chain(programs, place)),
        "below_slope": _below_slope(programs, place),
        "floor_slope": _indent(_floor_slope(programs, place)),
        "next_event": _indent(_next_event(law, place)),
        "strike": _indent(_strike(law, place)),
        "refine": _indent(_refine(law)),
        "refine_base": _refine_base(law),
        "turn": _indent(_turn(law)),
    }
    return "".join(part.format(**fields) for part in (SIZES, LAW, EVENTS, RUNGE_KUTTA))


def _bending(programs: LawPrograms, place: Layout) -> dict[str, str]:
    """Lines that compare drifts with those of the neighbours, where a force depends on it."""
    if programs.bending is None:
        return {"bend": "", "bend_slope": ""}
    return {
        "bend": f"    compare({place.bending}, y, data)\n",
        "bend_slope": f"    compare({place.bending_slope}, t, data)\n",
    }


def _indent(lines: list[str]) -> str:
    return "\n".join("        " + line for line in lines or ["pass"])


def _loads(law: StoreyLaw, place: Layout, program: Program, first: int, lines: list[str]) -> list[str]:
    """Lines that load what the given lines use; ``first`` is the position of the program's first hoisted value."""
    words = set(re.findall(r"[A-Za-z_]\w*", "\n".join(lines)))
    sources = {str(symbol): f"y[base + {row}]" for row, symbol in enumerate((DRIFT, DRIFT_RATE, *law.states))}
    sources |= {str(symbol): f"y[n_links * ROWS + {r}]" for r, symbol in enumerate(law.base_states)}
    sources |= {str(symbol): f"data[here + {column}]" for column, symbol in enumerate(law.symbols)}
    hoisted = enumerate(program.hoisted)
    sources |= {name: f"data[here + {place.derived + first + column}]" for column, (name, _) in hoisted}
    sources |= {str(event.indicator): f"data[here + {place.happened + e}]" for e, event in enumerate(law.events)}
    sources |= {str(INVERSE_MASS): f"data[here + {place.inverse_mass}]", INPUT_NAMES[RECORDED_ACCELERATION]: "ground"}
    sources |= {INPUT_NAMES[NET_FORCE]: "net", INPUT_NAMES[BENDING_DRIFT]: f"data[here + {place.bending}]"}
    return [f"{name} = {source}" for name, source in sources.items() if name in words]


def _prepare(law: StoreyLaw, place: Layout, programs: LawPrograms) -> list[str]:
    lines: list[str] = []
    for part in programs.parts:
        for program, first in ((part.rates, part.first_rates), (part.tangent, part.first_tangent)):
            lines += _loads(law, place, program, first, [source for _, source in program.hoisted])
            for position, (name, source) in enumerate(program.hoisted):
                lines += [f"{name} = {source}", f"data[here + {place.derived + first + position}] = {name}"]
    return lines


def _storey_targets(law: StoreyLaw, place: Layout) -> list[str]:
    return [f"data[here + {place.force}]", *(f"dy[base + {2 + i}]" for i in range(law.n_storey_states))]


def _rates(law: StoreyLaw, part: Part, place: Layout, targets: list[str]) -> list[str]:
    program = part.rates
    body = [f"{name} = {source}" for name, source in program.lines]
    body += [f"{target} = {source}" for target, source in zip(targets, program.outputs, strict=True)]
    return _loads(law, place, program, part.first_rates, body) + body


def _floor(law: StoreyLaw, programs: LawPrograms, place: Layout) -> list[str]:
    if programs.floor is None:
        return [f"acceleration = net * data[here + {place.inverse_mass}]"]
    rates = [f"dy[base + {2 + i}]" for i in range(law.n_storey_states, len(law.states))]
    return _rates(law, programs.floor, place, ["acceleration", *rates])


def _below(law: StoreyLaw, programs: LawPrograms, place: Layout) -> str:
    """Acceleration of what the building stands on."""
    if programs.base is None:
        return "    below = ground"
    rates = [f"dy[n_links * ROWS + {r}]" for r in range(place.n_base_rows)]
    return _first_storey(_rates(law, programs.base, place, ["below", *rates]))


def _first_storey(lines: list[str]) -> str:
    """Lines about the base: ``here`` is the block of storey 1."""
    return "\n".join("    " + line for line in ["here = HEAD", *lines])


def _slopes(law: StoreyLaw, part: Part, place: Layout, table: int, kept: Sequence[str] = ()) -> list[str]:
    """Partial derivatives of a part into its table; the first outputs go to ``kept``."""
    body = [f"{name} = {source}" for name, source in part.tangent.lines]
    body += [f"{target} = {source}" for target, source in zip(kept, part.tangent.outputs, strict=False)]
    body += [
        f"data[here + {table + output * place.n_columns + variable}] = {source}"
        for (output, variable), source in zip(part.partials, part.slopes, strict=True)
    ]
    return _loads(law, place, part.tangent, part.first_tangent, body) + body


def _around_slopes(law: StoreyLaw, programs: LawPrograms, place: Layout) -> str:
    """Partial derivatives of floors and base, from the forces that the storeys' programs have just left."""
    lines: list[str] = []
    if programs.floor is not None or programs.base is not None:
        lines += [f"    net = gather({place.force}, {place.pull}, data)"]
    if programs.base is not None:
        lines += [_first_storey(_slopes(law, programs.base, place, place.base_slope))]
    if programs.floor is not None:
        lines += ["    for i in range(n_links):", "        base = i * ROWS"]
        lines += ["        here = HEAD + i * BLOCK"]
        lines += [f"        net = data[here + {place.pull}] + data[here + {place.applied}]"]
        lines += [_indent(_slopes(law, programs.floor, place, place.slope))]
    return "\n".join(lines)


def _slope(part: Part, row: int, first: int, tangents: dict[int, str]) -> str:
    """Derivative of one output in the direction at hand, given those of the variables it is a function of."""
    terms = [f"data[moved + {first}]"]
    terms += [
        f"data[here + {first + variable}] * {tangents[variable]}"
        for output, variable in part.partials
        if output == row and variable in tangents
    ]
    return " + ".join(terms)


def _moved(place: Layout, storey: str) -> list[str]:
    """Lines that find the column of the table that direction k moves at a storey."""
    return [
        f"moved = here + {place.n_columns - 1}",
        "if k >= 0:",
        f"    moved = here + int(data[HEAD + n_links * BLOCK + {storey} * n_directions + k])",
    ]


def _chain(programs: LawPrograms, place: Layout) -> list[str]:
    tangents = {row: f"t[base + {row}]" for row in range(place.n_rows)}
    if programs.bending is not None:
        tangents[programs.bending] = f"data[here + {place.bending_slope}]"
    targets = [f"data[here + {place.force_slope}]", *(f"dt_[base + {1 + row}]" for row in range(1, place.n_rows - 1))]
    return ["dt_[base] = t[base + 1]"] + [
        f"{targets[row]} = {_slope(programs.storey, row, place.slope + row * place.n_columns, tangents)}"
        for row in programs.storey.rows
    ]


def _floor_slope(programs: LawPrograms, place: Layout) -> list[str]:
    if programs.floor is None:
        return [f"acceleration = net * data[here + {place.inverse_mass}]"]
    tangents = {row: f"t[base + {row}]" for row in range(place.n_rows)}
    inputs = {len(programs.variables) - 1: "net"}
    targets = [*(f"dt_[base + {1 + row}]" for row in range(place.n_rows - 1)), "acceleration"]
    return _moved(place, "i") + [
        f"{targets[row]} = {_slope(programs.floor, row, place.slope + row * place.n_columns, tangents | inputs)}"
        for row in programs.floor.rows
    ]


def _below_slope(programs: LawPrograms, place: Layout) -> str:
    if programs.base is None:
        return "    below = 0.0"
    own = range(place.n_base_rows)
    tangents = {r: f"t[n_links * ROWS + {r}]" for r in own} | {len(programs.variables) - 1: "net"}
    targets = ["below", *(f"dt_[n_links * ROWS + {r}]" for r in own)]
    lines = _moved(place, "0") + [
        f"{targets[row]} = {_slope(programs.base, row, place.base_slope + row * place.n_columns, tangents)}"
        for row in programs.base.rows
    ]
    return _first_storey(lines)


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
            "    if WITH_TANGENTS:",
            "        rates(y, ground, before, data)",
            f"    {happened} = 1.0",
            "    prepare(data)",
            "    if WITH_TANGENTS:",
            "        rates(y, ground, after, data)",
            "        for k in range(n_directions):",
            f"            if int(data[seed + k]) == {2 + len(law.states) + column}:",
            "                jump(tangents[k], before, after)",
        ]
    return lines


def _refine(law: StoreyLaw) -> list[str]:
    names = [str(s) for s in (DRIFT, DRIFT_RATE, *law.states)]
    lines = []
    for feature in law.sharp_features:
        if feature.state in law.base_states:
            continue
        width = print_expression(feature.width)
        if feature.state == TIME:
            lines += _needed(law, width, "dt", "")
            continue
        state = names.index(str(feature.state))
        near = "" if feature.everywhere else f" and abs(y[base + {state}]) / ({width}) < change + {REACH}"
        lines += _needed(law, width, f"abs(dy[base + {state}]) * dt", near)
    return lines


def _refine_base(law: StoreyLaw) -> str:
    """The same of what the base has, after every link; its widths stand in each link's block."""
    names = [str(s) for s in law.base_states]
    lines = []
    for feature in law.sharp_features:
        if feature.state in law.base_states:
            row = f"n_links * ROWS + {names.index(str(feature.state))}"
            lines += _needed(law, print_expression(feature.width), f"abs(dy[{row}]) * dt", "")
    return "".join(f"\n    {line}" for line in ["n_links = int(data[0])", *lines]) if lines else ""


def _needed(law: StoreyLaw, width: str, travel: str, near: str) -> list[str]:
    """Steps that a sharp feature asks for, where the state moves by so much between samples."""
    constants = {str(symbol): column for column, symbol in enumerate(law.symbols)}
    used = [name for name in constants if name in re.findall(r"[A-Za-z_]\w*", width)]
    return [
        *(f"{name} = data[here + {constants[name]}]" for name in used),
        f"change = {travel} / ({width})",
        f"if resolution > 0.0{near}:",
        f"    steps = max(steps, min(np.ceil(change / resolution), {MOST_STEPS}))",
    ]


def _turn(law: StoreyLaw) -> list[str]:
    if not has_kink(law, DRIFT_RATE):
        return []
    return [
        "if y[base + 1] * (y[base + 1] + h * dy[base + 1]) < 0.0:",
        "    until = -y[base + 1] / dy[base + 1]",
        f"    h = until if {MARGIN} * h < until and until < {1.0 - MARGIN} * h else h",
    ]
