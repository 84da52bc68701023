"""What a lane kernel's text computes with, as LLVM writes it: numbers, vectors of them, arrays."""

from __future__ import annotations

import ast
import struct
from typing import NamedTuple

FLOAT, INT, TRUTH = "double", "i64", "i1"
WIDTH = 8
"""Lanes of a vector: as many as a register of 512 bits holds. With all sixteen at once derivatives took a third longer,
since twice as many registers are asked for."""
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


def vector_of(scalar: str) -> str:
    """Type of a vector."""
    return f"<{WIDTH} x {scalar}>"


def as_wide(type_: str, value: Value) -> str:
    """The type of as many as a value has."""
    return vector_of(type_) if value.is_wide else type_


def constant(number: float) -> Value:
    """A number, truth value or integer that is known."""
    if isinstance(number, bool):
        return Value(TRUTH, str(number).lower())
    if isinstance(number, int):
        return Value(INT, str(number))
    return Value(FLOAT, f"0x{struct.pack('>d', number).hex()}")  # to the last bit


class Instructions:
    """Writes instructions one after the other."""

    def __init__(self) -> None:
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

    def negated(self, value: Value) -> Value:
        """Minus a value."""
        if value.scalar == INT:
            return self.emit(value.type, f"sub {value.type} zeroinitializer, {value.text}")
        return self.emit(value.type, f"fneg {_FAST} {value.type} {value.text}")

    def binary(self, op: type[ast.operator], left: Value, right: Value) -> Value:
        """An operation on two numbers."""
        if op is ast.Div:
            left, right = self.number(left), self.number(right)
        left, right = self.alike(left, right)
        kind = f"{_FLOAT_OPERATIONS[op]} {_FAST}" if left.scalar == FLOAT else _INT_OPERATIONS[op]
        return self.emit(left.type, f"{kind} {left.type} {left.text}, {right.text}")

    def compared(self, comparison: type[ast.cmpop], left: Value, right: Value) -> Value:
        """Whether two numbers compare so."""
        left, right = self.alike(left, right)
        of_floats, of_integers = _COMPARISONS[comparison]
        kind = f"fcmp {of_floats}" if left.scalar == FLOAT else f"icmp {of_integers}"
        return self.emit(as_wide(TRUTH, left), f"{kind} {left.type} {left.text}, {right.text}")

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
        type_ = as_wide(scalar, value)
        return self.emit(type_, f"bitcast {value.type} {value.text} to {type_}")

    def intrinsic(self, name: str, value: Value) -> Value:
        """A function of one number that processors have."""
        full = f"llvm.{name}.{f'v{WIDTH}f64' if value.is_wide else 'f64'}"
        self.declared[full] = f"declare {value.type} @{full}({value.type})"
        return self.emit(value.type, f"call {_FAST} {value.type} @{full}({value.type} {value.text})")

    def alike(self, left: Value, right: Value) -> tuple[Value, Value]:
        """Both numbers where one is, both vectors where one is."""
        if FLOAT in (left.scalar, right.scalar):
            left, right = self.number(left), self.number(right)
        if left.is_wide or right.is_wide:
            return self.wide(left), self.wide(right)
        return left, right

    def turned(self, value: Value, type_: str) -> Value:
        """A value as one of another type: an integer as a number, one as a vector of the same."""
        wanted = Value(type_, "")
        value = self.number(value) if wanted.scalar == FLOAT else value
        value = self.wide(value) if wanted.is_wide else value
        if value.type != type_:
            raise TypeError(f"a {value.type} is no {type_}")
        return value

    def number(self, value: Value) -> Value:
        """An integer as a number."""
        if value.scalar != INT:
            return value
        type_ = as_wide(FLOAT, value)
        return self.emit(type_, f"sitofp {value.type} {value.text} to {type_}")

    def wide(self, value: Value) -> Value:
        """The same number in every lane."""
        if value.is_wide:
            return value
        type_ = vector_of(value.type)
        if not value.text.startswith("%"):
            return Value(type_, f"splat ({value.type} {value.text})")
        one = self.emit(type_, f"insertelement {type_} poison, {value.type} {value.text}, i32 0")
        none = f"<{WIDTH} x i32> zeroinitializer"
        return self.emit(type_, f"shufflevector {type_} {one.text}, {type_} poison, {none}")

    def element_of(self, array: Array, position: str) -> str:
        """Where an element of an array stands."""
        text = f"getelementptr inbounds {array.element}, ptr {array.start}, {INT} {position}"
        return self.emit("ptr", text).text
