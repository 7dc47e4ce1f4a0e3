"""Mutants of a module: the operators of cosmic-ray that change what numbers a module gives."""

import ast
import difflib
import random
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from tests.mutation.equivalent import EQUIVALENT

SOURCE = Path(__file__).parents[2] / "src" / "schuler"
# One or two of another kind for each; bit shifts of floats and comparisons by identity die of themselves.
_BINARY = "Add_Sub Sub_Add Mul_Div Div_Mul Pow_Mul FloorDiv_Div Mod_Mul"
_COMPARISON = "Lt_LtE Lt_GtE LtE_Lt LtE_Gt Gt_GtE Gt_LtE GtE_Gt GtE_Lt Eq_NotEq NotEq_Eq Is_IsNot IsNot_Is"
OPERATORS = (
    *(f"ReplaceBinaryOperator_{pair}" for pair in _BINARY.split()),
    *(f"ReplaceComparisonOperator_{pair}" for pair in _COMPARISON.split()),
    *("ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Not", "ReplaceUnaryOperator_Delete_Invert"),
    *("NumberReplacer", "AddNot", "ReplaceAndWithOr", "ReplaceOrWithAnd", "ReplaceTrueWithFalse"),
    *("ReplaceFalseWithTrue", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "ZeroIterationForLoop"),
)


@dataclass(frozen=True)
class Mutant:
    """A module with one thing changed.

    Attributes
    ----------
    equivalence : str
        Why no test can tell it from the original; empty if one should.
    """

    module: str
    code: str
    diff: str
    equivalence: str


def draw(module: str, most: int, seed: int) -> tuple[list[Mutant], int]:
    """Mutants of a module in the order of the draw, at most so many, and how many there are."""
    code = (SOURCE / (module.replace(".", "/") + ".py")).read_text(encoding="utf-8")
    operators = [get_operator(f"core/{name}")() for name in OPERATORS]
    # one statement or function at a time: parsing is what takes time
    parts = [node.get_code() for node in get_ast(code).children]
    changed: dict[str, None] = {}
    for place, part in enumerate(parts):
        nodes, original = list(ast_nodes(get_ast(part))), _meaning(part)
        for operator in operators:
            for i in range(sum(len(list(operator.mutation_positions(node))) for node in nodes)):
                text = mutate_code(part, operator, i)
                if text is not None and _meaning(text) not in (original, None):
                    changed["".join((*parts[:place], text, *parts[place + 1 :]))] = None
    order = list(changed)
    random.Random(f"{seed} {module}").shuffle(order)
    return [_mutant(module, code, text) for text in order[:most]], len(order)


def _mutant(module: str, code: str, text: str) -> Mutant:
    lines = list(difflib.unified_diff(code.splitlines(), text.splitlines(), f"{module}.py", "mutant", "", "", 0, ""))
    old, new = ([line[1:].strip() for line in lines[2:] if line[0] == sign] for sign in "-+")
    reason = EQUIVALENT.get((module, *old, *new), "")
    return Mutant(module, text, "\n".join(lines[2:]), reason)


def _meaning(code: str) -> str | None:
    """Syntax tree of what is run, None if it is none: no annotations, decorators, or kinds of parameters."""
    try:
        tree = ast.parse(code)
    except SyntaxError:
        return None
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.arguments):
            node.args = [*node.posonlyargs, *node.args, *node.kwonlyargs]
            node.defaults = [*node.defaults, *(default for default in node.kw_defaults if default)]
            node.posonlyargs, node.kwonlyargs, node.kw_defaults = [], [], []
        elif isinstance(node, ast.FunctionDef):
            node.returns, node.decorator_list = None, []
        elif isinstance(node, ast.ClassDef):
            node.decorator_list = []
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(None)
    return ast.dump(tree)
