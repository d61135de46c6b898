"""The architecture, held by a machine: who may import whom, how long files are, what they say first."""

import ast
import re
from pathlib import Path

import pytest

from tests.imports import MARKS, MODULES, PACKAGE, PAGE, ROOT, TESTS, imported_parts, picture

MAX_LINES = 400

ALLOWED = {
    "can": set(),
    "model": set(),
    "objects": {"can", "model"},
    "config": {"model", "objects"},
    "estimate": {"model"},
    "robot": {"model"},
    "node": {"can", "model", "objects"},
    "bus": {"can"},
    "sim": {"can", "model", "objects", "config", "node", "robot"},
    "master": {"can", "model", "objects", "config", "node", "estimate", "robot"},
    "planning": {"can", "model", "objects", "config", "estimate"},
    "study": {
        "can",
        "model",
        "objects",
        "config",
        "node",
        "estimate",
        "robot",
        "sim",
        "master",
        "planning",
    },
    "skin": {
        "can",
        "model",
        "objects",
        "config",
        "node",
        "estimate",
        "robot",
        "bus",
        "sim",
        "master",
        "planning",
        "study",
    },
    "view": {"can", "model", "objects", "config", "robot", "skin"},
}
FREE = {"cli", "__init__.py", "__main__.py", "errors.py", "jit.py"}  # all parts, or none by their nature
EVERYONE_MAY = {"errors", "jit"}


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_module_imports_only_what_the_design_allows(path):
    part = path.relative_to(PACKAGE).parts[0]
    if part in FREE:
        return
    extra = imported_parts(path) - ALLOWED[part] - EVERYONE_MAY - {part}
    assert not extra, f"{relative(path)} imports {sorted(extra)}; {part} may import {sorted(ALLOWED[part])}"


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_module_is_short_and_says_what_it_is_for(path):
    text = path.read_text()
    assert len(text.splitlines()) <= MAX_LINES
    docstring = ast.get_docstring(ast.parse(text))
    assert docstring, f"{relative(path)} has no docstring"
    assert docstring.splitlines()[0].endswith("."), f"{relative(path)}: the first line is a sentence"


def test_modules_form_no_import_cycle():
    names = {
        path: ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in MODULES
    }
    known = set(names.values())
    edges = {}
    for path, name in names.items():
        targets = set()
        for node in ast.parse(
            path.read_text()
        ).body:  # imports at the top only: those inside functions run later
            if isinstance(node, ast.ImportFrom) and node.module in known:
                targets |= {
                    f"{node.module}.{a.name}" if f"{node.module}.{a.name}" in known else node.module
                    for a in node.names
                }
            elif isinstance(node, ast.Import):
                targets |= {a.name for a in node.names if a.name in known}
        edges[name] = targets - {name}
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, f"cycle: {' -> '.join([*trail[trail.index(name) :], name])}"
        if name not in done:
            for target in edges[name]:
                visit(target, (*trail, name))
            done.add(name)

    for name in edges:
        visit(name, ())


def test_no_test_imports_a_test_file():
    """What tests share stands in a module of its own."""
    for path in TESTS:
        for node in ast.walk(ast.parse(path.read_text())):
            module = getattr(node, "module", None) or ""
            assert "test_" not in module, f"{relative(path)} imports {module}"


PARTS = re.compile(r"(_?\d+|_(one|two|three|a|b|more|part|rest|continued))$")


@pytest.mark.parametrize("path", [*MODULES, *TESTS], ids=relative)
def test_no_file_is_a_numbered_part_of_another(path):
    """A file that would pass the cap is divided by purpose."""
    whole = PARTS.sub("", path.stem)
    assert whole == path.stem or not (path.parent / f"{whole}.py").exists()


def test_picture_of_the_imports_is_that_of_the_code():
    assert picture() in MARKS.read(PAGE), "run: python -m tests.imports"
