"""The valve as a Modelica block: parsed by a foreign parser (pymoca), its algorithm turned into
Python by the rules of the language, and held to the kernels that fitted it. No Modelica compiler
takes part."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pymoca import ast, parser

from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.valve_chain import ValveChain, valve_chain
from stemwatch.service.twin.simulation_model.write_model import identifier_of, modelica_text
from tests.service.twin.test_functional_mockup_unit import (
    ACTUATOR,
    BENT,
    CURVED,
    PLAIN,
    by_fitted_model,
    by_quick_fit,
    wandering_op,
    with_term,
)

SAMPLES = 900
NEAR = 1e-9
FUNCTIONS = {
    "abs": abs,
    "ceil": math.ceil,
    "exp": math.exp,
    "fill": lambda value, count: [value] * count,
    "floor": math.floor,
    "integer": math.floor,
    "log": math.log,
    "max": max,
    "min": min,
    "sin": math.sin,
}
OPERATORS = {"^": "**"}


def in_python(node: Any) -> str:
    """An expression of Modelica as one of Python."""
    match node:
        case bool() | int() | float():
            return repr(node)
        case ast.Primary():
            return repr(node.value)
        case ast.Array():
            return "[" + ", ".join(map(in_python, node.values)) + "]"
        case ast.ComponentRef():
            index = [one for part in node.indices for one in part if one is not None]
            return f"v[{node.name!r}]" + "".join(f"[int({in_python(one)}) - 1]" for one in index)
        case ast.IfExpression():
            *cases, last = map(in_python, node.expressions)
            for condition, value in reversed(
                list(zip(map(in_python, node.conditions), cases, strict=True))
            ):
                last = f"({value} if {condition} else {last})"
            return last
        case ast.Expression():
            operator, operands = str(node.operator), list(map(in_python, node.operands))
            if operator in FUNCTIONS:
                return f"{operator}({', '.join(operands)})"
            if len(operands) == 1:
                return f"({operator} {operands[0]})"
            return "(" + f" {OPERATORS.get(operator, operator)} ".join(operands) + ")"
    raise AssertionError(f"no rule for {type(node).__name__} {node}")


def statements(block: list[Any], indent: str) -> list[str]:
    """Statements of Modelica as lines of Python."""
    lines: list[str] = []
    for one in block:
        match one:
            case ast.AssignmentStatement():
                (left,) = one.left
                lines.append(f"{indent}{in_python(left)} = {in_python(one.right)}")
            case ast.IfStatement():
                for number, (condition, inner) in enumerate(
                    zip(one.conditions, one.blocks, strict=True)
                ):
                    word = "if" if number == 0 else "elif"
                    lines.append(f"{indent}{word} {in_python(condition)}:")
                    lines += statements(inner, indent + "    ")
            case ast.ForStatement():
                (index,) = one.indices
                first, last = in_python(index.expression.start), in_python(index.expression.stop)
                lines.append(f"{indent}for v[{index.name!r}] in range({first}, {last} + 1):")
                lines += statements(one.statements, indent + "    ")
            case _:
                raise AssertionError(f"no rule for {type(one).__name__}")
    return lines


def binding(symbol: Any) -> Any:
    """The expression that a parameter or constant is bound to."""
    (value,) = [
        argument.value.modifications[0]
        for argument in symbol.class_modification.arguments
        if str(argument.value.component) == "value"
    ]
    return value


def block_of(chain: ValveChain) -> tuple[dict[str, Any], Callable[[dict[str, Any]], None]]:
    """The variables of the block as they are bound, and what one sample does to them."""
    tree = parser.parse(modelica_text(chain), bypass_cache=True)
    block = tree.classes[identifier_of(chain.valve)]
    assert block.type == "block"
    names: dict[str, Any] = dict(FUNCTIONS)
    variables: dict[str, Any] = {}
    for name, symbol in block.symbols.items():
        if {"parameter", "constant"} & set(symbol.prefixes):
            variables[name] = eval(in_python(binding(symbol)), names, {"v": variables})
        else:  # a size that is not a number is given by what is assigned
            sizes = [one for part in symbol.dimensions for one in part]
            if sizes and getattr(sizes[0], "value", None):
                variables[name] = [math.nan] * int(sizes[0].value)
    variables |= {"begun": False, "x": 0.0}
    (when,) = block.statements
    assert isinstance(when, ast.WhenStatement)
    assert str(when.conditions[0].operator) == "sample"
    assert not [one for one in block.equations if one]
    text = "\n".join(["def sample(v):", *statements(when.blocks[0], "    ")])
    exec(text, names)
    return variables, names["sample"]


def run(chain: ValveChain, op: np.ndarray, **given: float) -> np.ndarray:
    """(n,) the position at each sample."""
    variables, sample = block_of(chain)
    variables |= given
    positions = []
    for value in op.tolist():
        variables["OP"] = value
        sample(variables)
        positions.append(variables["position"])
    return np.array(positions)


@pytest.mark.parametrize("chain", [PLAIN, ACTUATOR, CURVED])
def test_the_text_says_what_the_quick_fits_kernel_does(chain: ValveChain) -> None:
    """S and J, with an actuator, and through a bent curve."""
    op = wandering_op(SAMPLES)
    assert np.max(np.abs(run(chain, op) - by_quick_fit(chain, op))) < NEAR


@pytest.mark.parametrize(
    "slug",
    [
        pytest.param(slug, marks=[] if slug == "supply_sag" else pytest.mark.long)
        for slug in sorted(catalogue())
    ],
)
def test_the_text_says_what_every_effect_does(slug: str) -> None:
    """The whole catalogue, from the stored fit through the text."""
    screening, question = with_term(slug)
    chain = valve_chain(screening)
    assert isinstance(chain, ValveChain)
    op = wandering_op()  # an hour, over which friction grows and a reading drifts
    expected = by_fitted_model(question, op)
    assert np.max(np.abs(run(chain, op, position_start=op[0]) - expected)) < NEAR


def test_the_text_keeps_the_records_interval() -> None:
    """A sample a minute through a bent curve."""
    screening, question = with_term("viscous_drag", unit_s=60.0, curve=BENT)
    chain = valve_chain(screening)
    assert isinstance(chain, ValveChain)
    op = wandering_op(SAMPLES)
    command = BENT.command(op)
    expected = by_fitted_model(question, command)
    assert np.max(np.abs(run(chain, op, position_start=command[0]) - expected)) < NEAR


@pytest.mark.parametrize(
    "name",
    [
        'FIC"1\\\n"; end x;',
        pytest.param("FIC\x00\x1b[31m\ud800", marks=pytest.mark.long),
        pytest.param("end", marks=pytest.mark.long),
        "Real",
    ],
)
def test_a_name_cannot_break_the_text(name: str) -> None:
    """Quotation marks, backslashes, ends of lines and control signs in a tag stay within the
    description or are left out; a word of Modelica is no identifier."""
    chain = replace(PLAIN, valve=name)
    modelica_text(chain).encode()
    op = wandering_op(60)
    assert run(chain, op).tolist() == run(PLAIN, op).tolist()


def test_a_tag_becomes_a_modelica_identifier() -> None:
    """A tag of the plant becomes an identifier."""
    assert identifier_of("10-FIC/104.A") == "valve_10_FIC_104_A"
    assert identifier_of("FIC-104") == "FIC_104"
    assert identifier_of("弁") == "valve"
    assert identifier_of("end") == "valve_end"
    assert len(identifier_of("F" * 5000)) == 64
