"""Machine code from the text of a kernel, which is written in a small part of Python.

numba took nine tenths of a kernel's seconds for what it needs to know about any Python: types, reference counts,
wrappers, and two rounds of optimising for each of thirty functions. Here the text is read with ``ast`` and written as
LLVM's own, which is optimised once. A kernel holds integers, numbers, truth values, and arrays of numbers or integers
in one or two dimensions, row after row; functions of these, each called with arguments of the same kinds everywhere;
loops over ranges, ``while``, ``if``. Names in capitals are numbers known beforehand, ``LANES`` among them: an ``if``
that asks one alone is decided beforehand, too. Functions whose name begins with an underscore are formulas, put where
they are called. A number has 64 bits, or 32 where the text says ``BITS = 32``; what is called double has 64 in both,
and so has what is made of the two together. A function whose text is ``...`` is one of a library that is loaded. An
array goes to it as its address; a function's name is its address, to be called back at; ``_doubles_at(address, size)``
and ``_integers_at`` are the arrays that it gives. ``_own(size)`` and ``_own_doubles`` are room of a call's own.

A loop over ``range(LANES)`` becomes operations on whole vectors where it holds nothing but assignments to names, which
nobody needs after it, and to elements one lane apart. For a graphics card, whose threads are lanes of its own, a text
has one.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import llvmlite.binding as llvm

from bwbn_bayes.engines.kernel_expressions import Expressions
from bwbn_bayes.engines.kernel_values import (
    DOUBLE,
    INT,
    PRECISIONS,
    SHORT,
    TRUTH,
    Array,
    Precision,
    Value,
)

Kind = str | tuple[str, int]
"""Type of a scalar; or of an array's elements, and how many dimensions it has."""
KINDS: dict[str, Kind] = {
    "int": INT,
    "int32": SHORT,
    "float": "real",
    "double": DOUBLE,
    "bool": TRUTH,
    "floats": ("real", 1),
    "floats_2d": ("real", 2),
    "doubles": (DOUBLE, 1),
    "integers": (INT, 1),
    "integers_2d": (INT, 2),
}
"""Kinds of what a kernel takes from outside and returns, as its text annotates it; real are its own numbers."""
IN_A_ROW = ".in_a_row"
_WRITTEN_OUT, HINTS = ", !llvm.loop !0", '!0 = distinct !{!0, !1}\n!1 = !{!"llvm.loop.unroll.full"}'
"""What a loop says that is to be written out, and what that means."""
# Vectors of 512 bits where there are such: processors tuned for half of that take a fifth longer.
_ATTRIBUTES = 'nounwind "prefer-vector-width"="512"'


@dataclass(frozen=True, kw_only=True)
class Signature:
    """What a function takes from outside, by name, as it is annotated and its kind, and the type that it returns.

    The type is None where it returns nothing.
    """

    names: tuple[str, ...]
    parameters: tuple[tuple[str, Kind], ...]
    returns: str | None


@dataclass(frozen=True, kw_only=True)
class _Compiled:
    """A function in LLVM's text, the kinds of its parameters, and the type that it returns.

    One of a library takes of an array only where it begins.
    """

    text: str
    kinds: tuple[Kind, ...]
    returns: str
    is_of_library: bool = False


