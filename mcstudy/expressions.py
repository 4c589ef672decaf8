"""Arithmetic that a user writes: ``K11 + Kpas1 - 490``, ``time + 30 * amplitude``; nothing else is computed.

The text is parsed as Python, checked node by node and compiled to postfix instructions, so that neither a deep nor a
long one exceeds the stack. Numbers are floats from the start: ``9**9**9**9`` is infinite at once, a power of integers
would take all memory.
"""

from __future__ import annotations

import ast
import operator
import re
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcstudy.errors import InputError
from mcstudy.text_tables import similar

LONGEST = 4000
"""Characters of an expression."""

SHOWN = 60
"""Characters of an expression that a message repeats."""

_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: dict[str, Callable[[Any], Any]] = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log}
_ADDED = (ast.Add, ast.Sub, ast.USub, ast.UAdd)


@dataclass(frozen=True)
class Expression:
    """Arithmetic of named values.

    Attributes
    ----------
    names: that it uses. linear: whether it is a sum of names and numbers with signs, which has their unit.
    """

    names: frozenset[str]
    linear: bool
    _instructions: tuple[tuple[int, Any], ...]

    def __call__(self, values: Mapping[str, Any]) -> Any:
        """Value at numbers or arrays by name; NaN or infinite where it is not defined."""
        stack: list[Any] = []
        with np.errstate(all="ignore"):
            for operands, operation in self._instructions:
                if operands:
                    stack[-operands:] = [operation(*stack[-operands:])]
                else:
                    stack.append(_floats(values[operation]) if isinstance(operation, str) else operation)
        return stack[0]


def expression(text: str, known: Collection[str], what: str, example: str) -> Expression:
    """The expression in ``text`` of the ``known`` names.

    ``what``: begins a message, such as "quantity". ``example``: of what was expected. Raises `InputError`, one line.
    """

    def refused(why: str) -> InputError:
        return InputError(f"{what} {shortened(text)!r}: {why}")

    if len(text) > LONGEST:
        raise refused(f"expected at most {LONGEST} characters, got {len(text)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "3(K11)": a warning of Python's before our error
            tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError as error:
        raise refused(_syntax(error, example)) from None
    except ValueError:  # a null character
        raise refused(f"expected an expression such as {example}") from None
    except (RecursionError, MemoryError):
        raise refused("expected fewer terms, or less nesting of parentheses and signs") from None
    instructions: list[tuple[int, Any]] = []
    names: set[str] = set()
    kinds: set[type] = set()
    waiting: list[ast.expr] = [tree]
    while waiting:  # operands behind their operator, and so in reverse order
        node = waiting.pop()
        if isinstance(node, ast.Name) and node.id in known:
            names.add(node.id)
            instructions.append((0, node.id))
        elif isinstance(node, ast.Constant) and isinstance(node.value, int | float) and type(node.value) is not bool:
            instructions.append((0, _number(node.value, refused)))
        elif isinstance(node, ast.BinOp | ast.UnaryOp) and type(node.op) in _OPERATORS:
            operands = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.operand]
            kinds.add(type(node.op))
            instructions.append((len(operands), _OPERATORS[type(node.op)]))
            waiting += operands
        elif isinstance(node, ast.Call) and _called(node) is not None:
            kinds.add(ast.Call)
            instructions.append((1, _called(node)))
            waiting.append(node.args[0])
        elif isinstance(node, ast.Name):
            raise refused(_unknown(node.id, known))
        else:
            part = shortened(ast.get_source_segment(text.strip(), node) or type(node).__name__)
            raise refused(f"expected names and numbers with + - * / **, sqrt, exp and log, got {part!r}")
    return Expression(frozenset(names), kinds <= set(_ADDED), tuple(reversed(instructions)))


def _floats(value: Any) -> Any:
    """Numbers as floats, for which every operation has a result; complex ones and polynomials stay what they are."""
    if getattr(value, "__array_ufunc__", value) is None:
        return value
    return np.asarray(value, dtype=complex if np.iscomplexobj(value) else float)[()]


def shortened(text: str) -> str:
    """Text for a message."""
    line = " ".join(text.split())
    return line if len(line) <= SHOWN else f"{line[: SHOWN - 1]}…"


def _number(value: float, refused: Callable[[str], InputError]) -> np.float64:
    try:
        number = np.float64(value)
    except OverflowError:
        number = np.float64(np.inf)
    if not np.isfinite(number):
        raise refused("expected numbers below 1.8e308")
    return number


def _called(node: ast.Call) -> Callable[[Any], Any] | None:
    if isinstance(node.func, ast.Name) and len(node.args) == 1 and not node.keywords:
        return _FUNCTIONS.get(node.func.id)
    return None


def _unknown(name: str, known: Collection[str]) -> str:
    if name in _FUNCTIONS:
        return f"expected {name}(...)"
    return f"expected names among {', '.join(known)}, got {shortened(name)}{similar(name, known)}"


def _syntax(error: SyntaxError, example: str) -> str:
    reason = str(error.msg or "")
    if re.match("too many nested|.*digits", reason):
        return "expected less nesting of parentheses" if "nested" in reason else "expected numbers below 1.8e308"
    return f"expected an expression such as {example}"
