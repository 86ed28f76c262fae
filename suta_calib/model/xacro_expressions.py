"""Expressions of a xacro file, computed without Python's ``eval``.

xacro hands the text between ``${`` and ``}`` to ``eval``, and attributes lead from any object to
all of Python. Here the text is parsed, and only what descriptions need is computed: numbers,
texts, lists, dictionaries, arithmetic, comparisons, conditions, comprehensions, functions that
xacro offers, and the methods of texts and containers that are named below.
"""

from __future__ import annotations

import ast
import operator
import string
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping
from functools import lru_cache
from typing import Any, Final

Names = Mapping[str, Any]


# What each operator of an expression does.
_OPERATORS: Final[Mapping[type[ast.AST], Callable[..., Any]]] = {
    **{ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul},
    **{ast.Div: operator.truediv, ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod},
    **{ast.Pow: operator.pow, ast.BitAnd: operator.and_, ast.BitOr: operator.or_},
    **{ast.BitXor: operator.xor, ast.UAdd: operator.pos, ast.USub: operator.neg},
    **{ast.Not: operator.not_, ast.Invert: operator.invert, ast.Eq: operator.eq},
    **{ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt},
    **{ast.GtE: operator.ge, ast.Is: operator.is_, ast.IsNot: operator.is_not},
    **{ast.In: lambda a, b: a in b, ast.NotIn: lambda a, b: a not in b},
}
_CONVERSIONS: Final[Mapping[str, Callable[[Any], str]]] = {"s": str, "r": repr, "a": ascii}
_SETS: Final = "difference intersection issubset issuperset union"
# By type, a word each.
_METHODS: Final[Mapping[type[Any], str]] = {
    dict: "copy get items keys pop setdefault update values",
    list: "append copy count extend index insert pop",
    tuple: "count index",
    set: _SETS,
    frozenset: _SETS,
    float: "is_integer",
    str: "capitalize center count endswith find format index isalnum isalpha isdecimal isdigit "
    "islower isnumeric isspace isupper join ljust lower lstrip partition removeprefix "
    "removesuffix replace rfind rindex rjust rpartition rsplit rstrip split splitlines startswith "
    "strip swapcase title upper zfill",
}


class ExpressionError(Exception):
    """Something in an expression that is not computed, or that is not there."""


class Function:
    """A function that an expression may call: one that is offered, a method, or a lambda."""

    def __init__(self, call: Callable[..., Any]) -> None:
        self._call = call

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """What the function returns."""
        return self._call(*arguments, **named)


