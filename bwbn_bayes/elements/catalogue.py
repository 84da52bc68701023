"""The registry of physical effects: what the package can add to a storey's law, with equations and sources.

A user's own effect joins it the same way::

    from bwbn_bayes.elements import Effect, register

    @register
    @dataclass(frozen=True, kw_only=True)
    class MyEffect(Effect): ...

and searches look for it where it has a guide (:mod:`~bwbn_bayes.elements.search_guide`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, is_dataclass

from bwbn_bayes.elements import effects
from bwbn_bayes.elements.equations import WrittenEquation, slot_equations
from bwbn_bayes.elements.law import Effect, Slots
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Parameter


@dataclass(frozen=True, kw_only=True)
class EffectFacts:
    """What people are told about an effect.

    Attributes
    ----------
    name, summary, level, source : str
        Canonical name, one line, what it acts on (``link``: a storey), where it was defined.
    forms : tuple of Effect
        The effect at its neutral values, once for each form it has.
    parameters : tuple of Parameter
        Those of every form.
    equations : tuple of WrittenEquation
        What the first form changes in the storey law, as text and as MathML.
    leaves_in_the_residual : str
        What a model without the effect leaves unexplained.
    hard_to_tell_from : str
        Effects that leave nearly the same.
    """

    name: str
    summary: str
    level: str
    source: str
    forms: tuple[Effect, ...]
    parameters: tuple[Parameter, ...]
    equations: tuple[WrittenEquation, ...]
    leaves_in_the_residual: str
    hard_to_tell_from: str


_REGISTRY: dict[str, type[Effect]] = {}


_PACKAGE = "bwbn_bayes."


def register[EffectClass: type[Effect]](effect_class: EffectClass) -> EffectClass:
    """Add a class of effects to the catalogue; use it as a decorator.

    Raises
    ------
    UserError
        If the class is not a frozen dataclass, lacks one of the texts the catalogue prints, or takes the name of
        another effect. Registering the same class again (a model file read twice) replaces it.
    """
    where = f"effect {effect_class.__qualname__}"
    if not is_dataclass(effect_class) or not effect_class.__dataclass_params__.frozen:
        raise UserError(f"{where}: write @dataclass(frozen=True, kw_only=True) below @register")
    for attribute in ("name", "summary", "source", "residual", "confusable"):
        if not getattr(effect_class, attribute, ""):
            raise UserError(f"{where}: the class attribute {attribute} is missing: give it one line of text")
    name = effect_class.name
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise UserError(f"{where}: name is {name!r}: use lower-case words joined by underscores")
    present = _REGISTRY.get(name)
    is_ours = present is not None and present.__module__.startswith(_PACKAGE)
    if present is not None and (
        present.__qualname__ != effect_class.__qualname__ or (is_ours and present.__module__ != effect_class.__module__)
    ):
        raise UserError(f"{where}: the name {name} belongs to {present.__qualname__}: choose another")
    _check_fields(effect_class, where)
    _REGISTRY[name] = effect_class
    return effect_class


def registered() -> tuple[type[Effect], ...]:
    """Every registered class, in the order of registration."""
    return tuple(_REGISTRY.values())


def title_of(name: str) -> str:
    """What engineers call an effect: ``slip-lock pinching``; of an effect that is not registered, its name in words."""
    effect_class = _REGISTRY.get(name)
    return (effect_class.title if effect_class is not None else "") or name.replace("_", " ")


def capital(text: str) -> str:
    """A text that begins a sentence or stands in a table."""
    return text[:1].upper() + text[1:]


def catalogue() -> tuple[EffectFacts, ...]:
    """Facts about every registered effect, in the order of registration."""
    return tuple(_facts(effect_class) for effect_class in registered())


def _check_fields(effect_class: type[Effect], where: str) -> None:
    """Each parameter of an effect with a fixed list must have a field of its name."""
    declared: object = effect_class.parameters
    if isinstance(declared, tuple):
        missing = {p.symbol for p in declared} - {f.name for f in fields(effect_class)}  # type: ignore[arg-type]
        if missing:
            raise UserError(f"{where}: no field for the parameter {', '.join(sorted(missing))}: add one of that name")


def _facts(effect_class: type[Effect]) -> EffectFacts:
    forms = effect_class.neutral_forms()
    return EffectFacts(
        name=effect_class.name,
        summary=effect_class.summary,
        level=effect_class.level,
        source=effect_class.source,
        forms=forms,
        parameters=tuple(parameter for form in forms for parameter in form.parameters),
        equations=slot_equations(forms[0].fill(Slots()), forms[0].parameters),
        leaves_in_the_residual=effect_class.residual,
        hard_to_tell_from=effect_class.confusable,
    )


for _name in effects.__all__:
    register(getattr(effects, _name))
