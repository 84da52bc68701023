"""What a kernel's text computes with, as LLVM writes it: numbers, vectors of them, arrays."""

from __future__ import annotations

import ast
import struct
from typing import NamedTuple

DOUBLE, INT, SHORT, TRUTH = "double", "i64", "i32", "i1"


class Precision(NamedTuple):
    """What a kernel computes with.

    Attributes
    ----------
    real : str
        Type of its numbers.
    bits : str
        Type of an integer with as many bits as a number has.
    width : int
        Lanes of a vector.
    """

    real: str
    bits: str
    width: int


PRECISIONS = {
    64: Precision(DOUBLE, INT, 8),
    32: Precision("float", SHORT, 16),
}
"""By the bits of a number. A vector fills a register of 512 bits: with all sixteen doubles at once derivatives took a
third longer, since twice as many registers are asked for."""
_FLOATS = {DOUBLE: "f64", "float": "f32"}
"""Types of numbers, and what intrinsics call them."""
_BYTES = {DOUBLE: 8, INT: 8, "float": 4}
"""Of an array's elements."""
_FAST = "contract reassoc arcp nsz"
"""Fast-math flags of every operation; never ``nnan`` or ``ninf``: a draw that runs away must be seen."""
_FLOAT_OPERATIONS = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
# Whole division is of what is not negative.
_INT_OPERATIONS: dict[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.FloorDiv: "sdiv",
    ast.LShift: "shl",
    ast.RShift: "ashr",
    ast.BitAnd: "and",
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Gt: ("ogt", "sgt"),
    ast.Lt: ("olt", "slt"),
    ast.GtE: ("oge", "sge"),
    ast.LtE: ("ole", "sle"),
    ast.Eq: ("oeq", "eq"),
    ast.NotEq: ("une", "ne"),
}


class Value(NamedTuple):
    """A scalar, or one for each lane of a vector: its type and its name, or the constant itself."""

    type: str
    text: str

    @property
    def is_wide(self) -> bool:
        """Whether it is a vector."""
        return self.type.startswith("<")

    @property
    def is_number(self) -> bool:
        """Whether it is no integer and no truth value."""
        return self.scalar in _FLOATS

    @property
    def is_constant(self) -> bool:
        """Whether it is a scalar that is known beforehand."""
        return not self.is_wide and not self.text.startswith("%")

    @property
    def scalar(self) -> str:
        """Type of one lane."""
        return self.type.split(" x ")[1].rstrip(">") if self.is_wide else self.type


class Array(NamedTuple):
    """An array: the type of its elements, where it begins, and its sizes."""

    element: str
    start: str
    sizes: tuple[str, ...]

    @property
    def kind(self) -> tuple[str, int]:
        """What a function's parameter must be to take it."""
        return self.element, len(self.sizes)