class Evaluator:
    """Computes expressions.

    Args:
        functions: those of other modules that may be called; a `Function` always may.
        namespaces: types of which an attribute is an element of that name, and nothing else.
        dotted: dictionaries of which an attribute is a method, or else an element of that name.
    """

    def __init__(
        self,
        functions: Iterable[Any],
        namespaces: tuple[type[Any], ...] = (),
        dotted: tuple[type[Any], ...] = (),
    ) -> None:
        self._functions = list(functions)
        self._callable = {id(function) for function in self._functions}
        self._namespaces, self._dotted = namespaces, dotted

    def evaluate(self, text: str, names: Names) -> Any:
        """The value of an expression with these names; raises whatever the computation raises.

        Raises:
            ExpressionError: no expression, or one that goes beyond what is computed here.
        """
        return self._value(_parsed(text.strip()), names)

    def attribute(self, value: Any, name: str) -> Any:
        """What stands behind a dot: an element of a namespace, or a harmless method."""
        if name.startswith("_"):
            raise ExpressionError(f"the attribute {name[:80]!r}, which is private in Python")
        if isinstance(value, self._namespaces):
            try:
                return value[name]
            except KeyError:
                raise NameError(f"name {name!r} is not defined") from None
        for kind, methods in _METHODS.items():
            if isinstance(value, kind) and name in methods.split():
                if name == "format":
                    return Function(_Formatter(self, value))
                return Function(getattr(value, name))
        if isinstance(value, self._dotted):
            return value[name]
        raise ExpressionError(f"the attribute {name[:80]!r} of {type(value).__name__}")

    def _value(self, node: ast.expr, names: Names) -> Any:
        compute = getattr(self, f"_{type(node).__name__.lower()}", None)
        if compute is None:
            raise ExpressionError(f"{type(node).__name__} in an expression")
        return compute(node, names)

    def _constant(self, node: ast.Constant, _names: Names) -> Any:
        return node.value

    def _name(self, node: ast.Name, names: Names) -> Any:
        if node.id.startswith("__"):
            raise ExpressionError(f"the name {node.id[:80]!r}, which is private in Python")
        try:
            return names[node.id]
        except KeyError:
            raise NameError(f"name {node.id!r} is not defined") from None

    def _binop(self, node: ast.BinOp, names: Names) -> Any:
        a, b = self._value(node.left, names), self._value(node.right, names)
        if type(node.op) not in _OPERATORS:
            raise ExpressionError(f"the operator {type(node.op).__name__}")
        _check_size(node.op, a, b)
        return _OPERATORS[type(node.op)](a, b)

    def _unaryop(self, node: ast.UnaryOp, names: Names) -> Any:
        return _OPERATORS[type(node.op)](self._value(node.operand, names))

    def _boolop(self, node: ast.BoolOp, names: Names) -> Any:
        deciding = isinstance(node.op, ast.Or)
        value: Any = None
        for part in node.values:
            value = self._value(part, names)
            if bool(value) is deciding:
                break
        return value

    def _compare(self, node: ast.Compare, names: Names) -> Any:
        left, result = self._value(node.left, names), True
        for kind, part in zip(node.ops, node.comparators, strict=True):
            right = self._value(part, names)
            result = _OPERATORS[type(kind)](left, right)
            if not result:
                break
            left = right
        return result

    def _ifexp(self, node: ast.IfExp, names: Names) -> Any:
        chosen = node.body if self._value(node.test, names) else node.orelse
        return self._value(chosen, names)

    def _attribute(self, node: ast.Attribute, names: Names) -> Any:
        return self.attribute(self._value(node.value, names), node.attr)

    def _subscript(self, node: ast.Subscript, names: Names) -> Any:
        value, index = self._value(node.value, names), self._value(node.slice, names)
        if not isinstance(value, dict | list | tuple | str | range):
            raise ExpressionError(f"an element of {type(value).__name__}")
        return value[index]

    def _slice(self, node: ast.Slice, names: Names) -> Any:
        parts = (node.lower, node.upper, node.step)
        return slice(*(None if part is None else self._value(part, names) for part in parts))

    def _call(self, node: ast.Call, names: Names) -> Any:
        function = self._value(node.func, names)
        if not isinstance(function, Function) and id(function) not in self._callable:
            raise ExpressionError(f"a call of {type(function).__name__} {str(function)[:80]!r}")
        arguments = list(self._elements(node.args, names))
        named: dict[str, Any] = {}
        for keyword in node.keywords:
            value = self._value(keyword.value, names)
            named |= value if keyword.arg is None else {keyword.arg: value}
        return function(*arguments, **named)

    def _elements(self, nodes: Iterable[ast.expr], names: Names) -> Iterator[Any]:
        for node in nodes:
            if isinstance(node, ast.Starred):
                yield from self._value(node.value, names)
            else:
                yield self._value(node, names)

    def _list(self, node: ast.List | ast.Tuple | ast.Set, names: Names) -> Any:
        made: Any = {ast.List: list, ast.Tuple: tuple, ast.Set: set}[type(node)]
        return made(self._elements(node.elts, names))

    _tuple = _set = _list

    def _dict(self, node: ast.Dict, names: Names) -> Any:
        made: dict[Any, Any] = {}
        for key, part in zip(node.keys, node.values, strict=True):
            value = self._value(part, names)
            made |= value if key is None else {self._value(key, names): value}
        return made

    def _lambda(self, node: ast.Lambda, names: Names) -> Any:
        given = node.args
        if given.vararg or given.kwarg or given.kwonlyargs or given.defaults:
            raise ExpressionError("a lambda with parameters that are not plain")
        parameters = [argument.arg for argument in given.posonlyargs + given.args]

        def call(*values: Any) -> Any:
            inner = dict(zip(parameters, values, strict=True))
            return self._value(node.body, ChainMap(inner, names))  # type: ignore[arg-type]

        return Function(call)

    def _loops(
        self, generators: list[ast.comprehension], names: Names
    ) -> Iterator[MutableMapping[str, Any]]:
        """The names in every round of a comprehension's loops."""
        first, *rest = generators
        for element in self._value(first.iter, names):
            inner: MutableMapping[str, Any] = ChainMap({}, names)  # type: ignore[arg-type]
            _assign(first.target, element, inner)
            if all(self._value(condition, inner) for condition in first.ifs):
                yield from self._loops(rest, inner) if rest else (inner,)

    def _listcomp(self, node: ast.ListComp | ast.GeneratorExp, names: Names) -> Any:
        return [self._value(node.elt, inner) for inner in self._loops(node.generators, names)]

    _generatorexp = _listcomp

    def _setcomp(self, node: ast.SetComp, names: Names) -> Any:
        return {self._value(node.elt, inner) for inner in self._loops(node.generators, names)}

    def _dictcomp(self, node: ast.DictComp, names: Names) -> Any:
        loops = self._loops(node.generators, names)
        return {self._value(node.key, scope): self._value(node.value, scope) for scope in loops}

    def _joinedstr(self, node: ast.JoinedStr, names: Names) -> Any:
        return "".join(str(self._value(part, names)) for part in node.values)

    def _formattedvalue(self, node: ast.FormattedValue, names: Names) -> Any:
        value = self._value(node.value, names)
        if node.conversion != -1:
            value = _CONVERSIONS[chr(node.conversion)](value)
        form = "" if node.format_spec is None else self._value(node.format_spec, names)
        return format(value, form)


