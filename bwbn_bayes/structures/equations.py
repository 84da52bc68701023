"""The whole model as equations to read: motion of the floors and drifts of the links, then the law of each element."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from bwbn_bayes.elements.equations import WrittenEquation, law_equations, sensor_equations
from bwbn_bayes.elements.law import FIRST_FORCE, FLOOR_FORCE, FLOOR_MASS, StoreyLaw, symbol
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import GROUND, Structure

_Written = tuple[str, str]
"""A piece of an equation as text and as MathML."""
_Terms = Sequence[tuple[str, _Written]]
"""Signs, each with what it stands before."""

_SHAKEN: _Written = ("a_g", "<msub><mi>a</mi><mi>g</mi></msub>")
_ZERO: _Written = ("0", "<mn>0</mn>")
_PUSH = "P"
"""A force on a floor from outside."""
_MANY = 4
"""Alike floors or storeys that are written once where others differ; fewer are written one by one."""


def structure_equations(model: Structure, record: Record | None = None) -> tuple[WrittenEquation, ...]:
    """Equations of motion, drifts and measured accelerations of a structure, then the laws of its links.

    Parameters
    ----------
    model : Structure
        Of what its law merely carries nothing is written.
    record : Record, optional
        What drives it: forces from outside, and the ground where that moves; the ground alone where it is left out.

    Returns
    -------
    tuple of WrittenEquation
        With one storey the subscripts are left out; floors and storeys that are alike are written once.
    """
    model = replace(model, carried=())
    motion = (_SPECIMEN,) if model.is_driven else _Building.of(model, record).equations()
    return motion + _bending(model) + _laws(model) + sensor_equations(model.sensors)


_SPECIMEN = WrittenEquation(
    caption="the displacement is given, straight between samples",
    text="du/dt = v",
    mathml="<mrow><mfrac><mrow><mi>d</mi><mi>u</mi></mrow><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>"
    "<mo>=</mo><mi>v</mi></mrow>",
)


@dataclass(frozen=True, kw_only=True)
class _Building:
    """A structure, the floors with a force from outside, and whether the ground moves."""

    model: Structure
    pushed: frozenset[int]
    is_shaken: bool

    @staticmethod
    def of(model: Structure, record: Record | None) -> _Building:
        """Under a record."""
        return _Building(
            model=model,
            pushed=frozenset(record.forced_floors if record is not None else ()),
            is_shaken=record is None or bool(np.any(record.excitation)),
        )

    def equations(self) -> tuple[WrittenEquation, ...]:
        """Motion, drift, and what accelerometers feel."""
        measured = "total acceleration of a floor" if self.model.sensors.definitions else "measured total acceleration"
        index = "" if self._is_lone else "i"
        return (
            *self._motions(),
            *self._drifts(),
            _equation(measured, _indexed("a", index), self._acceleration(index)),
        )

    @property
    def _is_lone(self) -> bool:
        """One storey, and nothing that has laws of floors or base, which write an index."""
        law = self.model.law
        return self.model.n_links == 1 and law.acceleration is None and law.base is None

    def _acceleration(self, index: str) -> _Terms:
        """Of a floor, relative to the ground and with it."""
        text, mathml = _indexed("x", index)
        relative = text.replace("x", "ẍ"), f"<mover>{mathml}<mo>¨</mo></mover>"
        return [("+", relative), *([("+", _SHAKEN)] if self.is_shaken else [])]

    def _motions(self) -> list[WrittenEquation]:
        """Floors of a plain chain are written once."""
        n, n_links = self.model.n_floors, self.model.n_links
        about = ", x relative to the ground"
        if self._is_lone:
            return [self._motion(f"motion of a floor{about}", "", self._forces(1, ""))]
        chain = {i: [("−", i)] + ([("+", i + 1)] if i < n else []) for i in range(1, n + 1)}
        of_chain = [
            i
            for i, own in chain.items()
            if i not in self.pushed and self._links(i) == own and (i < n or n_links == n)  # no F_(n+1) is zero else
        ]
        once = _written_once(of_chain, n)
        written = []
        if once:
            caption = "motion of a floor" if len(once) == n else f"motion of floors {_ranges(once)}"
            end = [(_indexed("F", f"{n + 1}"), _ZERO)] if n in once else []
            forces = [("−", _indexed("F", "i")), ("+", _indexed("F", "i+1"))]
            written = [self._motion(caption + about, "i", forces, end)]
        return written + [
            self._motion(f"motion of floor {i}{about}", f"{i}", self._forces(i, f"{i}")) for i in chain if i not in once
        ]

    def _links(self, floor: int) -> list[tuple[str, int]]:
        """Links that end at a floor, minus, and that stand on it."""
        joints = enumerate(self.model.joints, 1)
        return [("−" if floor == high else "+", link) for link, (low, high) in joints if floor in (low, high)]

    def _forces(self, floor: int, index: str) -> _Terms:
        """On a floor, of links and from outside."""
        of_links = [(sign, _indexed("F", f"{link}" if index else "")) for sign, link in self._links(floor)]
        return [*of_links, *([("+", _indexed(_PUSH, index))] if floor in self.pushed else [])]

    def _motion(
        self, caption: str, index: str, forces: _Terms, conditions: Sequence[tuple[_Written, _Written]] = ()
    ) -> WrittenEquation:
        subjects = {definition.subject for definition in self.model.law.definitions}
        mass = _indexed(FLOOR_MASS.name[0] if FLOOR_MASS in subjects else "m", index)
        text, mathml = _sum(self._acceleration(index))
        if self.is_shaken:
            text, mathml = f"({text})", f"<mrow><mo>(</mo>{mathml}<mo>)</mo></mrow>"
        further = [("+", _indexed(FLOOR_FORCE.name[0], index))] if FLOOR_FORCE in subjects else []
        inertia = f"{mass[0]} {text}", _row(mass[1], mathml)
        return _equation(caption, inertia, [*forces, *further], conditions)

    def _drifts(self) -> list[WrittenEquation]:
        """Storeys of a chain are written once."""
        if self._is_lone:
            return [_equation("drift", _indexed("u", ""), [("+", _indexed("x", ""))])]
        states, joints = self.model.law.base_states, self.model.joints
        base = _indexed(*states[0].name.split("_")) if states else _ZERO
        of_chain = [link for link, ends in enumerate(joints, 1) if ends == (link - 1, link)]
        once = _written_once(of_chain, len(joints))
        written = []
        if once:
            caption = "drift" if len(once) == len(joints) else f"drift of storeys {_ranges(once)}"
            terms = [("+", _indexed("x", "i")), ("−", _indexed("x", "i−1"))]
            start = [(_indexed("x", "0"), base)] if once[0] == 1 else []
            written = [_equation(caption, _indexed("u", "i"), terms, start)]
        for link, (low, high) in enumerate(joints, 1):
            if link not in once:
                below = base if low == GROUND else _indexed("x", f"{low}")
                terms = [("+", _indexed("x", f"{high}")), *([("−", below)] if below != _ZERO else [])]
                caption = f"drift, {self.model.link_in_words(link)}"
                written.append(_equation(caption, _indexed("u", f"{link}"), terms))
        return written


def _bending(model: Structure) -> tuple[WrittenEquation, ...]:
    """The drift that bends, where a force depends on it."""
    if not model.law.bends:
        return ()
    written, subject = [], _indexed("u", "b")
    runs_on_from = model.runs_on_from[: model.n_floors]
    if runs_on_from == tuple(range(model.n_floors)):
        caption = "drift beyond that of the storeys below and above, as far as there are such"
        written.append(_equation(caption, subject, [("+", _beyond("i", f"i{sign}1")) for sign in "−+"]))
    else:
        for own, below in enumerate(runs_on_from, 1):
            others = [*([below] if below else []), *(i for i, lower in enumerate(runs_on_from, 1) if lower == own)]
            terms = [("+", _beyond(f"{own}", f"{other}")) for other in others] or [("+", _ZERO)]
            written.append(_equation(f"drift beyond that of its neighbours, storey {own}", subject, terms))
    if model.n_links > model.n_floors:
        written.append(_equation("links beside the storeys do not bend", subject, [("+", _ZERO)]))
    return tuple(written)


def _beyond(own: str, other: str) -> _Written:
    """A drift less another, in brackets."""
    text, mathml = _sum([("+", _indexed("u", own)), ("−", _indexed("u", other))])
    return f"({text})", f"<mrow><mo>(</mo>{mathml}<mo>)</mo></mrow>"


def _laws(model: Structure) -> tuple[WrittenEquation, ...]:
    """The law of each kind of element; what all of them have, and what is around them, without their places."""
    kinds = model.kinds_of_links
    told = [law_equations(_told(model, model.law_of(links))) for links in kinds]
    everywhere = [one for one in told[0] if all(one in others for others in told)]
    own = [
        replace(one, caption=f"{one.caption}, {_in_words(model, links)}")
        for links, equations in zip(kinds, told, strict=True)
        for one in equations
        if one not in everywhere
    ]
    return (*own, *everywhere)


def _told(model: Structure, law: StoreyLaw) -> StoreyLaw:
    """The law as it is told: what an element adds to its own zero is the value, and a base bears all that joins it."""
    zeros = {one.subject for one in law.derived if one.expression == 0}
    grown = dict(law.increments)
    on_base = sum(symbol(f"F_{link}") for link, (low, _) in enumerate(model.joints, 1) if low == GROUND)
    definitions = tuple(
        replace(
            one,
            expression=grown.pop(one.subject)
            if one.subject in zeros & grown.keys()
            else one.expression.xreplace({FIRST_FORCE: on_base}),
        )
        for one in law.definitions
    )
    return replace(law, definitions=definitions, increments=tuple(grown.items()))


def _in_words(model: Structure, links: Sequence[int]) -> str:
    """``storeys 1 to 3``, then the ends of links that carry no floor."""
    storeys = [link for link in links if link <= model.n_floors]
    words = [f"storey{'s' if len(storeys) > 1 else ''} {_ranges(storeys)}"] if storeys else []
    return ", ".join([*words, *(model.link_in_words(link) for link in links if link > model.n_floors)])


def _written_once(alike: list[int], n: int) -> list[int]:
    """Which of n places share an equation: all, or many."""
    return alike if len(alike) == n or len(alike) >= _MANY else []


def _ranges(numbers: Sequence[int]) -> str:
    """``1 to 3, 5``."""
    runs = [[one for _, one in run] for _, run in groupby(enumerate(numbers), lambda pair: pair[1] - pair[0])]
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def _equation(
    caption: str, subject: _Written, terms: _Terms, conditions: Sequence[tuple[_Written, _Written]] = ()
) -> WrittenEquation:
    """A subject and the terms that it is, then what holds of symbols at the ends."""
    text, mathml = _sum(terms)
    for one, other in conditions:
        text += f", {one[0]} = {other[0]}"
        mathml += f"<mo>,</mo><mspace width='1em'/>{one[1]}<mo>=</mo>{other[1]}"
    return WrittenEquation(
        caption=caption, text=f"{subject[0]} = {text}", mathml=_row(subject[1], "<mo>=</mo>", mathml)
    )


def _sum(terms: _Terms) -> _Written:
    """Terms with their signs, a first plus left out."""
    (first, (text, mathml)), *more = terms
    if first == "−":
        text, mathml = f"−{text}", f"<mo>−</mo>{mathml}"
    for sign, (own_text, own_mathml) in more:
        text, mathml = f"{text} {sign} {own_text}", f"{mathml}<mo>{sign}</mo>{own_mathml}"
    return text, mathml


def _indexed(letter: str, index: str) -> _Written:
    """A symbol as text and as MathML."""
    if not index:
        return letter, f"<mi>{letter}</mi>"
    text = f"{letter}_({index})" if len(index) > 1 and not index.isdigit() else f"{letter}_{index}"
    tag = "mn" if index.isdigit() else "mi"
    inner = f"<{tag}>{index}</{tag}>"
    if len(index) > 1 and not index.isdigit():
        inner = f"<mrow><mi>{index[0]}</mi><mo>{index[1]}</mo><mn>{index[2:]}</mn></mrow>"
    return text, f"<msub><mi>{letter}</mi>{inner}</msub>"


def _row(*parts: str) -> str:
    return f"<mrow>{''.join(parts)}</mrow>"
