"""Finding a shape of source in a package, and putting another in its place."""

import ast
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

HOLE = re.compile(r"__[a-z]+__")


@dataclass(frozen=True)
class Defect:
    """A defect: `name` in words; `find` and `put` shapes, within the function or class `within` (anywhere where it is
    empty, `Class.method` for a method), or texts of a template; `test` the test that sees it."""

    name: str
    within: str
    find: str
    put: str
    test: str

    @property
    def of_template(self) -> bool:
        """Whether it is a text of a template instead of a shape of Python."""
        return "{{" in self.find


@dataclass(frozen=True)
class Planted:
    """A file, and its text with the defect in it."""

    path: Path
    text: str


def plant(defect: Defect, root: Path) -> Planted:
    """The one place of a defect below a package's folder. Raises `LookupError` where there is none, or several."""
    found = _in_templates(defect, root) if defect.of_template else _in_python(defect, root)
    if len(found) != 1:
        raise LookupError(f"'{defect.name}' is found {len(found)} times: {[str(one.path) for one in found]}")
    return found[0]


def _in_templates(defect: Defect, root: Path) -> list[Planted]:
    found = []
    for path in sorted(root.rglob("*.html")):
        text = path.read_text(encoding="utf-8")
        found += [Planted(path, text.replace(defect.find, defect.put, 1))] * text.count(defect.find)
    return found


def _in_python(defect: Defect, root: Path) -> list[Planted]:
    shape, put = _shape(defect.find), _shape(defect.put)
    found = []
    last = defect.within.rpartition(".")[2]
    for path in sorted(root.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if last not in text:
            continue
        tree = _tree(text)
        for node in (part for place in _places(tree, defect.within) for part in ast.walk(place)):
            holes: dict[str, ast.AST] = {}
            if alike(shape, node, holes):
                found.append(Planted(path, _replaced(text, node, put, holes)))
    return found


@cache
def _tree(text: str) -> ast.Module:
    return ast.parse(text)


def _places(tree: ast.Module, within: str) -> list[ast.AST]:
    """The functions or classes of a name, dotted for those in a class; the whole file where there is no name."""
    places: list[ast.AST] = [tree]
    for name in within.split(".") if within else ():
        kinds = (ast.FunctionDef, ast.ClassDef)
        inner = [node for place in places for node in ast.walk(place) if isinstance(node, kinds) and node.name == name]
        places = list(inner)
    return places


def _shape(text: str) -> ast.AST:
    """A statement, or the expression that it is."""
    (statement,) = ast.parse(text).body
    return statement.value if isinstance(statement, ast.Expr) else statement


def alike(shape: ast.AST, node: ast.AST, holes: dict[str, ast.AST]) -> bool:
    """Whether a node has a shape; what fills its holes is entered."""
    if isinstance(shape, ast.Name) and HOLE.fullmatch(shape.id) and isinstance(node, ast.expr):
        if shape.id in holes:
            return ast.dump(holes[shape.id]) == ast.dump(node)
        holes[shape.id] = node
        return True
    if type(shape) is not type(node):
        return False
    for field in shape._fields:
        if field in ("ctx", "type_comment", "kind"):
            continue
        a, b = getattr(shape, field, None), getattr(node, field, None)
        pairs = list(zip(a, b, strict=False)) if isinstance(a, list) and isinstance(b, list) else [(a, b)]
        if isinstance(a, list) and len(a) != len(b):
            return False
        for one, other in pairs:
            if isinstance(one, ast.AST) != isinstance(other, ast.AST):
                return False
            if isinstance(one, ast.AST):
                if not alike(one, other, holes):
                    return False
            elif one != other:
                return False
    return True


class _Fill(ast.NodeTransformer):
    def __init__(self, holes: dict[str, ast.AST]) -> None:
        self.holes = holes

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return self.holes.get(node.id, node)


def _replaced(text: str, node: ast.AST, put: ast.AST, holes: dict[str, ast.AST]) -> str:
    """A file's text with a node replaced by another shape, its holes filled."""
    new = ast.unparse(_Fill(holes).visit(ast.parse(ast.unparse(put))))
    new = f"({new})" if isinstance(put, ast.expr) else new
    lines = text.splitlines(keepends=True)
    start = sum(len(line.encode()) for line in lines[: node.lineno - 1]) + node.col_offset  # type: ignore[attr-defined]
    end = sum(len(line.encode()) for line in lines[: node.end_lineno - 1]) + node.end_col_offset  # type: ignore[attr-defined]
    data = text.encode()
    return (data[:start] + new.encode() + data[end:]).decode()
