"""What is around the storeys of a building: floors with their masses, a base that moves, appendages, dampers.

Nodes are numbered 0 for the ground, 1 to n for the floors, n + 1 for the base, n + 1 + i for what stands on floor i,
and on from there for sliders (``export/sliders.py``). A base of compliance C, mass m_b and damping c_b is a node on
``Elastic`` 1/C and ``Viscous`` c_b; a slab on sliders is one on ``BoucWen``; an appendage of mass ``mu_t m_i`` stands
on ``mu_t m_i omega_t^2`` and ``2 zeta_t omega_t mu_t m_i``; damping in proportion to the mass is a dashpot ``c_m m_i``
between floor and ground, since its force follows the velocity relative to the ground. Bending between a storey and the
next, ``k_bend (u_{i+1} - u_i)^2 / 2``, is two springs of ``2 k_bend``, one in each of them, and one of ``-k_bend`` past
the floor between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bwbn_bayes.export.exportable import Exportable, Link
from bwbn_bayes.export.laws import Material, sliding_base
from bwbn_bayes.export.links import TAGS, LinkScript, in_parallel
from bwbn_bayes.export.sliders import Slider

_STIFFEST = 100.0
"""Circular frequency of a base [rad/s] above which our law takes it for rigid (``effects/base_flexibility.py``)."""


@dataclass(frozen=True, kw_only=True)
class Node:
    """A mass [kg] that moves."""

    number: int
    mass: float
    says: str = ""


@dataclass(frozen=True, kw_only=True)
class Element:
    """A spring between two nodes, of a material."""

    number: int
    below: int
    above: int
    material: int


@dataclass(frozen=True, kw_only=True)
class PlacedSlider:
    """A slider beside a link's material, between two nodes in a plane that move with those that the link joins."""

    slider: Slider
    link: int
    element: int
    nodes: tuple[int, int]
    joins: tuple[int, int]
    friction: int
    """Tag of its friction; that of its materials is a link's of the element's number."""

    @property
    def material(self) -> int:
        """Of a stiffness that holds it along its weight and against rotation."""
        return TAGS * self.element


@dataclass(frozen=True, kw_only=True)
class Building:
    """Nodes, elements, and what they are made of besides the storeys."""

    nodes: tuple[Node, ...]
    elements: tuple[Element, ...]
    materials: tuple[LinkScript, ...]
    joints: tuple[tuple[int, int], ...]
    """The nodes that each link of the structure joins."""
    sliders: tuple[PlacedSlider, ...]
    ground_factor: float
    notes: tuple[str, ...]


def building_of(structure: Exportable, links: Sequence[LinkScript]) -> Building:
    """Lay out a building, whose links are written already."""
    first, n = structure.links[0].parameters, len(structure.masses)
    storeys = structure.links[:n]
    masses = [
        mass * (1.0 + storey.parameters.get("e_m", 0.0)) for mass, storey in zip(structure.masses, storeys, strict=True)
    ]
    moves, notes = _moves(structure.links[0])
    slides = first.get("inv_mu", 0.0) > 0.0
    ground = n + 1 if moves or slides else 0
    joints = tuple((link.joins[0] or ground, link.joins[1]) for link in structure.links)
    nodes = [Node(number=i + 1, mass=mass) for i, mass in enumerate(masses)]
    elements = [
        Element(number=link.number, below=low, above=high, material=TAGS * link.number)
        for link, (low, high) in zip(structure.links, joints, strict=True)
    ]
    further: list[LinkScript] = []

    def joined(place: str, ends: tuple[int, int], stiffness: float, damping: float) -> None:
        """A spring and a dashpot between two nodes."""
        spring = Material(kind="Elastic", arguments=(stiffness,), says="stiffness [N/m]")
        dashpot = Material(kind="Viscous", arguments=(damping, 1.0), says="C [N s/m], exponent of the velocity")
        materials = [one for one, size in ((spring, stiffness), (dashpot, damping)) if size != 0.0]
        number = len(elements) + 1
        further.append(LinkScript(place=place, tag=TAGS * number, materials=in_parallel(TAGS * number, materials)))
        elements.append(Element(number=number, below=ends[0], above=ends[1], material=TAGS * number))

    if moves:
        nodes.append(Node(number=n + 1, mass=first["m_b"], says="base"))
        joined("Between ground and base", (0, n + 1), 1.0 / first["compliance"], first["c_b"])
    if slides:
        if first.get("r_mu", 0.0) > 0.0:
            share = f"{100.0 * first['r_mu']:.0f} %"
            notes = (*notes, f"Sliders have their friction at speed at every speed; ours have {share} less near rest.")
        number = len(elements) + 1
        nodes.append(Node(number=n + 1, mass=first["m_s"], says="slab on sliders"))
        materials = in_parallel(TAGS * number, [sliding_base(first)])
        further.append(LinkScript(place="Sliders between ground and slab", tag=TAGS * number, materials=materials))
        elements.append(Element(number=number, below=0, above=n + 1, material=TAGS * number))
    runs_on = [storey.joins for storey in storeys if storey.joins[0] and first.get("k_bend", 0.0) > 0.0]
    if runs_on:
        notes = (*notes, "Storey forces in the script are without bending, which has springs of its own.")
    for floor, above in runs_on:
        place, stiffness, below = f"Bending at floor {floor}", first["k_bend"], joints[floor - 1][0]
        joined(place, (below, floor), 2.0 * stiffness, 0.0)
        joined(place, (floor, above), 2.0 * stiffness, 0.0)
        joined(f"{place}, past it", (below, above), -stiffness, 0.0)
    for i, (storey, mass) in enumerate(zip(storeys, masses, strict=True)):
        p = storey.parameters
        if p.get("c_m", 0.0) > 0.0:
            joined(f"Damping of floor {i + 1} in proportion to its mass", (0, i + 1), 0.0, p["c_m"] * mass)
        if p.get("mu_t", 0.0) > 0.0:
            light, omega = p["mu_t"] * mass, 2.0 * math.pi * p["f_t"]
            nodes.append(Node(number=n + 2 + i, mass=light, says=f"on floor {i + 1}"))
            ends = (i + 1, n + 2 + i)
            joined(f"What stands on floor {i + 1}", ends, light * omega**2, 2.0 * p["zeta_t"] * omega * light)
    return Building(
        nodes=tuple(nodes),
        elements=tuple(elements),
        materials=tuple(further),
        joints=joints,
        sliders=_placed(links, joints, first_element=len(elements) + 1, first_node=2 * n + 2),
        ground_factor=first.get("s_g", 1.0),
        notes=notes,
    )


def _placed(
    links: Sequence[LinkScript], joints: Sequence[tuple[int, int]], *, first_element: int, first_node: int
) -> tuple[PlacedSlider, ...]:
    """Sliders with numbers of their own: two nodes and an element each."""
    slide = [(number, link.slider) for number, link in enumerate(links, 1) if link.slider is not None]
    return tuple(
        PlacedSlider(
            slider=slider,
            link=number,
            element=first_element + i,
            nodes=(first_node + 2 * i, first_node + 2 * i + 1),
            joins=joints[number - 1],
            friction=i + 1,
        )
        for i, (number, slider) in enumerate(slide)
    )


def _moves(first: Link) -> tuple[bool, tuple[str, ...]]:
    """Whether the building stands on a base that can move, and what is to be said of one that hardly does."""
    compliance = first.parameters.get("compliance", 0.0)
    if compliance == 0.0:
        return False, ()
    if compliance * first.parameters["m_b"] * _STIFFEST**2 < 1.0:
        return False, ("The base is so stiff that it is taken for rigid.",)
    return True, ()