@dataclass(frozen=True, kw_only=True)
class Module:
    """A kernel's text: its functions, the numbers that it knows beforehand, and what has been compiled of it.

    Parameters
    ----------
    functions, constants : dict
        By name.
    entries : frozenset of str
        Functions that are called from outside.
    written_out : frozenset of str
        Loops up to these are written out, where :data:`HINTS` are given.
    compiled, declared : dict
        Functions in LLVM's text, and what they call of LLVM's own, by name.
    """

    functions: dict[str, ast.FunctionDef]
    constants: dict[str, int | float]
    entries: frozenset[str] = frozenset()
    written_out: frozenset[str] = frozenset()
    compiled: dict[str, _Compiled] = field(default_factory=dict)
    declared: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, source: str, entries: Sequence[str] = (), written_out: Iterable[str] = ()) -> Module:
        """A kernel's text, read, of which some functions are called from outside."""
        body, constants = ast.parse(source).body, dict[str, int | float]()
        for node in body:
            if isinstance(node, ast.Assign):
                constants[ast.unparse(node.targets[0])] = eval(ast.unparse(node.value), {}, constants)
        return cls(
            functions={node.name: node for node in body if isinstance(node, ast.FunctionDef)},
            constants=constants,
            entries=frozenset(entries),
            written_out=frozenset(written_out),
        )

    @property
    def texts(self) -> list[str]:
        """Its functions in LLVM's text."""
        return [*self.declared.values(), *(one.text for one in self.compiled.values())]

    @property
    def precision(self) -> Precision:
        """What it computes with, in vectors of no more lanes than there are."""
        known = PRECISIONS[int(self.constants.get("BITS", 64))]
        return known._replace(width=min(known.width, int(self.constants.get("LANES", known.width))))

    def signature(self, name: str) -> Signature:
        """How the text annotates a function."""
        node = self.functions[name]
        written = [ast.unparse(one.annotation) for one in node.args.args if one.annotation is not None]
        returns = None if node.returns is None else self.kind(ast.unparse(node.returns))
        assert len(written) == len(node.args.args), f"{name} does not say what it takes"
        assert not isinstance(returns, tuple), f"{name} returns an array"
        names = tuple(one.arg for one in node.args.args)
        return Signature(names=names, parameters=tuple((one, self.kind(one)) for one in written), returns=returns)

    def kind(self, name: str) -> Kind:
        """The kind of an argument that is annotated so."""
        match KINDS[name]:
            case "real":
                return self.precision.real
            case ("real", int() as n_sizes):
                return self.precision.real, n_sizes
            case other:
                return other

    def called(self, name: str, kinds: tuple[Kind, ...]) -> _Compiled:
        """A function that is called with such arguments, compiled when this first happens, with all that it calls."""
        if name in self.compiled:
            return self.compiled[name]
        is_outside = name in self.entries or _is_of_library(self.functions[name])
        return self.from_outside(name) if is_outside else self._written(name, kinds, None)

    def from_outside(self, name: str) -> _Compiled:
        """A function that others than this text call, or that a library holds."""
        if name in self.compiled:
            return self.compiled[name]
        signature = self.signature(name)
        kinds = tuple(kind for _, kind in signature.parameters)
        if not _is_of_library(self.functions[name]):
            return self._written(name, kinds, signature)
        returns = signature.returns or "void"
        words = ", ".join("ptr" if isinstance(kind, tuple) else kind for kind in kinds)
        text = f"declare {returns} @{name}({words})"
        self.compiled[name] = _Compiled(text=text, kinds=kinds, returns=returns, is_of_library=True)
        return self.compiled[name]

    def _written(self, name: str, kinds: tuple[Kind, ...], signature: Signature | None) -> _Compiled:
        writer = _Writer(self)
        made = writer.function(self.functions[name], kinds, signature)
        self.declared.update(writer.declared)
        self.compiled[name] = made
        return made


def _is_of_library(node: ast.FunctionDef) -> bool:
    """Whether a function's text is ``...``: a library holds it."""
    first = node.body[0]
    return isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and first.value.value is ...


def signatures(source: str, entries: Sequence[str]) -> dict[str, Signature]:
    """What functions of a kernel's text take and return."""
    module = Module.of(source)
    return {entry: module.signature(entry) for entry in entries}


def object_code(source: str, *entries: str) -> bytes:
    """An object file for this processor with functions of a kernel's text, and all that they call.

    Parameters
    ----------
    source : str
        The text.
    entries : str
        Functions whose arguments and results are annotated by :data:`KINDS`. They take truth values as integers and
        each array as where it begins and its sizes. Beside each stands one named with :data:`IN_A_ROW` that takes where
        these words stand, eight bytes each: quicker to call from Python than one with many arguments.
    """
    module = Module.of(source, entries)
    rows = [_in_a_row(entry, module.from_outside(entry)) for entry in entries]
    machine = target_machine()
    return bytes(machine.emit_object(optimised(assembled([*module.texts, *rows], machine), machine)))


def assembled(texts: Sequence[str], machine: llvm.TargetMachine) -> llvm.ModuleRef:
    """Functions in LLVM's text, read for a machine."""
    code = llvm.parse_assembly("\n".join(texts))
    code.triple, code.data_layout = machine.triple, str(machine.target_data)
    return code


def optimised(code: llvm.ModuleRef, machine: llvm.TargetMachine) -> llvm.ModuleRef:
    """Functions as the machine's best code."""
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization, options.slp_vectorization = True, False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(code, builder)
    return code


