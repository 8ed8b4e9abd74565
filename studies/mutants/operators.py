"""One-place changes of an expression: what a slip of the hand would make of it.

Each operator takes a node of a syntax tree and yields the nodes that could stand in its place.
"""

import ast
from collections.abc import Callable, Iterator
from copy import copy
from typing import Any

Nodes = Iterator[ast.AST]

_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
_ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_ROUND_OFF = 1e-6
_UNITS = {"mm", "s", "n", "gwt", "mpa", "deg", "rad", "hz", "cm2", "mm2", "rpm", "ms", "mm/s", "s2"}
_WORDS = {"strict", "description"}  # what a keyword says to whoever reads, or to nobody
_ORDER = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)


def changed(node: ast.AST, **fields: Any) -> ast.AST:
    """The node with some fields replaced."""
    other = copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def _times_ten(node: ast.expr) -> ast.expr:
    return ast.BinOp(node, ast.Mult(), ast.Constant(10))


def comparison(node: ast.AST) -> Nodes:
    """Boundary and sense of a comparison, and a limit times ten.

    Between quantities with a unit the boundary is left alone: no measured value falls on it.
    """
    if not isinstance(node, ast.Compare):
        return
    for k, operator in enumerate(node.ops):
        for other in _COMPARISONS[type(operator)][_measured(node) :]:
            yield changed(node, ops=[*node.ops[:k], other(), *node.ops[k + 1 :]])
    last = node.comparators[-1]
    if isinstance(node.ops[-1], _ORDER) and isinstance(last, ast.Attribute | ast.BinOp):
        yield changed(node, comparators=[*node.comparators[:-1], _times_ten(last)])


def arithmetic(node: ast.AST) -> Nodes:
    """Another operator; one operand of a sum or a mask left out; a whole factor times ten."""
    if not isinstance(node, ast.BinOp) or type(node.op) not in _ARITHMETIC or _is_text(node):
        return
    yield changed(node, op=_ARITHMETIC[type(node.op)]())
    if isinstance(node.op, ast.Add | ast.Sub | ast.BitAnd | ast.BitOr):
        if not isinstance(node.right, ast.Constant):
            yield node.left
        if not isinstance(node.left, ast.Constant) and not isinstance(node.op, ast.Sub):
            yield node.right
    if isinstance(node.op, ast.Mult | ast.Div) and isinstance(node.right, ast.Constant):
        yield from (changed(node, right=ast.Constant(10 * n)) for n in [node.right.value] if isinstance(n, int))


def number(node: ast.AST) -> Nodes:
    """Another number: times ten and smaller, or one more. Below 1e-6 it is a tolerance of round-off."""
    if not isinstance(node, ast.Constant) or isinstance(node.value, bool):
        return
    if isinstance(node.value, float) and node.value and abs(node.value) > _ROUND_OFF:
        yield ast.Constant(node.value * 10)
        yield ast.Constant(node.value * 0.6)
    elif node.value == 0 or isinstance(node.value, int):
        yield ast.Constant(node.value + 1)


def truth(node: ast.AST) -> Nodes:
    """True for False and the other way round."""
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)


def sign(node: ast.AST) -> Nodes:
    """A minus or a `not` left out."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield node.operand


def logic(node: ast.AST) -> Nodes:
    """`or` for `and` and the other way round; each operand but the first left out."""
    if not isinstance(node, ast.BoolOp):
        return
    yield changed(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    for k in range(len(node.values)):
        rest = [*node.values[:k], *node.values[k + 1 :]]
        yield rest[0] if len(rest) == 1 else changed(node, values=rest)


def call(node: ast.AST) -> Nodes:
    """`abs` left out, `min` and `max` without one of their two, a keyword with a plain value left out."""
    if not isinstance(node, ast.Call):
        return
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if name in {"abs", "clip", "round", "rint", "ceil", "floor"} and node.args:
        yield node.args[0]
    if name in {"min", "max", "minimum", "maximum"} and len(node.args) == 2:
        yield from node.args
    for k, keyword in enumerate(node.keywords):
        if keyword.arg and keyword.arg not in _WORDS and isinstance(keyword.value, ast.Constant | ast.Attribute):
            yield changed(node, keywords=[*node.keywords[:k], *node.keywords[k + 1 :]])


def condition(node: ast.AST) -> Nodes:
    """The opposite of a condition that is no comparison."""
    if isinstance(node, ast.If | ast.While | ast.IfExp) and isinstance(
        node.test, ast.Name | ast.Attribute | ast.Call
    ):
        yield changed(node, test=ast.UnaryOp(ast.Not(), node.test))


def deletion(node: ast.AST) -> Nodes:
    """A call, an assignment to something lasting, a raise, a jump or a result left out."""
    match node:
        case ast.Expr(value=ast.Call() | ast.Await() | ast.YieldFrom()) | ast.Raise() | ast.Break() | ast.Continue():
            yield ast.Pass()
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]) | ast.AugAssign() | ast.Delete():
            yield ast.Pass()
        case ast.Return(value=ast.expr()) if not _is_none(node.value):
            yield ast.Return(ast.Constant(None))
        case ast.Return(value=None):
            yield ast.Pass()
        case _:
            return


OPERATORS: tuple[Callable[[ast.AST], Nodes], ...] = (
    comparison,
    arithmetic,
    number,
    truth,
    sign,
    logic,
    call,
    condition,
    deletion,
)


def _measured(node: ast.Compare) -> bool:
    """Whether an order is one of quantities: of names that end in a unit."""
    if not isinstance(node.ops[0], _ORDER):
        return False
    names = (getattr(n, "attr", getattr(n, "id", "")) for n in ast.walk(node))
    return any(str(name).rsplit("_", 1)[-1].lower() in _UNITS for name in names if "_" in str(name))


def _is_none(node: ast.AST | None) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _is_text(node: ast.BinOp) -> bool:
    sides = (node.left, node.right)
    return any(
        isinstance(s, ast.JoinedStr) or (isinstance(s, ast.Constant) and isinstance(s.value, str)) for s in sides
    )
