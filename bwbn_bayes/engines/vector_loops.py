"""Loops over lanes, handed to LLVM as operations on whole vectors.

The innermost loops of a lane kernel are hundreds of lines of plain arithmetic. numba's own way to LLVM (types, analyses
of each line) took 10 to 15 s a law, LLVM itself three; and whether a loop became vectors was the loop vectoriser's to
decide. Here such a loop is read with ``ast`` and emitted as operations on vectors, behind a function that numba takes
as one instruction.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

_FLAGS = ("contract", "reassoc", "arcp", "nsz")
"""Fast-math flags of every operation; never ``nnan`` or ``ninf``: a draw that runs away must be seen."""
_WIDTH = 8
"""Lanes of a vector: as many as a register of 512 bits holds. With all sixteen at once derivatives took a third longer,
since twice as many registers are asked for."""
_LEAST_LINES = 2
"""Loops of fewer lines are left to numba."""
_FLOAT, _INT = ir.DoubleType(), ir.IntType(64)
_FLOAT_OPERATIONS = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_INT_OPERATIONS = {ast.Add: "add", ast.Sub: "sub", ast.LShift: "shl", ast.RShift: "ashr", ast.BitAnd: "and_"}
_COMPARISONS = {ast.Gt: ">", ast.Lt: "<", ast.GtE: ">=", ast.LtE: "<=", ast.Eq: "==", ast.NotEq: "!="}
_INTRINSICS = {"abs": "fabs", "np.ceil": "ceil", "np.rint": "rint"}


def in_vectors(source: str) -> str:
    """The source of a kernel with its longer loops over lanes in vectors.

    Parameters
    ----------
    source : str
        A module in which integers are assigned to names in capitals, ``LANES`` among them. A loop over
        ``range(LANES)`` is converted where it holds nothing but assignments to names, which nobody needs after it, and
        to elements one lane apart.
    """
    tree = ast.parse(source)
    whole = {node.targets[0].id: node for node in tree.body if _is_constant(node)}  # type: ignore[attr-defined]
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    loops: list[str] = []

    class Convert(ast.NodeTransformer):
        def visit_For(self, node: ast.For) -> ast.stmt:
            self.generic_visit(node)
            if ast.unparse(node.iter) != "range(LANES)" or not _is_plain(node.body):
                return node
            used = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
            given = _given(node.body, {*whole, *functions, "l", "abs", "np"})
            helpers = [ast.unparse(functions[name]).split("\n", 1)[1] for name in sorted(used & {*functions})]
            body = "\n".join([*helpers, *map(ast.unparse, node.body)])
            name = f"_loop_{len(loops)}"
            loops.append(f"{name} = vector_loop({given!r}, CONSTANTS, {body!r})")
            return ast.parse(f"{name}({', '.join(given)})").body[0]

    converted = Convert().visit(tree)
    first = next(i for i, node in enumerate(converted.body) if isinstance(node, ast.FunctionDef))
    constants = f"CONSTANTS = {{{', '.join(f'{name!r}: {name}' for name in whole)}}}"
    head = f"from bwbn_bayes.engines.vector_loops import vector_loop  # {_own_hash()}"
    added = ast.parse("\n".join([head, constants, *loops])).body
    converted.body[first:first] = added
    # The hash makes kernels anew where this module changes; a comment would not outlive the parser.
    return f"# {_own_hash()}\n{ast.unparse(ast.fix_missing_locations(converted))}\n"


def vector_loop(given: Sequence[str], constants: Mapping[str, int], body: str) -> Callable[..., None]:
    """A function for numba that runs the body of a loop for all lanes, a vector of them at a time.

    Parameters
    ----------
    given : sequence of str
        Names that the body takes from outside, in the order of the arguments: arrays, integers and numbers.
    constants : mapping of str to int
        Integers known by name, ``LANES`` among them.
    body : str
        Assignments, after the functions that they call.
    """
    lines = ast.parse(body).body

    def typed(*arguments: Any) -> tuple[Signature, Callable[..., Any]]:
        def generate(context: Any, builder: ir.IRBuilder, signature: Signature, values: Sequence[ir.Value]) -> Any:
            emitter = _Emitter(builder, constants)
            for name, kind, value in zip(given, signature.args, values, strict=True):
                emitter.take(context, name, kind, value)
            with cgutils.for_range(builder, ir.Constant(_INT, constants["LANES"] // _WIDTH)) as part:
                emitter.first_lane = builder.mul(part.index, ir.Constant(_INT, _WIDTH))
                for line in lines:
                    emitter.run(line)
            return context.get_dummy_value()

        return types.void(*arguments), generate

    scope: dict[str, Any] = {"typed": typed}
    exec(f"def loop(typing_context, {', '.join(given)}): return typed({', '.join(given)})", scope)
    made: Callable[..., None] = intrinsic(scope["loop"])
    return made


def _is_constant(node: ast.stmt) -> bool:
    return isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id.isupper()


def _is_plain(body: Sequence[ast.stmt]) -> bool:
    """Whether a loop's body can be converted, and is worth it."""
    if len(body) < _LEAST_LINES or not all(isinstance(line, ast.Assign) for line in body):
        return False
    places = [node.slice for line in body for node in ast.walk(line) if isinstance(node, ast.Subscript)]
    return not any(isinstance(node, (ast.Subscript, ast.Slice)) for place in places for node in ast.walk(place))