def _in_a_row(name: str, entry: _Compiled) -> str:
    types: list[str] = []
    for kind in entry.kinds:
        types += ["ptr", *[INT] * kind[1]] if isinstance(kind, tuple) else [INT if kind == TRUTH else kind]
    lines = [f"define {entry.returns} @{name}{IN_A_ROW}(ptr %words) {_ATTRIBUTES} {{"]
    for number, type_ in enumerate(types):
        lines.append(f"  %place{number} = getelementptr inbounds {INT}, ptr %words, {INT} {number}")
        lines.append(f"  %word{number} = load {type_}, ptr %place{number}, align 1")
    words = ", ".join(f"{type_} %word{number}" for number, type_ in enumerate(types))
    call = f"call {entry.returns} @{name}({words}) noinline"
    lines += [f"  {call}", "  ret void"] if entry.returns == "void" else [f"  %r = {call}", f"  ret {entry.returns} %r"]
    return "\n".join([*lines, "}"])


def target_machine() -> llvm.TargetMachine:
    """The processor of this machine."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=3,
        # x86 asks for addresses as they are when code is made for this process, others for what LLVM takes by itself.
        reloc="static" if target.name.startswith("x86") else "default",
        codemodel="jitdefault",
        jit=True,
    )


class _Writer(Expressions):
    """Writes one function."""

    def __init__(self, module: Module) -> None:
        formulas = {name: one for name, one in module.functions.items() if name.startswith("_")}
        super().__init__(module.precision, module.constants, formulas)
        self.module = module
        self.leave: list[str] = []
        self.returned: Value | None = None

    def function(self, node: ast.FunctionDef, kinds: tuple[Kind, ...], signature: Signature | None) -> _Compiled:
        """The whole function; what it must return is known where it is called from outside."""
        parameters: list[str] = []
        for argument, kind in zip(node.args.args, kinds, strict=True):
            parameters += self._parameter(argument.arg, kind, is_entry=signature is not None)
        self._run(node.body)
        if signature is not None:
            self._promised(node.name, signature.returns)
        returns = "void" if self.returned is None else self.returned.type
        self.lines.append("  ret void" if self.returned is None else f"  ret {returns} {self.returned.text}")
        linkage = "internal " if signature is None else ""
        opening = f"define {linkage}{returns} @{node.name}({', '.join(parameters)}) {_ATTRIBUTES} {{"
        text = "\n".join([opening, "entry:", *self.slots_at_entry, *self.lines, "}"])
        return _Compiled(text=text, kinds=kinds, returns=returns)

    def _promised(self, name: str, returns: str | None) -> None:
        assert (self.returned is None) == (returns is None), f"{name} does not say what it returns"
        if self.returned is not None and returns is not None:
            is_short = returns == SHORT and self.returned.type == INT
            self.returned = self.integer(self.returned, SHORT) if is_short else self.turned(self.returned, returns)

    def _parameter(self, name: str, kind: Kind, *, is_entry: bool) -> list[str]:
        if isinstance(kind, tuple):
            element, n_sizes = kind
            sizes = tuple(f"%{name}.size{axis}" for axis in range(n_sizes))
            self.take(name, Array(element, f"%{name}", sizes))
            return [f"ptr %{name}", *(f"{INT} {size}" for size in sizes)]
        if is_entry and kind == TRUTH:
            self.store(name, self.emit(TRUTH, f"icmp ne {INT} %{name}, 0"))
            return [f"{INT} %{name}"]
        if is_entry and kind == SHORT:
            self.store(name, self.integer(Value(SHORT, f"%{name}"), INT))
            return [f"{SHORT} %{name}"]
        self.store(name, Value(kind, f"%{name}"))
        return [f"{kind} %{name}"]

    def call(self, name: str, nodes: Sequence[ast.expr]) -> Value | None:
        """A call of another function, which is compiled when it is first called."""
        given = [self._address(node) or self.array(node) or self.value(node) for node in nodes]
        kinds = tuple(one.kind if isinstance(one, Array) else one.type for one in given)
        compiled = self.module.called(name, kinds)
        words: list[str] = []
        for one, kind in zip(given, compiled.kinds, strict=True):
            if isinstance(one, Array):
                assert one.kind == kind, f"{name} takes another kind of array"
                sizes = () if compiled.is_of_library else one.sizes
                words += [f"ptr {one.start}", *(f"{INT} {size}" for size in sizes)]
            else:
                assert isinstance(kind, str), f"{name} takes an array"
                value = self.integer(one, SHORT) if kind == SHORT and one.type == INT else self.turned(one, kind)
                words.append(f"{kind} {value.text}")
        text = f"call {compiled.returns} @{name}({', '.join(words)})"
        if compiled.returns == "void":
            self.lines.append(f"  {text}")
            return None
        result = self.emit(compiled.returns, text)
        return self.integer(result, INT) if compiled.returns == SHORT else result

    def _address(self, node: ast.expr) -> Value | None:
        """Where a function of the text begins, for a library that will call it; None where a node names none."""
        if not isinstance(node, ast.Name) or node.id not in self.module.functions:
            return None
        self.module.from_outside(node.id)
        return Value(INT, f"ptrtoint (ptr @{node.id} to {INT})")

    def _run(self, body: Sequence[ast.stmt]) -> None:
        for line in body:
            self._statement(line)

    def _statement(self, line: ast.stmt) -> None:
        match line:
            case ast.Pass() | ast.Expr(value=ast.Constant()):
                return
            case ast.Expr(value=ast.Call(func=function, args=nodes)):
                self.call(ast.unparse(function), nodes)
            case ast.Assign(targets=[target], value=node):
                self._assign(target, node)
            case ast.AugAssign(target=ast.Name() | ast.Subscript() as target, op=op, value=node):
                self._assign(target, ast.BinOp(left=target, op=op, right=node))
            case ast.Return(value=node) if node is not None:
                self.returned = self.value(node)
            case _:
                self._branching(line)

    def _branching(self, line: ast.stmt) -> None:
        match line:
            case ast.For(target=ast.Name(id=name), iter=ast.Call(args=limits), body=body):
                self._loop(name, limits, body)
            case ast.While(test=test, body=body):
                self._repeat(lambda: self.value(test), lambda: self._run(body))
            case ast.If(test=test, body=body, orelse=other):
                self.choose(test, lambda: self._run(body), lambda: self._run(other))
            case ast.Break():
                self.go(self.leave[-1])
                self.label(self.name("unreached"))
            case _:
                raise NotImplementedError(f"{ast.unparse(line)} is nothing that a kernel may hold")

    def _assign(self, target: ast.expr, node: ast.expr) -> None:
        array = None if self.lanes is not None else self.array(node)
        if isinstance(target, ast.Subscript):
            value = self.value(node)
            place, type_ = self.place(target)
            self.store_at(value, place, type_)
        elif array is not None:
            self.keep(ast.unparse(target), array)
        elif self.lanes is not None:
            self.lanes[ast.unparse(target)] = self.value(node)
        else:
            self.store(ast.unparse(target), self.value(node))

    def _loop(self, name: str, limits: Sequence[ast.expr], body: Sequence[ast.stmt]) -> None:
        """``for name in range(limits)``."""
        counter, in_vectors = self.name(f"{name}.counter"), ast.unparse(limits[-1]) == "LANES" and _is_plain(body)
        *start, stop = map(self.value, limits)
        self.store(counter, start[0] if start else Value(INT, "0"))

        def test() -> Value:
            return self.emit(TRUTH, f"icmp slt {INT} {self.load(counter).text}, {stop.text}")

        def one() -> None:
            now = self.load(counter)
            if in_vectors:
                self.over_vectors(now.text)
            else:
                self.store(name, now)
            self._run(body)
            if in_vectors:
                self.over_vectors(None)
            step = self.width if in_vectors else 1
            self.store(counter, self.emit(INT, f"add nsw {INT} {self.load(counter).text}, {step}"))

        self._repeat(test, one, _WRITTEN_OUT if ast.unparse(limits[-1]) in self.module.written_out else "")

    def _repeat(self, test: Callable[[], Value], write: Callable[[], None], how: str = "") -> None:
        """Lines again and again, as long as a test holds."""
        head, inside, end = self.name("head"), self.name("body"), self.name("end")
        self.go(head)
        self.label(head)
        self.branch(test(), inside, end)
        self.label(inside)
        self.leave.append(end)
        write()
        self.leave.pop()
        self.go(f"{head}{how}")
        self.label(end)


def _is_plain(body: Sequence[ast.stmt]) -> bool:
    """Whether a loop over lanes can become operations on vectors."""
    if not all(
        isinstance(line, ast.Assign) or (isinstance(line, ast.AugAssign) and isinstance(line.target, ast.Subscript))
        for line in body
    ):
        return False
    places = [node.slice for line in body for node in ast.walk(line) if isinstance(node, ast.Subscript)]
    return not any(isinstance(node, ast.Subscript) for place in places for node in ast.walk(place))
