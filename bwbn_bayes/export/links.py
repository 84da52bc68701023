"""The materials of each link as lines of a script, and what is to be said of them."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.export.exportable import Link
from bwbn_bayes.export.fitted import fitted_material
from bwbn_bayes.export.laws import Material, Part, beside, force_at, hysteretic_spring, size_of_z, without_law
from bwbn_bayes.export.sliders import Slider, slider_of
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.model_source import WIDTH, comment

TAGS = 100
"""Tags of a link's materials: a hundred of its number, and one more for each of its parts."""
_WITHIN = 50
"""What is added to the tag of a part that begins strained, for the material that is."""
_OF_A_RATE = ("Viscous", "Maxwell")
"""Materials of OpenSees whose force depends on the rate."""


@dataclass(frozen=True, kw_only=True)
class LinkScript:
    """The materials of one link as lines of a script.

    Attributes
    ----------
    place : str
        Which link it is, in words.
    tag : int
        Of the material that stands for the whole link.
    materials : tuple of str
        Lines, that of ``tag`` last.
    says : tuple of str
        How near they come to the link's law, in sentences.
    error : float or None
        Of a fitted material or a slider: rms of what it misses over the rms of the identified force. None where the
        translation is exact as the step goes to zero.
    slider : Slider or None
        An element that stands beside the materials.
    first_force : float
        What of a specimen's force the materials lack: that of the hysteretic spring at the first displacement, where z
        is zero as the script's strain is. [N]
    """

    place: str
    tag: int
    materials: tuple[str, ...]
    says: tuple[str, ...] = ()
    error: float | None = None
    slider: Slider | None = None
    first_force: float = 0.0

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it, for the script."""
        sentences = (f"{self.place}.", *self.says)
        return (*(line for sentence in sentences for line in comment(sentence)), *self.materials)


def link_script(link: Link, rng: np.random.Generator, *, is_specimen: bool, time_steps: Floats | None) -> LinkScript:
    """Translate a link, or fit a material to what of it has no translation.

    Parameters
    ----------
    link : Link
    rng : numpy.random.Generator
        Of a fit.
    is_specimen : bool
        Whether the link is driven, by itself.
    time_steps : (n_times - 1,) array or None
        Between samples [s]; None without time.

    Raises
    ------
    UserError
        If something cannot be translated, depends on a rate where there is no time, or a fit asks for openseespy and it
        is not installed.
    """
    place = link.place[0].upper() + link.place[1:]
    missing = without_law(link.parameters, in_analysis=not is_specimen)
    first = float(link.drift[0]) if is_specimen else 0.0
    parts = tuple(_begun(part, first) for part in beside(link))
    first_force = force_at(link, first)
    rated = [part.material.kind for part in parts if part.material.kind in _OF_A_RATE]
    if rated and time_steps is None:
        raise UserError(
            f"{place} has a part that depends on the drift rate ({rated[0]}), which a record without time does not "
            "tell: leave it out of the model, c = 0 say, or identify it from a record with a column time"
        )
    error = None
    slider = None if is_specimen or time_steps is None else slider_of(link, time_steps)
    if slider is not None:
        dish = Material(
            kind="Elastic", arguments=(slider.weight / link.parameters["R"],), says="stiffness [N/m]: the dish"
        )
        materials, error = [dish, *(part.material for part in parts)], slider.error
        says = (f"Friction is a flatSliderBearing, which slides at once and misses {_percent(error)}.",)
    elif missing:
        # What has a memory cannot be taken out of the force: the fit has it too.
        known = [(part.material, part.force) for part in parts if part.force is not None]
        rest = link.force - first_force - sum((force for _, force in known), np.zeros_like(link.force))
        fit = fitted_material(link, rest, rng, place=place)
        materials, error = [fit.material, *(material for material, _ in known)], fit.error
        approximate = f"{fit.material.kind} is fitted and misses {_percent(error)}"
        says = (f"No OpenSees material does {', '.join(missing)}: {approximate}.",)
    else:
        materials = [hysteretic_spring(link), *(part.material for part in parts)]
        says = (f"Exact as the step goes to zero; z is of the size {size_of_z(link):.3g} m.",)
    tag = TAGS * link.number
    lines = in_parallel(tag, materials)
    return LinkScript(
        place=place, tag=tag, materials=lines, says=says, error=error, slider=slider, first_force=first_force
    )


def _begun(part: Part, drift: float) -> Part:
    """A part that has no memory, begun at a drift [m]; others begin at rest."""
    if part.force is None or part.material.kind in _OF_A_RATE:
        return part
    return replace(part, material=replace(part.material, begins=drift))


def _percent(error: float) -> str:
    return f"{100.0 * error:.2g} % of the loop's force (rms over rms)"


def in_parallel(tag: int, materials: Sequence[Material]) -> tuple[str, ...]:
    """Lines of materials that act beside each other under one tag."""
    if len(materials) == 1:
        return tuple(_lines(tag, materials[0]))
    tags = [tag + i + 1 for i in range(len(materials))]
    lines = [line for own, material in zip(tags, materials, strict=True) for line in _lines(own, material)]
    together = f'ops.uniaxialMaterial("Parallel", {tag}, {", ".join(map(str, tags))})'
    return (*lines, *comment("Parallel: they share the drift, their forces add."), together)


def _lines(tag: int, material: Material) -> list[str]:
    """A material and, above it, what its arguments are."""
    if material.begins:
        inner, begins = replace(material, begins=0.0), _literal(material.begins)
        outer = f'ops.uniaxialMaterial("InitStrain", {tag}, {tag + _WITHIN}, {begins})'
        return [*_lines(tag + _WITHIN, inner), *comment("InitStrain: the displacement [m] at first."), outer]
    written = ", ".join(_literal(argument) for argument in material.arguments)
    line = f'ops.uniaxialMaterial("{material.kind}", {tag}, {written})'
    if len(line) > WIDTH:
        wrapped = (f"    {one}" for one in textwrap.wrap(f'"{material.kind}", {tag}, {written}', WIDTH - 4))
        line = "\n".join(["ops.uniaxialMaterial(", *wrapped, ")"])
    return [*comment(f"{material.kind}: {material.says}"), line]


def _literal(value: float | str) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if not math.isfinite(value):
        raise UserError(f"a parameter of a material is {value}, which no script can hold")
    return repr(value)
