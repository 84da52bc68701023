"""How the parts of a formula are set: on one line of Unicode text, or as presentation MathML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol
from xml.sax.saxutils import escape

from sympy.printing.pretty.pretty_symbology import greek_unicode

LETTERS = {**greek_unicode, "inf": "∞"}
"""How parts of a symbol's name are written where they are not written as they are."""


class Notation(Protocol):
    """How the parts of a formula are set."""

    def identifier(self, letter: str, subscript: str) -> str:
        """A symbol."""
        ...

    def number(self, text: str) -> str:
        """A number."""
        ...

    def operator(self, sign: str) -> str:
        """A binary operator, or a relation."""
        ...

    def minus(self, operand: str) -> str:
        """A negative operand."""
        ...

    def row(self, parts: Sequence[str]) -> str:
        """Parts side by side."""
        ...

    def product(self, factors: Sequence[str]) -> str:
        """Factors side by side."""
        ...

    def fence(self, left: str, inner: str, right: str) -> str:
        """Brackets or bars around something."""
        ...

    def fraction(self, above: str, below: str, *, above_is_simple: bool, below_is_simple: bool) -> str:
        """A quotient."""
        ...

    def power(self, base: str, exponent: str, *, exponent_is_simple: bool) -> str:
        """A power."""
        ...

    def root(self, inner: str, *, is_simple: bool) -> str:
        """A square root."""
        ...

    def function(self, name: str, argument: str, *, bare: bool) -> str:
        """A function of one argument, without brackets where ``bare``."""
        ...


class UnicodeNotation:
    """One line of text."""

    _SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")

    def identifier(self, letter: str, subscript: str) -> str:
        """``δ_ν``; a subscript that has a subscript is bracketed."""
        return f"{letter}_({subscript})" if "_" in subscript else f"{letter}_{subscript}" if subscript else letter

    def number(self, text: str) -> str:
        """As it is."""
        return text

    def operator(self, sign: str) -> str:
        """Between spaces."""
        return f"{sign} " if sign == "," else f" {sign} "

    def minus(self, operand: str) -> str:
        """``−x``."""
        return f"−{operand}"

    def row(self, parts: Sequence[str]) -> str:
        """Joined."""
        return "".join(parts)

    def product(self, factors: Sequence[str]) -> str:
        """Joined by spaces."""
        return " ".join(factors)

    def fence(self, left: str, inner: str, right: str) -> str:
        """Joined."""
        return f"{left}{inner}{right}"

    def fraction(self, above: str, below: str, *, above_is_simple: bool, below_is_simple: bool) -> str:
        """``a / b`` with the brackets it needs."""
        top = above if above_is_simple else f"({above})"
        bottom = below if below_is_simple and " " not in below else f"({below})"
        tight = " " not in top + bottom
        return f"{top}/{bottom}" if tight else f"{top} / {bottom}"

    def power(self, base: str, exponent: str, *, exponent_is_simple: bool) -> str:
        """``z²``, ``z^n`` or ``z^(1/n)``."""
        if exponent.isdigit():
            return base + exponent.translate(self._SUPERSCRIPTS)
        return f"{base}^{exponent}" if exponent_is_simple else f"{base}^({exponent})"

    def root(self, inner: str, *, is_simple: bool) -> str:
        """``√2``."""
        return f"√{inner}" if is_simple else f"√({inner})"

    def function(self, name: str, argument: str, *, bare: bool) -> str:
        """``sgn v`` or ``exp(x)``."""
        return f"{name} {argument}" if bare else f"{name}({argument})"


class MathmlNotation:
    """Presentation MathML Core."""

    def identifier(self, letter: str, subscript: str) -> str:
        """An ``mi``, in an ``msub`` with its subscript."""
        head, _, rest = subscript.partition("_")
        below = self.identifier(head, rest) if rest else f"<mi>{escape(head)}</mi>"
        return f"<msub><mi>{escape(letter)}</mi>{below}</msub>" if subscript else f"<mi>{escape(letter)}</mi>"

    def number(self, text: str) -> str:
        """An ``mn``."""
        return f"<mn>{escape(text)}</mn>"

    def operator(self, sign: str) -> str:
        """An ``mo``."""
        return f"<mo>{escape(sign)}</mo>"

    def minus(self, operand: str) -> str:
        """A prefix minus."""
        return self.row((self.operator("−"), operand))

    def row(self, parts: Sequence[str]) -> str:
        """An ``mrow``."""
        return parts[0] if len(parts) == 1 else f"<mrow>{''.join(parts)}</mrow>"

    def product(self, factors: Sequence[str]) -> str:
        """Joined by the invisible sign of multiplication."""
        return self.row(
            (
                factors[0],
                *(part for factor in factors[1:] for part in ('<mo lspace="0.1em" rspace="0.1em">\u2062</mo>', factor)),
            )
        )

    def fence(self, left: str, inner: str, right: str) -> str:
        """Operators at both ends."""
        return self.row((self.operator(left), inner, self.operator(right)))

    def fraction(self, above: str, below: str, *, above_is_simple: bool, below_is_simple: bool) -> str:
        """An ``mfrac``; it needs no brackets."""
        return f"<mfrac>{above}{below}</mfrac>"

    def power(self, base: str, exponent: str, *, exponent_is_simple: bool) -> str:
        """An ``msup``."""
        return f"<msup>{base}{exponent}</msup>"

    def root(self, inner: str, *, is_simple: bool) -> str:
        """An ``msqrt``."""
        return f"<msqrt>{inner}</msqrt>"

    def function(self, name: str, argument: str, *, bare: bool) -> str:
        """An upright name, the sign of function application, the argument."""
        inner = argument if bare else self.fence("(", argument, ")")
        return self.row((f'<mi mathvariant="normal">{escape(name)}</mi>', "<mo>\u2061</mo>", inner))
