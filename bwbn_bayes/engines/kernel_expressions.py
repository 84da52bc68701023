"""Expressions of a kernel's text, as instructions of LLVM."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence

from bwbn_bayes.engines.kernel_values import DOUBLE, INT, TRUTH, Array, Instructions, Precision, Value

_INTRINSICS = {"abs": "fabs", "np.ceil": "ceil", "np.rint": "rint", "np.exp2": "exp2", "np.log2": "log2"}


_VIEWS = {"np.ravel": None, "_doubles_at": DOUBLE, "_integers_at": INT}
"""What makes an array of another, or of an address and sizes; the type of the elements there."""


class Expressions(Instructions):
    """Values of expressions in one function.

    Attributes
    ----------
    lanes : dict or None
        Inside of a loop over lanes what its lines have made; None outside.
    first_lane : str
        There, the first lane of the vector at hand.
    """

    def __init__(
        self, precision: Precision, constants: Mapping[str, int | float], formulas: Mapping[str, ast.FunctionDef]
    ) -> None:
        super().__init__(precision)
        self.constants = constants
        self.formulas = formulas
        self.slots_at_entry: list[str] = []
        self.lanes: dict[str, Value] | None = None
        self.first_lane = ""
        self._slots: dict[str, Value] = {}
        self._arrays: dict[str, Array] = {}
        self._kept_arrays: dict[str, tuple[str, tuple[str, ...]]] = {}
        self._formula: dict[str, Value] | None = None
        self._places: dict[str, str] = {}

    def call(self, name: str, nodes: Sequence[ast.expr]) -> Value | None:
        """A call of another function of the kernel."""
        raise NotImplementedError(name)

    # --- variables ----------------------------------------------------------------------------------------------------

    def store(self, name: str, value: Value) -> None:
        """A variable, whose type is that of what it is first given."""
        if name not in self._slots:
            self._slots[name] = Value(value.type, f"%{name}.slot")
            self.slots_at_entry.append(f"  %{name}.slot = alloca {value.type}")
        slot = self._slots[name]
        value = self.turned(value, slot.type)
        self.lines.append(f"  store {value.type} {value.text}, ptr {slot.text}")

    def load(self, name: str) -> Value:
        """What a variable holds."""
        slot = self._slots[name]
        return self.emit(slot.type, f"load {slot.type}, ptr {slot.text}")

    def take(self, name: str, array: Array) -> None:
        """An array that stays what it is under a name."""
        self._arrays[name] = array

    def keep(self, name: str, array: Array) -> None:
        """An array under a name that may come to mean another: where it begins and its sizes are variables."""
        parts = [f"{name}.{number}" for number in range(1 + len(array.sizes))]
        self.store(parts[0], Value("ptr", array.start))
        for part, size in zip(parts[1:], array.sizes, strict=True):
            self.store(part, Value(INT, size))
        self._kept_arrays[name] = array.element, tuple(parts)

    def over_vectors(self, first_lane: str | None) -> None:
        """A loop over lanes begins with the vector of these, or ends."""
        self.lanes, self.first_lane, self._places = None if first_lane is None else {}, first_lane or "", {}

    # --- values -------------------------------------------------------------------------------------------------------

    def value(self, node: ast.expr) -> Value:
        """The value of an expression."""
        match node:
            case ast.Constant(value=bool() | int() | float() as number):
                return self.constant(number)
            case ast.Name(id=name):
                return self._named(name)
            case ast.Attribute() if ast.unparse(node) == "np.inf":
                return self.constant(float("inf"))
            case ast.Subscript():
                return self._element(node)
            case ast.UnaryOp() | ast.BinOp() | ast.Compare():
                return self._arithmetic(node)
            case ast.IfExp(test=test, body=body, orelse=other):
                return self._choice(test, body, other)
            case ast.BoolOp(op=junction, values=parts):
                return self._joined(junction, parts)
            case ast.Call(func=function, args=nodes):
                return self._called(ast.unparse(function), nodes)
        raise NotImplementedError(f"{ast.unparse(node)} is nothing that a kernel may hold")

    def _named(self, name: str) -> Value:
        for known in (self._formula, self.lanes):
            if known is not None and name in known:
                return known[name]
        return self.constant(self.constants[name]) if name in self.constants else self.load(name)

    def _element(self, node: ast.Subscript) -> Value:
        if isinstance(node.value, ast.Attribute):  # array.shape[axis]
            array, axis = self.array(node.value.value), self.known(node.slice)
            assert array is not None
            assert axis is not None
            return Value(INT, array.sizes[axis])
        place, type_ = self.place(node)
        return self.load_at(place, type_)

    def _arithmetic(self, node: ast.UnaryOp | ast.BinOp | ast.Compare) -> Value:
        match node:
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as number)):
                return self.constant(-number)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.negated(self.value(operand))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.emit(TRUTH, f"xor {TRUTH} {self.value(operand).text}, true")
            case ast.BinOp(left=left, op=op, right=right):
                return self.binary(type(op), self.value(left), self.value(right))
            case ast.Compare(left=left, ops=[comparison], comparators=[right]):
                return self.compared(type(comparison), self.value(left), self.value(right))
        raise NotImplementedError(f"{ast.unparse(node)} is nothing that a kernel may hold")

    def choose(self, test: ast.expr, yes: Callable[[], None], no: Callable[[], None]) -> None:
        """Do one of two; where a name in capitals says which, the other is not written."""
        if isinstance(test, ast.Name) and test.id in self.constants:
            (yes if self.constants[test.id] else no)()
            return
        then, other, end = self.name("then"), self.name("else"), self.name("end")
        self.branch(self.value(test), then, other)
        for name, write in ((then, yes), (other, no)):
            self.label(name)
            write()
            self.go(end)
        self.label(end)

    def _choice(self, test: ast.expr, body: ast.expr, other: ast.expr) -> Value:
        """``body if test else other``; of scalars only the one is evaluated, which may be all that there is."""
        if self.lanes is not None or self._formula is not None:
            return self.selected(self.value(test), self.value(body), self.value(other))
        chosen = self.name("chosen")
        self.choose(test, lambda: self.store(chosen, self.value(body)), lambda: self.store(chosen, self.value(other)))
        return self.load(chosen)

    def _joined(self, junction: ast.boolop, parts: Sequence[ast.expr]) -> Value:
        """``and`` and ``or``; of scalars what comes later is asked only where it matters."""
        is_and, (first, *rest) = isinstance(junction, ast.And), parts
        if not rest:
            return self.value(first)
        later = ast.BoolOp(op=junction, values=rest)
        if self.lanes is not None:
            return self.both("and" if is_and else "or", self.value(first), self.value(later))
        fixed = ast.Constant(value=not is_and)
        return self._choice(first, *((later, fixed) if is_and else (fixed, later)))

    def _called(self, name: str, nodes: Sequence[ast.expr]) -> Value:
        if name in self.formulas:
            return self._put(self.formulas[name], [self.value(node) for node in nodes])
        match name:
            case "_bits":
                return self.bits(self.bits_type, self.value(nodes[0]))
            case "_from_bits":
                return self.bits(self.real, self.value(nodes[0]))
            case "float":
                return self.number(self.value(nodes[0]))
            case "double":
                return self.number(self.value(nodes[0]), DOUBLE)
            case "int":
                return self.integer(self.value(nodes[0]), INT)
            case "min" | "max":
                first, other = map(self.value, nodes)  # the first where either is no number, as in Python
                is_beyond = self.compared(ast.Lt if name == "min" else ast.Gt, other, first)
                return self.selected(is_beyond, other, first)
            case _ if name in _INTRINSICS:
                return self.intrinsic(_INTRINSICS[name], self.value(nodes[0]))
        found = self.call(name, nodes)
        assert found is not None
        return found

    def _put(self, formula: ast.FunctionDef, given: Sequence[Value]) -> Value:
        """A formula's lines in the place of its call."""
        outer = self._formula
        self._formula = dict(zip((one.arg for one in formula.args.args), given, strict=True))
        *lines, last = [line for line in formula.body if not isinstance(line, ast.Expr)]
        for line in lines:
            assert isinstance(line, ast.Assign)
            self._formula[ast.unparse(line.targets[0])] = self.value(line.value)
        assert isinstance(last, ast.Return)
        assert last.value is not None
        result = self.value(last.value)
        self._formula = outer
        return result

    # --- arrays -------------------------------------------------------------------------------------------------------

    def array(self, node: ast.expr) -> Array | None:
        """An array, a row of one, what remains of one from an element or row on, or another view; None otherwise."""
        match node:
            case ast.Name(id=name) if name in self._kept_arrays:
                element, (start, *sizes) = self._kept_arrays[name]
                return Array(element, self.load(start).text, tuple(self.load(size).text for size in sizes))
            case ast.Name(id=name):
                return self._arrays.get(name)
            case ast.Subscript(value=ast.Name() as name, slice=ast.Slice(lower=lower)) if lower is not None:
                whole, first = self.array(name), self.value(lower)
                assert whole is not None
                left = self.emit(INT, f"sub {INT} {whole.sizes[0]}, {first.text}")
                for size in whole.sizes[1:]:
                    first = self.binary(ast.Mult, first, Value(INT, size))
                return Array(whole.element, self.element_of(whole, first.text), (left.text, *whole.sizes[1:]))
            case ast.Subscript(value=ast.Name() as name, slice=row) if not isinstance(row, ast.Tuple):
                whole = self.array(name)
                if whole is not None and len(whole.sizes) == 2:
                    first = self.binary(ast.Mult, self.value(row), Value(INT, whole.sizes[1]))
                    return Array(whole.element, self.element_of(whole, first.text), whole.sizes[1:])
            case ast.Call(func=function, args=[first_node, *sizes]) if ast.unparse(function) in _VIEWS:
                return self._view(_VIEWS[ast.unparse(function)], first_node, sizes)
            case ast.Call(func=ast.Name(id="_own" | "_own_doubles" as name), args=[size]):
                return self._room(self.real if name == "_own" else DOUBLE, size)
        return None

    def _room(self, element: str, size: ast.expr) -> Array:
        """Room of a call's own, for so many numbers as is known beforehand."""
        number, start = self.known(size), f"%{self.name('own')}"
        assert number is not None, f"{ast.unparse(size)} is not known beforehand"
        self.slots_at_entry.append(f"  {start} = alloca [{number} x {element}]")
        return Array(element, start, (str(number),))

    def _view(self, element: str | None, node: ast.expr, sizes: Sequence[ast.expr]) -> Array:
        """An array as one long row, or the numbers that stand at an address."""
        if element is not None:
            start = self.emit("ptr", f"inttoptr {INT} {self.value(node).text} to ptr")
            return Array(element, start.text, tuple(self.value(size).text for size in sizes))
        whole = self.array(node)
        assert whole is not None, f"{ast.unparse(node)} is no array"
        length = Value(INT, "1")
        for size in whole.sizes:
            length = self.binary(ast.Mult, length, Value(INT, size))
        return Array(whole.element, whole.start, (length.text,))

    def place(self, node: ast.Subscript) -> tuple[str, str]:
        """Where an element stands and its type, a vector where the index holds the lane."""
        array = self.array(node.value)
        assert array is not None, f"{ast.unparse(node.value)} is no array"
        if isinstance(node.slice, ast.Tuple):
            row, column = map(self.value, node.slice.elts)
            first = self.binary(ast.Mult, row, Value(INT, array.sizes[1]))
            return self.element_of(array, self.binary(ast.Add, first, column).text), array.element
        terms = {term: self.known(term) for term in _terms(node.slice)}
        fixed = sum(number for number in terms.values() if number is not None)
        moving = [term for term, number in terms.items() if number is None]
        is_row = self.lanes is not None and any(ast.unparse(term) == "l" for term in moving)
        start = self._start(array, ast.unparse(node.value), moving)
        place = self.element_of(array._replace(start=start), str(fixed)) if fixed else start
        return place, self.vector_of(array.element) if is_row else array.element

    def _start(self, array: Array, name: str, moving: Sequence[ast.expr]) -> str:
        """Where the elements stand that differ by what is known beforehand; found once in a loop over lanes."""
        key = " ".join([name, *map(ast.unparse, moving)])
        if self.lanes is not None and key in self._places:
            return self._places[key]
        start = array.start
        for term in moving:
            is_lane = self.lanes is not None and ast.unparse(term) == "l"
            position = self.first_lane if is_lane else self.value(term).text
            start = self.element_of(array._replace(start=start), position)
        if self.lanes is not None:
            self._places[key] = start
        return start

    def known(self, node: ast.expr) -> int | None:
        """An integer that is known beforehand."""
        match node:
            case ast.Constant(value=int() as number):
                return number
            case ast.Name(id=name):
                fixed = self.constants.get(name)
                return fixed if isinstance(fixed, int) else None
            case ast.BinOp(left=left, op=ast.Mult() | ast.Add() as op, right=right):
                one, other = self.known(left), self.known(right)
                if one is not None and other is not None:
                    return one * other if isinstance(op, ast.Mult) else one + other
        return None


def _terms(node: ast.expr) -> list[ast.expr]:
    """What is added up in an index."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [*_terms(node.left), *_terms(node.right)]
    return [node]