class Instructions:
    """Writes instructions one after the other, of numbers of one precision but for sums that are kept in double."""

    def __init__(self, precision: Precision) -> None:
        self.real, self.bits_type, self.width = precision
        self.lines: list[str] = []
        self.declared: dict[str, str] = {}
        self._n_names = 0

    def name(self, prefix: str = "v") -> str:
        """A name that nothing has yet."""
        self._n_names += 1
        return f"{prefix}{self._n_names}"

    def emit(self, type_: str, text: str) -> Value:
        """An instruction with a result."""
        name = f"%{self.name()}"
        self.lines.append(f"  {name} = {text}")
        return Value(type_, name)

    def label(self, name: str) -> None:
        """Where branches lead."""
        self.lines.append(f"{name}:")

    def go(self, name: str) -> None:
        """On to a label."""
        self.lines.append(f"  br label %{name}")

    def branch(self, test: Value, yes: str, no: str) -> None:
        """On to one of two."""
        self.lines.append(f"  br i1 {test.text}, label %{yes}, label %{no}")

    def vector_of(self, scalar: str) -> str:
        """Type of a vector; of one lane it is a scalar's."""
        return scalar if self.width == 1 else f"<{self.width} x {scalar}>"

    def as_wide(self, type_: str, value: Value) -> str:
        """The type of as many as a value has."""
        return self.vector_of(type_) if value.is_wide else type_

    def constant(self, number: float) -> Value:
        """A number, truth value or integer that is known."""
        if isinstance(number, bool):
            return Value(TRUTH, str(number).lower())
        if isinstance(number, int):
            return Value(INT, str(number))
        if self.real != DOUBLE:
            (number,) = struct.unpack("f", struct.pack("f", number))  # LLVM writes singles as the doubles that they are
        return Value(self.real, f"0x{struct.pack('>d', number).hex()}")  # to the last bit

    def negated(self, value: Value) -> Value:
        """Minus a value."""
        if not value.is_number:
            return self.emit(value.type, f"sub {value.type} zeroinitializer, {value.text}")
        return self.emit(value.type, f"fneg {_FAST} {value.type} {value.text}")

    def binary(self, op: type[ast.operator], left: Value, right: Value) -> Value:
        """An operation on two numbers."""
        if op is ast.Div and not left.is_number:
            left = self.number(left)
        left, right = self.alike(left, right)
        kind = f"{_FLOAT_OPERATIONS[op]} {_FAST}" if left.is_number else _INT_OPERATIONS[op]
        return self.emit(left.type, f"{kind} {left.type} {left.text}, {right.text}")

    def compared(self, comparison: type[ast.cmpop], left: Value, right: Value) -> Value:
        """Whether two numbers compare so."""
        left, right = self.alike(left, right)
        of_floats, of_integers = _COMPARISONS[comparison]
        kind = f"fcmp {of_floats}" if left.is_number else f"icmp {of_integers}"
        return self.emit(self.as_wide(TRUTH, left), f"{kind} {left.type} {left.text}, {right.text}")

    def both(self, word: str, left: Value, right: Value) -> Value:
        """``and`` or ``or`` of two truth values."""
        left, right = self.alike(left, right)
        return self.emit(left.type, f"{word} {left.type} {left.text}, {right.text}")

    def selected(self, test: Value, yes: Value, no: Value) -> Value:
        """One of two values that are both known."""
        yes, no = self.alike(yes, no)
        if test.is_wide:
            yes, no = self.wide(yes), self.wide(no)
        return self.emit(yes.type, f"select {test.type} {test.text}, {yes.type} {yes.text}, {no.type} {no.text}")

    def bits(self, scalar: str, value: Value) -> Value:
        """The same bits as another type."""
        type_ = self.as_wide(scalar, value)
        return self.emit(type_, f"bitcast {value.type} {value.text} to {type_}")

    def intrinsic(self, name: str, value: Value) -> Value:
        """A function of one number that processors have."""
        full = f"llvm.{name}.{f'v{self.width}' if value.is_wide else ''}{_FLOATS[value.scalar]}"
        self.declared[full] = f"declare {value.type} @{full}({value.type})"
        return self.emit(value.type, f"call {_FAST} {value.type} @{full}({value.type} {value.text})")

    def alike(self, left: Value, right: Value) -> tuple[Value, Value]:
        """Both numbers where one is, of the finer precision of the two; both vectors where one is."""
        if left.is_number or right.is_number:
            finer = DOUBLE if DOUBLE in (left.scalar, right.scalar) else self.real
            left, right = self.number(left, finer), self.number(right, finer)
        elif left.is_constant or right.is_constant:  # an integer has the bits that the other one asks for
            fixed, other = (left, right) if left.is_constant else (right, left)
            fixed = fixed._replace(type=other.scalar)
            left, right = (fixed, other) if left.is_constant else (other, fixed)
        if left.is_wide or right.is_wide:
            return self.wide(left), self.wide(right)
        return left, right

    def turned(self, value: Value, type_: str) -> Value:
        """A value as one of another type: an integer as a number, one as a vector of the same."""
        wanted = Value(type_, "")
        value = self.number(value, wanted.scalar) if wanted.is_number else value
        value = self.wide(value) if wanted.is_wide else value
        if value.type != type_:
            raise TypeError(f"a {value.type} is no {type_}")
        return value

    def number(self, value: Value, scalar: str | None = None) -> Value:
        """An integer as a number, a number in another precision; in that of the kernel unless another is asked for."""
        scalar = self.real if scalar is None else scalar
        if value.scalar in (scalar, TRUTH):
            return value
        type_ = self.as_wide(scalar, value)
        how = ("fpext" if scalar == DOUBLE else "fptrunc") if value.is_number else "sitofp"
        return self.emit(type_, f"{how} {value.type} {value.text} to {type_}")

    def integer(self, value: Value, type_: str) -> Value:
        """A number's whole part, or an integer with more or fewer bits."""
        if value.type == type_:
            return value
        how = "fptosi" if value.is_number else "sext" if type_ == INT else "trunc"
        return self.emit(type_, f"{how} {value.type} {value.text} to {type_}")

    def wide(self, value: Value) -> Value:
        """The same number in every lane."""
        if value.is_wide or self.width == 1:
            return value
        type_ = self.vector_of(value.type)
        if value.is_constant:
            return Value(type_, f"splat ({value.type} {value.text})")
        one = self.emit(type_, f"insertelement {type_} poison, {value.type} {value.text}, i32 0")
        none = f"<{self.width} x i32> zeroinitializer"
        return self.emit(type_, f"shufflevector {type_} {one.text}, {type_} poison, {none}")

    def load_at(self, place: str, type_: str) -> Value:
        """An element of an array, or those of a vector."""
        return self.emit(type_, f"load {type_}, ptr {place}, align {_BYTES[Value(type_, '').scalar]}")

    def store_at(self, value: Value, place: str, type_: str) -> None:
        """Make a value an element of an array, or a vector's values those from there on."""
        aligned = f"align {_BYTES[Value(type_, '').scalar]}"
        self.lines.append(f"  store {type_} {self.turned(value, type_).text}, ptr {place}, {aligned}")

    def element_of(self, array: Array, position: str) -> str:
        """Where an element of an array stands."""
        text = f"getelementptr inbounds {array.element}, ptr {array.start}, {INT} {position}"
        return self.emit("ptr", text).text
