"""Which part of skinbus imports which, read from the code; draws the picture of docs/architecture.md.

``python -m tests.imports`` writes it; a test holds the page to it.
"""

import ast
from pathlib import Path

from skinbus.study.marked import Marks

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "skinbus"
MODULES = sorted(PACKAGE.rglob("*.py"))
TESTS = sorted(path for path in (ROOT / "tests").rglob("*.py") if "node_modules" not in path.parts)
PAGE = ROOT / "docs" / "architecture.md"
MARKS = Marks("<!-- imports: made by python -m tests.imports -->", "<!-- /imports -->")


def imported_parts(path: Path) -> set[str]:
    """Names of the parts of skinbus that a module imports, at any depth of its code."""
    parts = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            names = [module]
            if module == "skinbus":  # its own names (__version__) are everyone's
                names = [f"skinbus.{alias.name}" for alias in node.names if not alias.name.startswith("__")]
        parts |= {name.split(".")[1] for name in names if name.startswith("skinbus.")}
    return parts


def part_imports() -> dict[str, set[str]]:
    """The folders of skinbus but ``jit``, which all may import; each with those that its modules import."""
    folders = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()} - {"jit"}
    found: dict[str, set[str]] = {folder: set() for folder in sorted(folders)}
    for path in MODULES:
        part = path.relative_to(PACKAGE).parts[0]
        if part in folders:
            found[part] |= imported_parts(path) & folders - {part}
    return found


def picture() -> str:
    """The folders as a Mermaid graph, without arrows that follow from two others."""
    direct = part_imports()

    def reached(part: str) -> set[str]:
        return direct[part].union(*(reached(other) for other in direct[part]))

    lines = ["```mermaid", "graph TD"]
    for part, others in direct.items():
        needed = {other for other in others if not any(other in reached(o) for o in others - {other})}
        lines += [f"  {part} --> {other}" for other in sorted(needed)]
    return "\n".join([*lines, "```", ""])


if __name__ == "__main__":
    MARKS.write(PAGE, picture())