class _Formatter(string.Formatter):
    """``'…'.format(…)``, in which ``{0.name}`` reaches what an expression would reach."""

    def __init__(self, evaluator: Evaluator, text: str) -> None:
        self._evaluator, self._text = evaluator, text

    def __call__(self, *arguments: Any, **named: Any) -> str:
        return self.vformat(self._text, arguments, named)

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        first, _, rest = field_name.replace("[", ".[").partition(".")
        value = self.get_value(int(first) if first.isdecimal() else first, args, kwargs)
        for part in filter(None, rest.split(".")):
            if part.startswith("["):
                index = part[1:].removesuffix("]")
                value = value[int(index) if index.isdecimal() else index]
            else:
                value = self._evaluator.attribute(value, part)
        return value, first


def _check_size(kind: ast.operator, a: Any, b: Any) -> None:
    """Refuse a power or a repetition that would fill the memory."""
    # Bits of an integer, and elements of a sequence: no description needs more.
    most_bits, most_elements = 10_000, 1_000_000
    if isinstance(kind, ast.Pow) and isinstance(a, int) and isinstance(b, int):
        if a.bit_length() * abs(b) > most_bits:
            raise ExpressionError("a power with thousands of digits")
    elif isinstance(kind, ast.Mult):
        for sequence, times in ((a, b), (b, a)):
            repeats = isinstance(times, int) and isinstance(sequence, str | bytes | list | tuple)
            if repeats and len(sequence) * times > most_elements:
                raise ExpressionError(f"a sequence of more than {most_elements} elements")


def _assign(target: ast.expr, value: Any, names: MutableMapping[str, Any]) -> None:
    if isinstance(target, ast.Name):
        names[target.id] = value
    elif isinstance(target, ast.Tuple | ast.List):
        for part, element in zip(target.elts, value, strict=True):
            _assign(part, element, names)
    else:
        raise ExpressionError(f"a loop over {type(target).__name__}")


@lru_cache(maxsize=4096)
def _parsed(text: str) -> ast.expr:
    if len(text) > 10_000:
        raise ExpressionError(f"an expression of {len(text)} characters")
    return ast.parse(text, "<expression>", "eval").body
