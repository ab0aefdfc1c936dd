"""Docstrings name things that exist, and no class by accident."""

import ast
import re

from tests.docs.commands import ROOT

PRODUCT = ("sdm_deflect", "geometry", "meshing", "deform", "cases")
# Errors, which a docstring may name without backticks: they are what it raises.
ERRORS = re.compile("[A-Za-z]+Error|KeyboardInterrupt")
# Types of attributes in docstrings.
TYPES = ("CadFace", "CadEdge")
# Names in files: of OpenFOAM, and of arrays whose names are put together.
FOREIGN = ("owner", "centers_x", "beta_x", "alpha_x")


def docstrings(*folders):
    """Yield the name, docstring and syntax tree of each module, class and function in some folders."""
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (text := ast.get_docstring(node)):
                yield f"{path.relative_to(ROOT)}: {getattr(node, 'name', '')}", text, node


def test_docstrings_name_no_class_by_accident():
    """A script that renames a class may also rename words of sentences."""
    texts = list(docstrings(*PRODUCT))
    classes = {node.name for _, _, node in texts if isinstance(node, ast.ClassDef)} - {*TYPES}
    double = {name for name in classes if re.search("[a-z][A-Z]", name) and not ERRORS.fullmatch(name)}
    found = []
    for name, text, _ in texts:
        plain = re.sub(r"`[^`]*`|^\S.*\n-+$", "", text, flags=re.MULTILINE)
        found += [f"{name}: {word}" for word in re.findall(r"\b[A-Z]\w+\b", plain) if word in double]
    assert found == []


def test_names_in_backticks_exist():
    code = "\n".join(path.read_text(encoding="utf-8") for folder in PRODUCT for path in (ROOT / folder).rglob("*.py"))
    known = {*re.findall(r"\w+", re.sub(r"`[^`\n]*`", "", code)), *FOREIGN}
    named = ((name, word) for name, text, _ in docstrings(*PRODUCT) for word in re.findall(r"(?<!`)`(\w+)`(?!`)", text))
    assert [f"{name}: {word}" for name, word in named if word not in known] == []