def _given(body: Sequence[ast.stmt], known: set[str]) -> list[str]:
    """Names that lines take from outside."""
    found: dict[str, None] = {}
    made: set[str] = set()
    for line in body:
        names = [node for node in ast.walk(line) if isinstance(node, ast.Name)]
        found |= {n.id: None for n in names if isinstance(n.ctx, ast.Load) and n.id not in known | made}
        made |= {n.id for n in names if isinstance(n.ctx, ast.Store)}
    return list(found)


def _own_hash() -> str:
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:12]


class _Emitter:
    """Emits lines as instructions: numbers of each lane are vectors, what all lanes share stays a scalar."""

    def __init__(self, builder: ir.IRBuilder, constants: Mapping[str, int]) -> None:
        self.builder = builder
        self.constants = constants
        self.first_lane: ir.Value = ir.Constant(_INT, 0)
        self.values: dict[str, ir.Value] = {}
        self.arrays: dict[str, ir.Value] = {}
        self.functions: dict[str, ast.FunctionDef] = {}
        self.places: dict[tuple[str, int, bool], ir.Value] = {}

    def take(self, context: Any, name: str, kind: Any, value: ir.Value) -> None:
        """An argument of the loop."""
        if isinstance(kind, types.Array):
            self.arrays[name] = context.make_array(kind)(context, self.builder, value).data
        else:
            self.values[name] = value

    def run(self, line: ast.stmt) -> None:
        """One line."""
        if isinstance(line, ast.FunctionDef):
            self.functions[line.name] = line
            return
        assert isinstance(line, ast.Assign)
        value = self.value(line.value)
        target = line.targets[0]
        if isinstance(target, ast.Name):
            self.values[target.id] = value
            return
        assert isinstance(target, ast.Subscript)
        place, is_row = self._place(target)
        assert is_row
        self.builder.store(self._wide(value), place, align=8)

    def value(self, node: ast.expr) -> ir.Value:
        """The value of an expression."""
        match node:
            case ast.Constant(value=number):
                return ir.Constant(_FLOAT if isinstance(number, float) else _INT, number)
            case ast.Name(id=name):
                return self.values[name]
            case ast.Subscript():
                place, _ = self._place(node)
                return self.builder.load(place, align=8)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self._negative(self.value(operand))
            case ast.BinOp(left=left, op=op, right=right):
                return self._binary(type(op), self.value(left), self.value(right))
            case ast.IfExp(test=test, body=body, orelse=other):
                return self._choice(self.value(test), self.value(body), self.value(other))
            case ast.Compare(left=left, ops=[comparison], comparators=[right]):
                pair = self._alike(self.value(left), self.value(right))
                return self.builder.fcmp_ordered(_COMPARISONS[type(comparison)], *pair)
            case ast.BoolOp(op=junction, values=parts):
                joined = self.builder.and_ if isinstance(junction, ast.And) else self.builder.or_
                return reduce(lambda one, other: joined(*self._alike(one, other)), map(self.value, parts))
            case ast.Call(func=function, args=arguments):
                return self._call(ast.unparse(function), [self.value(one) for one in arguments])
        raise NotImplementedError(f"{ast.unparse(node)} is nothing that a loop over lanes may hold")

    def _place(self, node: ast.Subscript) -> tuple[ir.Value, bool]:
        """Pointer to the element of an array, to a row of lanes where the index holds the lane."""
        array = ast.unparse(node.value)
        fixed, moving, is_row = self._index(node.slice)
        key = array, id(moving), is_row
        if key not in self.places:
            start = self.arrays[array]
            start = start if moving is None else self.builder.gep(start, [moving])
            self.places[key] = self.builder.gep(start, [self.first_lane]) if is_row else start
        place = self.builder.gep(self.places[key], [ir.Constant(_INT, fixed)])
        return (self.builder.bitcast(place, self._vector(_FLOAT).as_pointer()) if is_row else place), is_row

    def _index(self, node: ast.expr) -> tuple[int, ir.Value | None, bool]:
        """A known part, an unknown one, and whether the lane is added."""
        match node:
            case ast.Constant(value=int() as number):
                return number, None, False
            case ast.Name(id="l"):
                return 0, None, True
            case ast.Name(id=name) if name in self.constants:
                return self.constants[name], None, False
            case ast.Name(id=name):
                return 0, self.values[name], False
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                parts = self._index(left), self._index(right)
                assert all(moving is None and not is_row for _, moving, is_row in parts)
                return parts[0][0] * parts[1][0], None, False
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                (a, moving, is_row), (b, other, row_too) = self._index(left), self._index(right)
                both = moving if other is None else other if moving is None else self.builder.add(moving, other)
                return a + b, both, is_row or row_too
        raise NotImplementedError(f"{ast.unparse(node)} is no index of a loop over lanes")

    def _binary(self, op: type[ast.operator], left: ir.Value, right: ir.Value) -> ir.Value:
        left, right = self._alike(left, right)
        if _scalar(left.type) == _FLOAT:
            return getattr(self.builder, _FLOAT_OPERATIONS[op])(left, right, flags=_FLAGS)
        return getattr(self.builder, _INT_OPERATIONS[op])(left, right)

    def _negative(self, value: ir.Value) -> ir.Value:
        if isinstance(value, ir.Constant) and not isinstance(value.type, ir.VectorType):
            return ir.Constant(value.type, -value.constant)
        return self.builder.fneg(value, flags=_FLAGS)

    def _choice(self, test: ir.Value, body: ir.Value, other: ir.Value) -> ir.Value:
        if isinstance(test.type, ir.VectorType):
            body, other = self._wide(body), self._wide(other)
        return self.builder.select(test, *self._alike(body, other))

    def _call(self, name: str, arguments: Sequence[ir.Value]) -> ir.Value:
        if name in ("_bits", "_from_bits"):
            scalar = _INT if name == "_bits" else _FLOAT
            (value,) = arguments
            is_row = isinstance(value.type, ir.VectorType)
            return self.builder.bitcast(value, self._vector(scalar) if is_row else scalar)
        if name in _INTRINSICS:
            (value,) = map(self._wide, arguments)
            called = ir.FunctionType(value.type, [value.type])
            named = f"llvm.{_INTRINSICS[name]}.v{_WIDTH}f64"
            return self.builder.call(cgutils.get_or_insert_function(self.builder.module, called, named), [value])
        function, outer = self.functions[name], self.values
        self.values = dict(zip((one.arg for one in function.args.args), arguments, strict=True))
        *lines, last = [line for line in function.body if not isinstance(line, ast.Expr)]
        for line in lines:
            self.run(line)
        assert isinstance(last, ast.Return) and last.value is not None
        result = self.value(last.value)
        self.values = outer
        return result

    def _alike(self, left: ir.Value, right: ir.Value) -> tuple[ir.Value, ir.Value]:
        """Both vectors where one is."""
        if any(isinstance(one.type, ir.VectorType) for one in (left, right)):
            return self._wide(left), self._wide(right)
        return left, right

    def _wide(self, value: ir.Value) -> ir.Value:
        """The same number in every lane."""
        if isinstance(value.type, ir.VectorType):
            return value
        wide = self._vector(value.type)
        if isinstance(value, ir.Constant):
            return ir.Constant(wide, [value.constant] * _WIDTH)
        one = self.builder.insert_element(ir.Constant(wide, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
        none = ir.Constant(ir.VectorType(ir.IntType(32), _WIDTH), [0] * _WIDTH)
        return self.builder.shuffle_vector(one, ir.Constant(wide, ir.Undefined), none)

    def _vector(self, scalar: ir.Type) -> ir.VectorType:
        return ir.VectorType(scalar, _WIDTH)


def _scalar(kind: ir.Type) -> ir.Type:
    return kind.element if isinstance(kind, ir.VectorType) else kind
